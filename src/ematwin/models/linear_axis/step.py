"""One step of a linear axis: force by voltage, mass, friction that differs by direction.

docs/linear-axis.md. At the carriage, SI:

    T_d du/dt = c - u                                   the force follows the voltage c with a lag
    M dv/dt = g u - F_0 - F(v)
    F(v) = +-C [1 + (kappa - 1) / (1 + (v/v_s)^2)] + B v      C and B each differ by direction

The dry part is Coulomb friction that changes towards standstill: the rational form of Hess and Soom
(1990), J. Tribology 112, 147-152. With kappa > 1 it is Stribeck's; with kappa < 1 friction builds
up with speed. At rest, friction holds any force up to kappa C.
"""

import math
from typing import NamedTuple

from ematwin.numerics.compile import step


class AxisState(NamedTuple):
    """State of the model."""

    x: float  # m
    v: float  # m/s
    u: float  # V, what the force follows


@step
def friction_force(v, forward, c):
    """Friction force at a speed whose direction is known, N, positive against positive motion."""
    ratio = v * c.per_fading
    rising = 1.0 + c.standstill / (1.0 + ratio * ratio)
    dry = c.dry_forward if forward else -c.dry_backward
    viscous = c.viscous_forward if forward else c.viscous_backward
    return dry * rising + viscous * v


@step
def from_rest(push, time, c):
    """Speed after some time from rest under a constant force: none if friction holds it."""
    forward = push > 0.0
    left = push - friction_force(0.0, forward, c)
    loose = left > 0.0 if forward else left < 0.0
    return time * c.mobility * left if loose else 0.0 * left  # NaN stays NaN


@step
def axis_step(state, voltage, decay, lagging, c, dt):
    """Advance by ``dt`` under a constant voltage.

    ``decay`` is exp(-dt/T_d), ``lagging`` the mean of exp(-t/T_d) over the step. Midpoint rule;
    where the carriage turns, it goes on from rest for what is left of the step.
    """
    gap = state.u - voltage
    push = c.gain * (voltage + gap * lagging) - c.offset
    v = state.v
    rest = v == 0.0
    forward = v > 0.0
    v_mid = v + 0.5 * dt * c.mobility * (push - friction_force(v, forward, c))
    v_mid = 0.0 if v * v_mid < 0.0 else v_mid  # friction of this direction down to rest
    v_run = v + dt * c.mobility * (push - friction_force(v_mid, forward, c))
    turns = v * v_run < 0.0
    share = v / (v - v_run) if turns else 1.0
    share = 0.0 if rest else share  # of the step until rest
    left = (1.0 - share) * dt
    v_loose = from_rest(push, left, c)
    stops = rest | turns
    x = state.x + 0.5 * dt * share * v + 0.5 * (left * v_loose if stops else dt * v_run)
    return AxisState(x, v_loose if stops else v_run, voltage + gap * decay)


@step
def lag_of(per_lag, dt):
    """exp(-dt/T_d), and the mean of exp(-t/T_d) from 0 to dt."""
    decay = math.exp(-dt * per_lag)
    return decay, (1.0 - decay) / (dt * per_lag)
