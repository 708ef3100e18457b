"""The only place that chooses numba options.

``step`` marks one scalar step of the physics. It is inlined at the numba level into every loop
that calls it: without that the lanes of `batch` do not vectorise (measured: 4.6 times slower).

``part`` marks a step that LLVM alone inlines: it compiles several times faster than one that numba
inlines, and its lanes still vectorise if it is short.

``loop`` marks the compiled loops. They release the GIL, so that threads share the work, and they
are kept on disk for the next process (`ematwin.numerics.cache`).

``contract``, ``nsz`` and ``arcp`` are the only relaxations of floating point: fused multiply-add,
the sign of zero ignored, reciprocals of loop constants. Sums keep their order, and NaN keeps its
meaning: it is how a diverged candidate is told.
"""

from collections.abc import Callable
from functools import partial
from types import FunctionType
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from numba.core import types
from numba.core.typing.templates import Signature
from numba.core.typing.typeof import Purpose, typeof
from numba.extending import intrinsic
from numba.np.numpy_support import from_dtype, map_layout

from ematwin.numerics.cache import keep

_RELAXED = {"contract", "nsz", "arcp"}

# LLVM gives up the vectors of a loop that would have to check more pairs of arrays for overlap. The
# lanes of the truer forms with power have more of them, and were 8 times slower without vectors.
_OVERLAPS, _USUAL_OVERLAPS, _MOST_OVERLAPS = "vectorize-memory-check-threshold", 128, 4096

step = numba.njit(inline="always", error_model="numpy", fastmath=_RELAXED)

part = numba.njit(forceinline=True, error_model="numpy", fastmath=_RELAXED)


def loop(function: Callable[..., Any] | None = None, *, interleave: int = 0) -> Any:
    """Compile ``function`` on its first call; keep the result on disk for the next process.

    ``interleave`` is the number of vectors that its lanes are computed in at the same time, so that
    the latency of one is hidden by the others; 0 is for a loop without lanes, or leaves it to LLVM,
    which takes one where a step is long.
    """
    if function is None:
        return partial(loop, interleave=interleave)
    return _compiled(function, interleave)


def loop_in_single(function: Any, *, interleave: int, **constants: Any) -> Any:
    """A loop once more, in single precision (`ematwin.numerics.single`).

    ``constants`` take the place of those of the same names in its module: how many lanes, and of
    which type. Steps that are a `part` stay in double precision.
    """
    from ematwin.numerics.single import InSingle

    plain = getattr(function, "py_func", function)
    changed = {**plain.__globals__, **constants}
    other = FunctionType(plain.__code__, changed, plain.__name__, plain.__defaults__)
    other.__qualname__, other.__module__ = plain.__qualname__, plain.__module__
    return _compiled(other, interleave, pipeline_class=InSingle)


def _compiled(function: Callable[..., Any], interleave: int, **options: Any) -> Any:
    compiled = numba.njit(nogil=True, error_model="numpy", fastmath=_RELAXED, **options)(function)
    if interleave and hasattr(compiled, "_compiler"):  # not where NUMBA_DISABLE_JIT is set
        compiled._compiler.compile = _in_lanes(compiled._compiler.compile, interleave)
    if hasattr(compiled, "typeof_pyval"):
        vars(compiled)["typeof_pyval"] = _type_of
    keep(compiled)
    return compiled


def _type_of(value: Any) -> types.Type:
    """numba's type of an argument.

    numba asks whether an array is a masked one, and loads `numpy.ma` for that: a seventh of what
    it takes to load numpy and numba.
    """
    if type(value) is np.ndarray:
        return types.Array(
            from_dtype(value.dtype), value.ndim, map_layout(value),
            readonly=not value.flags.writeable,
        )  # fmt: skip
    if isinstance(value, tuple):
        return types.BaseTuple.from_types([_type_of(each) for each in value], type(value))
    return typeof(value, Purpose.argument)


def _in_lanes(compile_it: Callable[..., Any], interleave: int) -> Callable[..., Any]:
    """LLVM takes these as options of the process; numba compiles one function at a time."""
    ours = (f"-force-vector-interleave={interleave}", f"-{_OVERLAPS}={_MOST_OVERLAPS}")
    usual = ("-force-vector-interleave=0", f"-{_OVERLAPS}={_USUAL_OVERLAPS}")

    def compile_with_options(*arguments: Any) -> Any:
        for option in ours:
            llvmlite.binding.set_option("ematwin", option)
        try:
            return compile_it(*arguments)
        finally:
            for option in usual:
                llvmlite.binding.set_option("ematwin", option)

    return compile_with_options


@intrinsic
def wide_vectors(typing_context: Any) -> tuple[Signature, Callable[..., Any]]:
    """Let LLVM use the widest vectors of the processor in the calling function.

    On processors with AVX-512 LLVM stays at 256 bits unless it is told otherwise; the lanes of
    the monitor model gain 1.4 times from the other half. numba can say so only for a whole
    process (NUMBA_CPU_FEATURES), which is not ours to set; a function attribute is local. Without
    AVX-512 it changes nothing.
    """

    def generate(context: Any, builder: Any, signature: Signature, arguments: Any) -> Any:
        # llvmlite refuses attributes with values by name; they are legal LLVM all the same.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), generate
