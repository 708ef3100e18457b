"""What is compiled, and how; numba is loaded only where something has to be.

``step`` marks one scalar step of the physics. It is inlined at the numba level into every loop
that calls it: without that the lanes of `batch` do not vectorise (measured: 4.6 times slower).

``part`` marks a step that LLVM alone inlines: it compiles several times faster than one that numba
inlines, and its lanes still vectorise if it is short.

``loop`` marks the compiled loops. They release the GIL, so that threads share the work, and they
are kept on disk for the next process (`ematwin.numerics.cache`), which runs them without numba
(`ematwin.numerics.machine_code`).

``contract``, ``nsz`` and ``arcp`` are the only relaxations of floating point: fused multiply-add,
the sign of zero ignored, reciprocals of loop constants. Sums keep their order, and NaN keeps its
meaning: it is how a diverged candidate is told.
"""

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from types import FunctionType
from typing import Any

from ematwin.numerics.cache import NamedByContent, files_for
from ematwin.numerics.dependencies import dependencies
from ematwin.numerics.kinds import Kind, UnknownKindError, kind, text
from ematwin.numerics.machine_code import (
    LOADING,
    MachineCode,
    function_of,
    is_possible,
    processor,
)

_RELAXED = {"contract", "nsz", "arcp"}


class Compiled:
    """A function that is run as machine code: from disk, or compiled by numba on its first call.

    Compiled functions may call it, as they may call what ``numba.njit`` gives.

    Parameters
    ----------
    function : in Python
    kept : bool, whether machine code is kept on disk
    interleave : int, vectors that lanes are computed in at the same time (`loop`)
    single : bool, in single precision (`ematwin.numerics.single`)
    options : of ``numba.njit``

    Attributes
    ----------
    py_func : the function in Python
    targetoptions : options of ``numba.njit``; by this name numba asks whether to inline it
    """

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        kept: bool = False,
        interleave: int = 0,
        single: bool = False,
        **options: Any,
    ) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = options
        self.kept, self.interleave, self.single = kept, interleave, single
        self._ready: dict[tuple[Kind, ...], Callable[..., Any]] = {}

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """What the function returns."""
        if named or not self.kept:
            return self.dispatcher(*arguments, **named)
        try:
            kinds = tuple(map(kind, arguments))
        except UnknownKindError:
            return self.dispatcher(*arguments)
        run = self._ready.get(kinds)
        if run is None:
            with LOADING:
                run = self._ready.setdefault(kinds, self._from_disk(kinds) or self.dispatcher)
        return run(*arguments)

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function."""
        from ematwin.numerics.compiler import dispatcher_of

        with LOADING:
            return dispatcher_of(self)

    @cached_property
    def files(self) -> NamedByContent | None:
        """Where its machine code is kept; None where it cannot be."""
        assert isinstance(self.py_func, FunctionType)
        return files_for(self.py_func, lambda: dependencies(self)) if self.kept else None

    @property
    def _numba_type_(self) -> Any:
        """numba asks for the type of a global name; it loads numba, if nothing else has."""
        return self.dispatcher._numba_type_

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    def _from_disk(self, kinds: tuple[Kind, ...]) -> Callable[..., Any] | None:
        if not is_possible() or self.files is None:
            return None
        found = self.files.load(key_of(kinds))
        try:
            machine = MachineCode._make(found)
            return function_of(machine, self.py_func.__module__, self.py_func.__name__)
        except Exception:  # nothing there, or nothing that runs without numba
            return None


def key_of(kinds: tuple[Kind, ...]) -> str:
    """What machine code for arguments of some kinds is kept under."""
    return f"({' '.join(map(text, kinds))}) {processor()}"


def step(function: Callable[..., Any]) -> Any:
    """Mark a scalar step, which numba inlines."""
    return Compiled(function, inline="always", error_model="numpy", fastmath=_RELAXED)


def part(function: Callable[..., Any]) -> Any:
    """Mark a step that LLVM alone inlines."""
    return Compiled(function, forceinline=True, error_model="numpy", fastmath=_RELAXED)


def loop(function: Callable[..., Any] | None = None, *, interleave: int = 0) -> Any:
    """Compile ``function`` on its first call; keep the result on disk for the next process.

    ``interleave`` is the number of vectors that its lanes are computed in at the same time, so that
    the latency of one is hidden by the others; 0 is for a loop without lanes, or leaves it to LLVM,
    which takes one where a step is long.
    """
    if function is None:
        return partial(loop, interleave=interleave)
    return _looped(function, interleave)


def loop_in_single(function: Any, *, interleave: int, **constants: Any) -> Any:
    """A loop once more, in single precision (`ematwin.numerics.single`).

    ``constants`` take the place of those of the same names in its module: how many lanes, and of
    which type. Steps that are a `part` stay in double precision.
    """
    plain = getattr(function, "py_func", function)
    changed = {**plain.__globals__, **constants}
    other = FunctionType(plain.__code__, changed, plain.__name__, plain.__defaults__)
    other.__qualname__, other.__module__ = plain.__qualname__, plain.__module__
    return _looped(other, interleave, single=True)


def _looped(function: Callable[..., Any], interleave: int, *, single: bool = False) -> Compiled:
    return Compiled(
        function, kept=True, interleave=interleave, single=single,
        nogil=True, error_model="numpy", fastmath=_RELAXED,
    )  # fmt: skip


class _WideVectors:
    """Lets LLVM use the widest vectors of the processor in the calling function.

    On processors with AVX-512 LLVM stays at 256 bits unless it is told otherwise; the lanes of
    the monitor model gain 1.4 times from the other half. numba can say so only for a whole
    process (NUMBA_CPU_FEATURES), which is not ours to set; a function attribute is local. Without
    AVX-512, and in Python, it changes nothing.
    """

    def __call__(self) -> None:
        """Nothing, in Python."""

    @property
    def _numba_type_(self) -> Any:
        from ematwin.numerics.compiler import wide_vectors

        return wide_vectors()


wide_vectors = _WideVectors()
