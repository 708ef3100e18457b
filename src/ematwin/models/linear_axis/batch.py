"""Loop over time and candidates of a linear axis, candidates side by side in lanes."""

import math

import numpy as np

from ematwin.models.linear_axis.constants import AxisConstants
from ematwin.models.linear_axis.step import AxisState, axis_step, lag_of
from ematwin.numerics.compile import loop, step, wide_vectors
from ematwin.numerics.scalar import clip
from ematwin.numerics.vectors import doubles_in_a_vector

LANES = 2 * doubles_in_a_vector()  # candidates side by side: two vectors


@step
def lane(own, n):
    """The constants of one lane, from a (13, LANES) array."""
    return AxisConstants(
        own[0, n], own[1, n], own[2, n], own[3, n], own[4, n], own[5, n], own[6, n], own[7, n],
        own[8, n], own[9, n], own[10, n], own[11, n], own[12, n],
    )  # fmt: skip


@step
def controller_output(reference, x, x_2, pulse, interval, c):
    """Output of the sampled controller, V.

    k_v (k_p (q_ref - q) - dq_f/dt), q_f the mean of the last two samples, so that its difference
    spans two intervals; then the pulse, then the limit.
    """
    output = c.k_velocity * (c.k_position * (reference - x) - (x - x_2) * (0.5 / interval)) + pulse
    return clip(output, -c.limit, c.limit)


@loop(interleave=2)
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
    own = np.empty((constants.shape[1], LANES))
    decay = np.empty(LANES)
    lagging = np.empty(LANES)
    x = np.empty(LANES)
    v = np.empty(LANES)
    u = np.empty(LANES)
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
            x[n] = start[who, 0] + nothing  # a NaN anywhere must show
            v[n] = start[who, 1] + nothing
            u[n] = start[who, 2] + nothing
            # it came at the same speed
            x_1[n] = x[n] - interval * v[n]
            x_2[n] = x[n] - 2.0 * interval * v[n]
        for sample in range(samples):
            for n in range(LANES):
                driven = command[sample]
                if closed:
                    driven = controller_output(
                        command[sample], x[n], x_2[n], pulses[sample], interval, lane(own, n)
                    )
                output[n] = driven
                x_2[n] = x_1[n]
                x_1[n] = x[n]
            for n in range(inside):
                bad = not math.isfinite(x[n])
                voltage[first + n, sample] = math.nan if bad else output[n]
                position[first + n, sample] = math.nan if bad else x[n]
            for _ in range(substeps):
                for n in range(LANES):
                    now = axis_step(
                        AxisState(x[n], v[n], u[n]), output[n], decay[n], lagging[n],
                        lane(own, n), dt,
                    )  # fmt: skip
                    x[n] = now.x
                    v[n] = now.v
                    u[n] = now.u
