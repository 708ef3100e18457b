"""One candidate from the first sample to the last: what one thread of a GPU does.

The physics is that of `monitor_step`, the bookkeeping that of the lanes of `monitor_scores`: the
same sums in the same order. A plain function, so that numba-cuda compiles it for a device, its
simulator interprets it, and numba compiles it for the processor, where tests compare it with the
lanes. A thread takes any candidate on any stretch, so that one launch may hold many of both.
"""

import math

from ematwin.models.bldc.batch import DIVERGED, OK, between
from ematwin.models.bldc.monitor_step import MonitorState, monitor_step
from ematwin.models.bldc.pairs import pairs_of
from ematwin.models.bldc.state import fault_state

# Rows of the signals, a column for each sample.
COMMAND, LOAD, TARGET, WEIGHT = range(4)
# Columns of the numbers of a stretch: `MonitorState`; b0 b1 b2 a1 a2 z1 z2 of the low-pass; its
# state for the power at the start; the step in s.
STATE, TAPS, POWER, STEP = 0, 7, 14, 16
# Columns of the counts of a stretch: its first column of the signals, its samples, steps from one
# sample to the next, whether magnitudes are compared, samples kept, whether of the power as well.
FIRST, SAMPLES, SUBSTEPS, RECTIFY, KEPT, WITH_POWER = range(6)


def score_candidate(
    n, stretch, k, c, signals, numbers, counts, costs, status, response, watts
):  # fmt: skip
    """Simulate and score candidate ``n`` on a stretch.

    Parameters
    ----------
    n, stretch : int
    k : (8, B) array, fault vectors
    c : Constants of this candidate
    signals : (4, S) array, stretches one after another: command (rad) and load (N m) on the motor
        shaft, filtered current of the record (A), weights
    numbers : (R, 17) array, of each stretch
    counts : (R, 6) integer array, of each stretch
    costs : (B,) array, filled with sum(weight (target - filtered current)^2)
    status : (B,) integer array, filled with `OK` or `DIVERGED` (cost infinite)
    response : (K, B) array, filled with every ceil(samples/kept)-th filtered current, A
    watts : (K, B) array, filled likewise with the filtered electrical power, W
    """
    first = counts[stretch, FIRST]
    samples = counts[stretch, SAMPLES]
    substeps = counts[stretch, SUBSTEPS]
    rectify = counts[stretch, RECTIFY] != 0
    kept = counts[stretch, KEPT]
    stride = (samples + kept - 1) // max(kept, 1)
    with_power = counts[stretch, WITH_POWER] != 0
    b0, b1, b2 = numbers[stretch, TAPS], numbers[stretch, TAPS + 1], numbers[stretch, TAPS + 2]
    a1, a2 = numbers[stretch, TAPS + 3], numbers[stretch, TAPS + 4]
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
        y = b0 * x + z1  # direct form II transposed
        z1 = b1 * x - a1 * y + z2
        z2 = b2 * x - a2 * y
        error = signals[TARGET, first + sample] - y
        cost += signals[WEIGHT, first + sample] * error * error
        p = energy * share
        p_filtered = b0 * p + y1
        y1 = b1 * p - a1 * p_filtered + y2
        y2 = b2 * p - a2 * p_filtered
        if kept > 0 and sample % stride == 0:
            response[sample // stride, n] = y
            if with_power:
                watts[sample // stride, n] = p_filtered
    finite = math.isfinite(cost)
    costs[n] = cost if finite else math.inf
    status[n] = OK if finite else DIVERGED
