"""Loop over time and candidates of the ball-screw actuator."""

import math

import numpy as np

from ematwin.models.ball_screw.constants import BallScrewConstants
from ematwin.models.ball_screw.step import BallScrewState, ball_screw_step
from ematwin.numerics.compile import loop


@loop
def ball_screw_traces(magnitudes, set_point, interval, constants, substeps, update_every):
    """Simulate a batch of candidates.

    Parameters
    ----------
    magnitudes : (B, 5) array: factor on friction, backlash (m), factor on both gains, load that
        pushes in the positive sense (N), position error at the first sample (m)
    set_point : (S,) array, m, straight lines between samples
    interval : float, s, from one sample to the next
    constants : (B, 12) array, columns as in `BallScrewConstants`; (1, 12) where all candidates
        share them
    substeps : int, steps from one sample to the next
    update_every : int, steps from one update of the position loop to the next

    Returns
    -------
    current : (B, S) array, A, mean over the interval that ends at the sample
    position_error : (B, S) array, m; both are NaN for a candidate with a magnitude or constant that
        is not finite, and from the sample on at which a simulation leaves the finite numbers
    """
    batch, samples = magnitudes.shape[0], set_point.size
    current = np.empty((batch, samples))
    position_error = np.empty((batch, samples))
    dt = interval / substeps
    for n in range(batch):
        k = constants[n if constants.shape[0] > 1 else 0]
        # a play of NaN would leave the nut where it is
        if not math.isfinite(magnitudes[n].sum() + k.sum()):
            current[n], position_error[n] = math.nan, math.nan
            continue
        c = BallScrewConstants(
            k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], k[10], k[11]
        )
        friction = magnitudes[n, 0] * c.friction
        half_gap = 0.5 * magnitudes[n, 1] / c.per_radian
        gain = magnitudes[n, 2]
        load = magnitudes[n, 3] * c.per_radian
        # at rest, the nut in the middle of its play
        start = (set_point[0] - magnitudes[n, 4]) / c.per_radian
        now = BallScrewState(0.0, start, start, 0.0)
        w_ref = 0.0
        count = 0
        current[n, 0] = c.i_idle
        position_error[n, 0] = magnitudes[n, 4]
        for sample in range(1, samples):
            total = 0.0
            d_set_point = (set_point[sample] - set_point[sample - 1]) / substeps
            for j in range(substeps):
                if count % update_every == 0:
                    error = set_point[sample - 1] + j * d_set_point - c.per_radian * now.nut
                    integral = now.integral + error * update_every * dt
                    now = BallScrewState(now.w, now.theta, now.nut, integral)
                    w_ref = gain * (c.k_position * error + c.k_integral * integral) / c.per_radian
                count += 1
                now, i = ball_screw_step(now, w_ref, load, friction, half_gap, c, dt)
                total += i
            current[n, sample] = total / substeps
            position_error[n, sample] = set_point[sample] - c.per_radian * now.nut
            if not math.isfinite(position_error[n, sample]):
                current[n, sample:] = math.nan
                position_error[n, sample:] = math.nan
                break
    return current, position_error
