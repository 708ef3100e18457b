"""The kernel that a GPU runs, for numba-cuda; imported only where that is installed.

numba-cuda compiles the steps marked for the processor anew for the device. All are inlined, so that
the relaxations of floating point that they were marked with (`ematwin.numerics.compile`) do not
matter: numba-cuda would take them for permission to ignore NaN.
"""

from typing import Any

import numpy as np
from numba import config, cuda, float64, int64
from numba.core.types import Array

from ematwin.models.bldc.monitor_thread import score_candidate
from ematwin.models.bldc.state import lane_constants

_inlined = cuda.jit(device=True, inline="always")
_constants = _inlined(lane_constants.py_func)
_score = _inlined(score_candidate)


def _by_thread(k, constants, which, signals, numbers, counts, costs, status, response, watts):
    """Score candidate n in thread n on its stretch ``which[n]``.

    Arguments as in `score_candidate`; ``constants`` (35, B) and ``which`` (B,) of each candidate.
    """
    n = cuda.grid(1)
    if n < costs.size:
        _score(
            n, which[n], k, _constants(constants, n), signals, numbers, counts,
            costs, status, response, watts,
        )  # fmt: skip


monitor_scores_by_thread = cuda.jit(_by_thread)


def compiled_text(capability: tuple[int, int] = (8, 0)) -> str:
    """The kernel in PTX for devices of a compute capability; needs the compiler, but no device."""
    row, rows = Array(float64, 1, "C"), Array(float64, 2, "C")
    whole, wholes = Array(int64, 1, "C"), Array(int64, 2, "C")
    text, _ = cuda.compile(
        _by_thread, (rows, rows, whole, rows, rows, wholes, row, whole, rows, rows),
        device=False, abi="numba", cc=capability, output="ptx",
    )  # fmt: skip
    return str(text)


def _teach_floor() -> None:
    """Tell numba-cuda what ``np.floor`` is: 0.30 types it but cannot lower it."""
    from numba.cuda import libdevice, types, typing
    from numba.cuda.extending import lower_builtin

    @lower_builtin(np.floor, types.float64)
    def floor(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        same = typing.signature(types.float64, types.float64)
        return context.get_function(libdevice.floor, same)(builder, arguments)


if not config.ENABLE_CUDASIM:  # type: ignore[attr-defined]  # the simulator calls numpy itself
    _teach_floor()
