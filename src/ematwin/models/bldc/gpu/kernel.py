"""The kernel that a GPU runs: one thread for each candidate on each stretch.

It calls `monitor_step`, and adds up the same sums in the same order as the lanes of
`ematwin.models.bldc.batch.monitor_scores`. Sine, cosine and fused sums of a device differ, so costs
agree to rounding, not to the last digit.

numba-cuda compiles the steps marked for the processor anew for the device. All are inlined, so that
the relaxations of floating point that they were marked with (`ematwin.numerics.compile`) do not
matter: numba-cuda would take them for permission to ignore NaN.
"""

import math
from typing import Any

import numpy as np
from numba import config, cuda

from ematwin.models.bldc.batch import read_constants
from ematwin.models.bldc.monitor_step import MonitorState, monitor_step
from ematwin.models.bldc.pairs import pairs_of
from ematwin.models.bldc.state import fault_state
from ematwin.numerics.compile import step
from ematwin.numerics.scalar import biquad

# Rows of the signals, a column for each sample.
COMMAND, LOAD, TARGET, WEIGHT = range(4)
# Columns of the numbers of a stretch: `MonitorState`; b0 b1 b2 a1 a2 z1 z2 of the low-pass; its
# state for the power at the start; the first column of the signals, samples; the step in s, steps
# from one sample to the next; whether magnitudes are compared; samples kept, and of the power.
STATE, TAPS, POWER, FIRST, SAMPLES, STEP, SUBSTEPS, RECTIFY, KEPT, KEPT_POWER = (
    0, 7, 14, 16, 17, 18, 19, 20, 21, 22,
)  # fmt: skip

_inlined = cuda.jit(device=True, inline="always")
_constants = _inlined(read_constants.py_func)


@step
def between(place, size):
    """The sample before a place, and the share of the way to the next; the ends beyond them."""
    last = size - 1
    inside = min(max(place, 0.0), float(last))
    n = min(int(inside), last - 1)
    return n, inside - n


@_inlined
def score_candidate(n, stretch, k, c, signals, numbers, costs, response, watts):
    """Simulate and score candidate ``n`` on a stretch.

    Parameters
    ----------
    n, stretch : int
    k : (8, T) array, fault vectors
    c : Constants of this candidate
    signals : (4, S) array: command (rad) and load (N m) on the motor shaft, filtered current of the
        record (A), weights
    numbers : (R, 23) array, of each stretch
    costs : (T,) array, filled with sum(weight (target - filtered current)^2), infinite where the
        simulation diverged
    response : (K, T) array, filled with every ceil(samples/kept)-th filtered current, A
    watts : (K, T) array, filled likewise with the filtered electrical power, W
    """
    first = int(numbers[stretch, FIRST])
    samples = int(numbers[stretch, SAMPLES])
    substeps = int(numbers[stretch, SUBSTEPS])
    rectify = numbers[stretch, RECTIFY] != 0.0
    kept = int(numbers[stretch, KEPT])
    stride = (samples + kept - 1) // max(kept, 1)
    with_power = numbers[stretch, KEPT_POWER] > 0.0
    low_pass = (
        numbers[stretch, TAPS], numbers[stretch, TAPS + 1], numbers[stretch, TAPS + 2],
        numbers[stretch, TAPS + 3], numbers[stretch, TAPS + 4],
    )  # fmt: skip
    z1, z2 = numbers[stretch, TAPS + 5], numbers[stretch, TAPS + 6]
    y1, y2 = numbers[stretch, POWER], numbers[stretch, POWER + 1]
    dt = numbers[stretch, STEP]
    share = 1.0 / substeps
    rate = 1.0 / (dt * substeps)

    # A NaN anywhere must show: as a friction it would only hold all at rest.
    cost = 0.0
    for m in range(8):
        cost += 0.0 * k[m, n]
    for value in c:
        cost += 0.0 * value
    delay = c.load_delay if math.isfinite(c.load_delay) else 0.0
    fault = fault_state(
        k[0, n], k[1, n], k[2, n], k[3, n], k[4, n], k[5, n], k[6, n], k[7, n], c.half_gap
    )
    pairs = pairs_of(fault, c)
    now = MonitorState(
        numbers[stretch, STATE], numbers[stretch, STATE + 1], numbers[stretch, STATE + 2],
        numbers[stretch, STATE + 3], numbers[stretch, STATE + 4], numbers[stretch, STATE + 5],
        numbers[stretch, STATE + 6],
    )  # fmt: skip
    if kept > 0:
        response[0, n] = signals[TARGET, first]
        if with_power:
            watts[0, n] = 0.0  # the start counts nothing
    before, part = between(-delay * rate, samples)
    at = first + before
    load_end = signals[LOAD, at] + part * (signals[LOAD, at + 1] - signals[LOAD, at])
    for sample in range(1, samples):
        command = signals[COMMAND, first + sample - 1]
        d_command = (signals[COMMAND, first + sample] - command) * share
        load = load_end
        before, part = between(sample - delay * rate, samples)
        at = first + before
        load_end = signals[LOAD, at] + part * (signals[LOAD, at + 1] - signals[LOAD, at])
        d_load = (load_end - load) * share
        total = 0.0
        energy = 0.0
        for j in range(substeps):
            now, p_mean = monitor_step(
                now,
                command + (j + 0.5) * d_command,
                c.load_gain * (load + (j + 0.5) * d_load) + c.load_offset,
                fault,
                pairs,
                c,
                dt,
            )
            total += now.i
            energy += p_mean
        x = total * share
        x = abs(x) if rectify else x
        y, z1, z2 = biquad(x, z1, z2, low_pass)
        error = signals[TARGET, first + sample] - y
        cost += signals[WEIGHT, first + sample] * error * error
        p_filtered, y1, y2 = biquad(energy * share, y1, y2, low_pass)
        if kept > 0 and sample % stride == 0:
            response[sample // stride, n] = y
            if with_power:
                watts[sample // stride, n] = p_filtered
    costs[n] = cost if math.isfinite(cost) else math.inf


@cuda.jit
def monitor_scores_by_thread(k, constants, which, signals, numbers, costs, response, watts):
    """Score candidate n in thread n on its stretch ``which[n]``.

    Arguments as in `score_candidate`; ``constants`` (35, T) and ``which`` (T,) of each candidate.
    """
    n = cuda.grid(1)
    if n < costs.size:
        score_candidate(
            n, which[n], k, _constants(constants, n), signals, numbers, costs, response, watts
        )


def _teach_floor() -> None:
    """Tell numba-cuda what ``np.floor`` is: 0.30 types it but cannot lower it."""
    from numba.cuda import libdevice, types, typing
    from numba.cuda.extending import lower_builtin

    @lower_builtin(np.floor, types.float64)
    def floor(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        same = typing.signature(types.float64, types.float64)
        return context.get_function(libdevice.floor, same)(builder, arguments)


if not vars(config)["ENABLE_CUDASIM"]:  # the simulator calls numpy itself
    _teach_floor()
