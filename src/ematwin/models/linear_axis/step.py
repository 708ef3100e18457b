"""One step of a linear axis: force by voltage, mass, friction that differs by direction.

docs/linear-axis.md. At the carriage, SI:

    T_d du/dt = c - u                                   the force follows the voltage c with a lag
    M dv/dt = g u - F_0 - F(v)
    F(v) = +-C [1 + (kappa - 1) / (1 + (v/v_s)^2)] + B v      C and B each differ by direction

The dry part is Coulomb friction that changes towards standstill: the rational form of Hess and Soom
(1990), J. Tribology 112, 147-152. With kappa > 1 it is Stribeck's; with kappa < 1 friction builds
up with speed. At rest, friction holds any force up to kappa C.
"""

from typing import NamedTuple

from ematwin.numerics.compile import step
from ematwin.numerics.lanes import Traces
from ematwin.numerics.scalar import clip


class AxisConstants(NamedTuple):
    """Constants of an axis, SI."""

    mobility: float  # 1/kg
    dry_forward: float  # N
    dry_backward: float  # N
    standstill: float  # friction at standstill over Coulomb friction, less 1
    per_fading: float  # s/m
    viscous_forward: float  # N s/m
    viscous_backward: float  # N s/m
    gain: float  # N/V
    offset: float  # N
    decay: float  # exp(-dt/T_d)
    lagging: float  # mean of exp(-t/T_d) over a step
    limit: float  # V
    k_position: float  # 1/s
    k_velocity: float  # V s/m
    closed: float  # 1: the controller drives; 0: the command is the voltage


class AxisState(NamedTuple):
    """State of carriage and controller."""

    x: float  # m
    v: float  # m/s
    u: float  # V, what the force follows
    x_1: float  # m, one sample before
    x_2: float  # m, two samples before
    output: float  # V, held by the controller


class AxisAnswer(NamedTuple):
    """Compared channels at a sample."""

    voltage: float  # V
    position: float  # m


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
def axis_step(now, command, pulse, c, dt):
    """Advance by ``dt`` under the voltage that the controller holds.

    Midpoint rule; where the carriage turns, it goes on from rest for the rest of the step.
    """
    gap = now.u - now.output
    push = c.gain * (now.output + gap * c.lagging) - c.offset
    v = now.v
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
    x = now.x + 0.5 * dt * share * v + 0.5 * (left * v_loose if stops else dt * v_run)
    return AxisState(
        x, v_loose if stops else v_run, now.output + gap * c.decay, now.x_1, now.x_2, now.output
    )


@step
def controlled(now, command, pulse, sample, c, interval):
    """The controller at a sample: `AxisState` with its output, V, and `AxisAnswer`.

    k_v (k_p (q_ref - q) - dq_f/dt), q_f the mean of the last two samples, so that its difference
    spans two intervals; then the pulse, then the limit.
    """
    speed = (now.x - now.x_2) * (0.5 / interval)
    output = c.k_velocity * (c.k_position * (command - now.x) - speed) + pulse
    output = clip(output, -c.limit, c.limit) if c.closed > 0.0 else command
    return AxisState(now.x, now.v, now.u, now.x, now.x_1, output), AxisAnswer(output, now.x)


@step
def axis_at_rest(reference, c):
    """`AxisState` at rest at a reference."""
    return AxisState(reference, 0.0, 0.0, reference, reference, 0.0)


axis_traces = Traces(AxisConstants, AxisState, AxisAnswer, controlled, axis_step)
