"""Candidates side by side in the lanes of a processor's vector unit.

LLVM turns a loop over candidates into vector instructions if each scalar step is inlined, has
selects in place of branches, and reads and writes few arrays, with a row for each field of a tuple
and a column for each lane (`columns`): it gives up where many arrays might overlap. Further
instructions to LLVM are here, without private parts of numba. `Traces` makes the loop over time
and candidates of two steps of a model.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import llvmlite.binding
import numpy as np
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic

from ematwin.numerics.compile import loop, step
from ematwin.numerics.side_by_side import by_candidate, side_by_side

LANES = 16
"""Candidates side by side: two vectors of AVX-512, four of AVX2. More are no faster."""


def lane_loop(function: Callable[..., Any]) -> Any:
    """Compile a loop over lanes; else as `ematwin.numerics.compile.loop`.

    A step is a long chain of operations that wait for one another; another vector fills the gaps.
    Left to itself LLVM takes one where a step is long, which is 1.2 to 1.4 times slower. It takes
    the option for a process; numba compiles one function at a time.
    """
    made = loop(function)
    made.over_lanes = True
    if hasattr(made, "compile"):  # else NUMBA_DISABLE_JIT is set
        made.compile = partial(_in_two_vectors, made.compile)
    return made


def _in_two_vectors(compile_it: Callable[[Any], Any], signature: Any) -> Any:
    with global_compiler_lock:
        llvmlite.binding.set_option("ematwin", "-force-vector-interleave=2")
        try:
            return compile_it(signature)
        finally:
            llvmlite.binding.set_option("ematwin", "-force-vector-interleave=0")


def columns(fields: Any) -> tuple[Any, Any, Any]:
    """Steps that make, read and write an array (fields, lanes) for a class of named tuples.

    ``new()`` gives the array, not filled; ``read(rows, n)`` the tuple of lane ``n``, and
    ``write(rows, n, values)`` takes one.
    """
    count = len(fields._fields)
    held = ", ".join(f"rows[{m}, n]" for m in range(count))
    stored = "; ".join(f"rows[{m}, n] = values[{m}]" for m in range(count))
    names = {"__name__": __name__, "fields": fields, "empty": np.empty}
    sources = (
        f"def new(): return empty(({count}, {LANES}))",
        f"def read(rows, n): return fields({held})",
        f"def write(rows, n, values): {stored}",
    )
    exec("\n".join(sources), names)  # as `typing.NamedTuple` makes its classes
    new, read, write = (step(names[name]) for name in ("new", "read", "write"))
    return new, read, write


@intrinsic
def wide_vectors(typing_context: Any) -> Any:
    """Let LLVM use the widest vectors of the processor in the calling function.

    On processors with AVX-512 LLVM stays at 256 bits unless it is told otherwise; lanes gain 1.4
    times from the other half. numba could say so only for a whole process (NUMBA_CPU_FEATURES); a
    function attribute is local. Without AVX-512 it changes nothing.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # llvmlite refuses attributes with values by name; they are legal LLVM all the same
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), generate


class Traces:
    """A model over time for many candidates, side by side in lanes.

    Parameters
    ----------
    constants, state, answers : classes of named tuples of numbers: a candidate, its state,
        and its compared channels
    sampled : step ``(state, command, load, n, c, interval) -> state, answers`` at sample ``n``;
        ``answers`` are what that sample shows
    advanced : step ``(state, command, load, c, dt) -> state`` over a time ``dt``, with command and
        load at its start; they run in straight lines from one sample to the next
    """

    def __init__(
        self, constants: Any, state: Any, answers: Any, sampled: Any, advanced: Any
    ) -> None:
        self.constants, self.state, self.answers = constants, state, answers
        self.sampled, self.advanced = sampled, advanced
        self.loop = self._made_loop()

    def __call__(
        self, command: np.ndarray, load: np.ndarray | None, constants: Any, start: Any,
        interval: float, substeps: int, *, count: int, threads: int | None = None,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """What B = ``count`` candidates answer with, (B, S) arrays by name.

        NaN for a candidate with a constant or a start that is not finite, and from the sample on
        at which one left the finite numbers. The number of threads does not change a digit.

        Parameters
        ----------
        command, load : (S,) arrays; no load is zero
        constants, start : named tuples of numbers, or of (B,) arrays where candidates differ
        interval, substeps : s, and steps, from one sample to the next
        """
        own, first = by_candidate(constants, count), by_candidate(start, count)
        names = self.answers._fields
        traces = np.empty((count, len(names), command.size))
        command = np.ascontiguousarray(command, dtype=float)
        load = np.zeros(command.size) if load is None else np.ascontiguousarray(load, dtype=float)

        def simulate(part: slice) -> None:
            self.loop(command, load, own[part], first[part], interval, substeps, traces[part])

        side_by_side(simulate, [slice(n, n + LANES) for n in range(0, count, LANES)], threads)
        return {name: traces[:, n] for n, name in enumerate(names)}

    def _made_loop(self) -> Any:
        new_constants, constants_of, _ = columns(self.constants)
        new_state, state_of, write_state = columns(self.state)
        new_answers, _, write_answers = columns(self.answers)
        rows, own_rows = len(self.answers._fields), len(self.constants._fields)
        state_rows, sampled, advanced = len(self.state._fields), self.sampled, self.advanced

        @lane_loop
        def traces_over(command, load, constants, start, interval, substeps, traces):
            """Fill ``traces`` (B, K, S); constants (B, C) and start (B, N)."""
            wide_vectors()
            batch, samples = constants.shape[0], command.size
            dt = interval / substeps
            own = new_constants()
            now = new_state()
            seen = new_answers()
            lost = np.empty(LANES)  # zero; NaN from where a candidate is no more
            for first in range(0, batch, LANES):
                inside = min(LANES, batch - first)
                for n in range(LANES):
                    who = first + min(n, inside - 1)  # the last one fills the lanes of a block
                    lost[n] = 0.0
                    for m in range(own_rows):
                        own[m, n] = constants[who, m]
                        lost[n] += 0.0 * own[m, n]
                    for m in range(state_rows):
                        now[m, n] = start[who, m]
                        lost[n] += 0.0 * now[m, n]
                for sample in range(samples):
                    command_now = command[sample]
                    load_now = load[sample]
                    for n in range(LANES):
                        after, shown = sampled(
                            state_of(now, n), command_now, load_now, sample, constants_of(own, n),
                            interval,
                        )  # fmt: skip
                        write_state(now, n, after)
                        write_answers(seen, n, shown)
                        for m in range(rows):
                            lost[n] += 0.0 * seen[m, n]
                    for m in range(rows):
                        for n in range(inside):
                            traces[first + n, m, sample] = seen[m, n] + lost[n]
                    if sample + 1 < samples:
                        d_command = (command[sample + 1] - command_now) / substeps
                        d_load = (load[sample + 1] - load_now) / substeps
                        for j in range(substeps):
                            command_then = command_now + j * d_command
                            load_then = load_now + j * d_load
                            for n in range(LANES):
                                after = advanced(
                                    state_of(now, n), command_then, load_then,
                                    constants_of(own, n), dt,
                                )  # fmt: skip
                                write_state(now, n, after)

        return traces_over
