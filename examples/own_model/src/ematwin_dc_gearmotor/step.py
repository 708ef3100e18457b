"""One step of the twin, and the loop over time and candidates.

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

import numpy as np

from ematwin.numerics.backlash import play
from ematwin.numerics.compile import loop, step
from ematwin.numerics.friction import advance_speed
from ematwin.numerics.scalar import clip


class Constants(NamedTuple):
    """What the equations take, on the motor shaft; (B,) arrays for a batch of candidates."""

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


class State(NamedTuple):
    """State of one candidate, on the motor shaft."""

    current: float  # A
    w: float  # rad/s
    theta: float  # rad
    output: float  # rad


@step
def of_candidate(c, n):
    """The constants of candidate ``n``."""
    return Constants(
        c.resistance[n], c.inductance[n], c.torque_constant[n], c.inertia[n],
        c.viscous_damping[n], c.friction[n], c.static_friction[n], c.load[n], c.half_gap[n],
        c.ratio[n], c.supply_voltage[n], c.current_limit[n], c.speed_limit[n],
        c.position_gain[n], c.speed_gain[n],
    )  # fmt: skip


@step
def servo_step(now, command, c, dt):
    """Advance by ``dt``; gives the next state and the terminal voltage."""
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
    return State(current, w, theta, play(theta, now.output, c.half_gap)), u


@loop
def traces(constants, command, start, interval, substeps):
    """Simulate a batch of candidates.

    Parameters
    ----------
    constants : Constants of (B,) arrays
    command : (S,) array, rad on the output, straight lines between samples
    start : float, rad, position of the output at the first sample, at rest amid the play
    interval : float, s, from one sample to the next
    substeps : int, steps from one sample to the next

    Returns
    -------
    voltage, current, position : (B, S) arrays, V, A, rad on the output
        Voltage and current are means over the interval that ends at the sample.
    """
    count, samples = constants.ratio.size, command.size
    voltage = np.zeros((count, samples))
    current = np.zeros((count, samples))
    position = np.full((count, samples), start)
    dt = interval / substeps
    for n in range(count):
        c = of_candidate(constants, n)
        now = State(0.0, 0.0, c.ratio * start, c.ratio * start)
        for sample in range(1, samples):
            d_command = (command[sample] - command[sample - 1]) / substeps
            for j in range(substeps):
                now, u = servo_step(now, command[sample - 1] + j * d_command, c, dt)
                voltage[n, sample] += u / substeps
                current[n, sample] += now.current / substeps
            position[n, sample] = now.output / c.ratio
    return voltage, current, position
