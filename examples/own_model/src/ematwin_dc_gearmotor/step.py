"""One step of the twin; `traces` runs it over time, many candidates side by side.

All on the motor shaft: an output angle times the gear ratio N, a torque on the output over N, an
inertia of the output over N squared. R, L, K are resistance, inductance and torque constant.

    w_ref = clip(k_position (N command - theta), w_max)    position loop, encoder on the motor
    i_ref = clip(k_speed (w_ref - w), i_max)               speed loop
    u     = clip(R i_ref + K w + L (i_ref - i)/dt, V)      current regulator
    L di/dt = u - R i - K w                                armature
    J dw/dt = K i - b w - F - load                         motor and output together
    output  = play(theta)                                  backlash

The regulator brings the current to its reference within a step, as far as the supply allows; real
ones take some 0.1 ms. F is Borello's dry friction, and the play that of a light output which stays
where it was pushed (both in `ematwin.numerics`): inertia, friction and load of the output act on
the motor also while it crosses the gap. Armature and loops are textbook, such as Krishnan (2001),
Electric Motor Drives, Prentice Hall.
"""

from typing import NamedTuple

from ematwin.numerics.backlash import play
from ematwin.numerics.compile import step
from ematwin.numerics.friction import advance_speed
from ematwin.numerics.lanes import Traces
from ematwin.numerics.scalar import clip


class Constants(NamedTuple):
    """What the equations take, on the motor shaft."""

    resistance: float  # ohm
    inductance: float  # H
    torque_constant: float  # N m/A
    inertia: float  # kg m^2
    viscous_damping: float  # N m s/rad
    friction: float  # N m, in motion
    static_friction: float  # N m, at rest
    load: float  # N m
    half_gap: float  # rad
    ratio: float
    supply_voltage: float  # V
    current_limit: float  # A
    speed_limit: float  # rad/s
    position_gain: float  # 1/s
    speed_gain: float  # A s/rad
    share: float  # of a step in the sampling interval


class State(NamedTuple):
    """State of one candidate, on the motor shaft."""

    current: float  # A
    w: float  # rad/s
    theta: float  # rad
    output: float  # rad
    mean_voltage: float  # V, since the last sample
    mean_current: float  # A


class Answer(NamedTuple):
    """What is seen of a candidate at a sample; voltage and current are means."""

    voltage: float  # V
    current: float  # A
    position: float  # rad, output


@step
def servo_step(now, command, load, c, dt):
    """Advance by ``dt``; there is no load over time."""
    w_ref = c.position_gain * (c.ratio * command - now.theta)
    w_ref = clip(w_ref, -c.speed_limit, c.speed_limit)
    i_ref = clip(c.speed_gain * (w_ref - now.w), -c.current_limit, c.current_limit)
    emf = c.torque_constant * now.w
    u = c.resistance * i_ref + emf + c.inductance * (i_ref - now.current) / dt
    u = clip(u, -c.supply_voltage, c.supply_voltage)
    # implicit Euler: stable however short L/R is
    current = (c.inductance * now.current + dt * (u - emf)) / (c.inductance + dt * c.resistance)
    act = c.torque_constant * current - c.viscous_damping * now.w - c.load
    w = advance_speed(now.w, act, c.inertia, c.static_friction, c.friction, dt)
    theta = now.theta + dt * w
    return State(
        current, w, theta, play(theta, now.output, c.half_gap),
        now.mean_voltage + c.share * u, now.mean_current + c.share * current,
    )  # fmt: skip


@step
def seen(now, command, load, sample, c, interval):
    """The state, from which new means begin, and what the sensors show."""
    answer = Answer(now.mean_voltage, now.mean_current, now.output / c.ratio)
    return State(now.current, now.w, now.theta, now.output, 0.0, 0.0), answer


@step
def at_rest(command, c):
    """The state at rest at a position of the output (rad), amid the play."""
    return State(0.0, 0.0, c.ratio * command, c.ratio * command, 0.0, 0.0)


traces = Traces(Constants, State, Answer, seen, servo_step)
