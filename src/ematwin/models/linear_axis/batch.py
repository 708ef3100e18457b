"""Loop over time and candidates of a linear axis, candidates side by side in lanes."""

import math

import numpy as np

from ematwin.models.linear_axis.constants import AxisConstants
from ematwin.models.linear_axis.step import AxisState, axis_step, lag_of
from ematwin.numerics.compile import step
from ematwin.numerics.lanes import LANES, columns, lane_loop, wide_vectors
from ematwin.numerics.scalar import clip

new_constants, lane, _ = columns(AxisConstants)
new_state, read_state, write_state = columns(AxisState)


@step
def controller_output(reference, x, x_2, pulse, interval, c):
    """Output of the sampled controller, V.

    k_v (k_p (q_ref - q) - dq_f/dt), q_f the mean of the last two samples, so that its difference
    spans two intervals; then the pulse, then the limit.
    """
    output = c.k_velocity * (c.k_position * (reference - x) - (x - x_2) * (0.5 / interval)) + pulse
    return clip(output, -c.limit, c.limit)


@lane_loop
def axis_traces(command, pulses, closed, start, constants, interval, substeps, voltage, position):
    """Simulate a batch of candidates.

    Parameters
    ----------
    command : (S,) array, the reference in m where ``closed``, else the voltage in V
    pulses : (S,) array, V, added to the controller's output
    closed : bool, whether the controller drives
    start : (B, 3) array, position (m), speed (m/s) and lagging voltage (V) at the first sample
    constants : (B, 13) array, columns as in `AxisConstants`
    interval : float, s, from one sample to the next, which is also the controller's
    substeps : int, steps from one sample to the next
    voltage, position : (B, S) arrays, filled with what holds at each sample; NaN for a candidate
        with a constant that is not finite, and from the sample on at which one leaves the finite
        numbers
    """
    wide_vectors()
    batch, samples = constants.shape[0], command.size
    dt = interval / substeps
    own = new_constants()
    decay = np.empty(LANES)
    lagging = np.empty(LANES)
    state = new_state()
    x_1 = np.empty(LANES)
    x_2 = np.empty(LANES)
    output = np.empty(LANES)
    for first in range(0, batch, LANES):
        inside = min(LANES, batch - first)
        for n in range(LANES):
            who = first + min(n, inside - 1)  # the last one fills the lanes of a block
            nothing = 0.0
            for m in range(constants.shape[1]):
                own[m, n] = constants[who, m]
                nothing += 0.0 * own[m, n]
            decay[n], lagging[n] = lag_of(lane(own, n).per_lag, dt)
            for m in range(3):
                state[m, n] = start[who, m] + nothing  # a NaN anywhere must show
            # it came at the same speed
            x_1[n] = state[0, n] - interval * state[1, n]
            x_2[n] = state[0, n] - 2.0 * interval * state[1, n]
        for sample in range(samples):
            for n in range(LANES):
                driven = command[sample]
                x = state[0, n]
                if closed:
                    driven = controller_output(
                        command[sample], x, x_2[n], pulses[sample], interval, lane(own, n)
                    )
                output[n] = driven
                x_2[n] = x_1[n]
                x_1[n] = x
            for n in range(inside):
                bad = not math.isfinite(state[0, n])
                voltage[first + n, sample] = math.nan if bad else output[n]
                position[first + n, sample] = math.nan if bad else state[0, n]
            for _ in range(substeps):
                for n in range(LANES):
                    now = axis_step(
                        read_state(state, n), output[n], decay[n], lagging[n], lane(own, n), dt
                    )
                    write_state(state, n, now)
