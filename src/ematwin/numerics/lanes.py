"""Candidates side by side in the lanes of a processor's vector unit.

LLVM turns a loop over candidates into vector instructions if each scalar step is inlined, has
selects in place of branches, and reads and writes few arrays, with a row for each field of a tuple
and a column for each lane (`columns`): it gives up where many arrays might overlap. What it needs
to be told beyond that is here, without private parts of numba.
"""

from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numpy as np
from numba.core import event, types
from numba.extending import intrinsic

from ematwin.numerics.compile import loop, step

LANES = 16
"""Candidates side by side: two vectors of AVX-512, four of AVX2. More are no faster."""


def lane_loop(function: Callable[..., Any]) -> Any:
    """Compile a loop over lanes; else as `ematwin.numerics.compile.loop`."""
    made = loop(function)
    made.over_lanes = True
    return made


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


class _TwoVectors(event.Listener):
    """Has LLVM compute two vectors at a time in a loop over lanes.

    A step is a long chain of operations that wait for one another; another vector fills the gaps.
    Left to itself LLVM takes one where a step is long, which is 1.2 to 1.4 times slower. It takes
    the option for a process; numba compiles one function at a time.
    """

    def on_start(self, event: Any) -> None:
        """Ask for two."""
        self._take(event, 2)

    def on_end(self, event: Any) -> None:
        """Leave it to LLVM."""
        self._take(event, 0)

    def _take(self, event: Any, vectors: int) -> None:
        if hasattr(event.data["dispatcher"], "over_lanes"):
            llvmlite.binding.set_option("ematwin", f"-force-vector-interleave={vectors}")


event.register("numba:compile", _TwoVectors())
