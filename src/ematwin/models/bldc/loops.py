"""Sampled loops of the reference model: speed and current, each with an integral term, and late.

docs/models.md, "Truer forms": textbook PI controllers with zero-order hold, and encoders. A sample
time of zero is the continuous loop, each step a sample.
"""

from typing import Any

import numpy as np

from ematwin.models.bldc.state import Truer, TruerState
from ematwin.numerics.compile import part, plain
from ematwin.numerics.scalar import clip

_SOON = 0.499  # of a step: a sample belongs to the nearest one


@part
def read_angle(theta, size, offset):
    """Angle that an encoder with steps of ``size`` (rad) shows; as it is where that is 0."""
    some = size if size > 0.0 else 1.0
    shown = some * (np.floor(theta / some + offset) + 0.5 - offset)
    return shown if size > 0.0 else theta


@part
def last_reading(truer, theta_m, w_m):
    """Angle (rad) read a sample time ago by the encoder of a motor that turns at ``w_m``."""
    return read_angle(theta_m - truer.sample_time * w_m, truer.motor_step, truer.count_offset)


def started(
    truer: Truer, motor: Any, current: float, theta_m: float, w_m: float,
    first_sample: float = 0.0, integral: float = 0.0,
) -> TruerState:  # fmt: skip
    """State of loops that have held a current (A) in a motor (rad) that turns at ``w_m``.

    The integral term of the speed loop has asked for ``integral`` (A) of it. Both loops sample
    ``first_sample`` seconds from now, and at their intervals before and after.
    """
    voltage = motor.resistance * current + 2.0 * motor.emf_constant * w_m
    return TruerState(
        asked=current, pending=current, integral=2.0 * motor.emf_constant * integral,
        voltage=voltage, voltage_pending=voltage, voltage_integral=voltage,
        read=plain(last_reading)(truer, theta_m, w_m), speed_seen=w_m,
        wait=first_sample % truer.sample_time if truer.sample_time > 0.0 else 0.0,
        voltage_wait=first_sample % truer.current_sample,
    )  # fmt: skip


@part
def advance_speed_loop(
    asked, pending, integral, wait, late, read, speed_seen,
    command, theta_m, theta_o, w_m, gain, c, truer, dt,
):  # fmt: skip
    """The loop over a step: its first seven arguments afterwards.

    ``asked`` is in A, ``wait`` the time until the next sample, ``late`` until ``pending`` is asked
    for, s; ``read`` and ``speed_seen`` are of the encoder; ``gain`` of the position loop in 1/s.
    """
    soon = _SOON * dt
    asked = pending if late <= soon else asked
    span = truer.sample_time if truer.sample_time > 0.0 else dt
    due = wait <= soon
    now = read_angle(theta_m, truer.motor_step, truer.count_offset)
    counted = speed_seen + truer.filter_share * ((now - read) / span - speed_seen)
    behind = command - read_angle(theta_o, truer.output_step, truer.count_offset)
    speed = counted if truer.motor_step > 0.0 else w_m
    error = clip(gain * behind, -c.w_max, c.w_max) - speed
    grown = integral + truer.integral_gain * span * error
    wish = c.k_demand * error + grown / (2.0 * c.k_e)
    beyond = (abs(wish) > c.i_max) & (wish * error > 0.0)
    pending = wish if due else pending
    read = now if due else read
    speed_seen = counted if due else speed_seen
    integral = integral if beyond | (not due) else grown
    late = truer.delay if due else late
    wait = wait + span if due else wait
    asked = pending if late <= soon else asked
    return asked, pending, integral, wait - dt, late - dt, read, speed_seen


@part
def advance_current_loop(
    voltage, pending, integral, wait, late, i_ref, i_seen, supply, truer, dt
):  # fmt: skip
    """The loop over a step: ``voltage``, ``pending``, ``integral`` (V), ``wait``, ``late`` after.

    ``wait`` is the time until the next sample, ``late`` until ``pending`` is applied, s.
    """
    soon = _SOON * dt
    voltage = pending if late <= soon else voltage
    error = i_ref - i_seen
    wish = truer.current_gain * error + integral
    within = clip(wish, -supply, supply)
    grows = (within == wish) | ((wish - within) * error < 0.0)
    grown = integral + truer.current_integral * truer.current_sample * error
    due = wait <= soon
    pending = within if due else pending
    integral = grown if due & grows else integral
    late = truer.current_delay if due else late
    wait = wait + truer.current_sample if due else wait
    voltage = pending if late <= soon else voltage
    return voltage, pending, integral, wait - dt, late - dt


@part
def left_of_voltage(voltage, i, truer):
    """Voltage across the pair after what dead time and switches take, V.

    Below 0.1 A dead time takes less, as the ripple changes the sign of the current.
    """
    return voltage - truer.lost_voltage * clip(i / 0.1, -1.0, 1.0)
