"""One step of the reference model: sampled loops, bridge, three phases, two masses, about 1 us.

docs/models.md, "Reference model" and "Truer forms". The loops are textbook PI controllers with
zero-order hold; a sample time of zero is the continuous loop, each step a sample. Angles, speeds,
torques and inertias are on the motor shaft; the output is reflected to it by the gear ratio.
`ReferenceState` is advanced by semi-implicit Euler.

One step holds all truer forms. The constants of a form that is left out (the defaults of `Truer`)
make it vanish, and branches on them skip sines and loops without effect. An actuator without forms
is simulated 10 % slower than by a separate step.

No lanes run it, so that LLVM alone inlines its larger parts (`part`). With numba inlining them it
took nearly three times as long to compile, and gave the same results at the same speed.
"""

from typing import Any, NamedTuple

import numpy as np

from ematwin.models.bldc.constants import Truer, TruerState
from ematwin.models.bldc.inverter import (
    Electrical,
    Supply,
    advance_bridge,
    advance_shorted_bridge,
    dot,
    gate_signals,
    hysteresis,
    pair_current,
    phase_constants,
)
from ematwin.models.bldc.motor import (
    hall_sector,
    split_shorts,
    torque_of_cogging,
    truer_emf_constants,
)
from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import part, plain, step
from ematwin.numerics.friction import (
    advance_mobile,
    advance_on_bristles,
    dithered_static,
    fading,
    loaded_friction,
    sliding_torque,
)
from ematwin.numerics.scalar import clip, lag

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
    before = theta_m - truer.speed_loop_sample_time * w_m
    return read_angle(before, truer.motor_step, truer.count_offset)


def started(
    truer: Truer, motor: Any, current: float, theta_m: float, w_m: float,
    first_sample: float = 0.0, integral: float = 0.0,
) -> TruerState:  # fmt: skip
    """State of loops that have held a current (A) in a motor (rad) that turns at ``w_m``.

    The integral term of the speed loop has asked for ``integral`` (A) of it. Both loops sample
    ``first_sample`` seconds from now, and at their intervals before and after.
    """
    voltage = motor.resistance * current + 2.0 * motor.emf_constant * w_m
    sampled = truer.speed_loop_sample_time > 0.0
    return TruerState(
        asked=current, pending=current, integral=2.0 * motor.emf_constant * integral,
        voltage=voltage, voltage_pending=voltage, voltage_integral=voltage,
        read=plain(last_reading)(truer, theta_m, w_m), speed_seen=w_m,
        wait=first_sample % truer.speed_loop_sample_time if sampled else 0.0,
        voltage_wait=first_sample % truer.current_loop_sample_time,
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
    span = truer.speed_loop_sample_time if truer.speed_loop_sample_time > 0.0 else dt
    due = wait <= soon
    now = read_angle(theta_m, truer.motor_step, truer.count_offset)
    counted = speed_seen + truer.filter_share * ((now - read) / span - speed_seen)
    behind = command - read_angle(theta_o, truer.output_step, truer.count_offset)
    speed = counted if truer.motor_step > 0.0 else w_m
    error = clip(gain * behind, -c.w_max, c.w_max) - speed
    grown = integral + truer.speed_loop_integral_gain * span * error
    wish = c.k_demand * error + grown / (2.0 * c.k_e)
    beyond = (abs(wish) > c.i_max) & (wish * error > 0.0)
    pending = wish if due else pending
    read = now if due else read
    speed_seen = counted if due else speed_seen
    integral = integral if beyond | (not due) else grown
    late = truer.speed_loop_delay if due else late
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
    wish = truer.current_loop_proportional_gain * error + integral
    within = clip(wish, -supply, supply)
    grows = (within == wish) | ((wish - within) * error < 0.0)
    grown = integral + truer.current_loop_integral_gain * truer.current_loop_sample_time * error
    due = wait <= soon
    pending = within if due else pending
    integral = grown if due & grows else integral
    late = truer.current_loop_delay if due else late
    wait = wait + truer.current_loop_sample_time if due else wait
    voltage = pending if late <= soon else voltage
    return voltage, pending, integral, wait - dt, late - dt


@part
def left_of_voltage(voltage, i, truer):
    """Voltage across the pair after what dead time and switches take, V."""
    # below 0.1 A dead time takes less, as the ripple changes the sign of the current
    return voltage - truer.current_loop_lost_voltage * clip(i / 0.1, -1.0, 1.0)


class ReferenceState(NamedTuple):
    """State of the reference model, and its energies since the start."""

    i_a: float  # A
    i_b: float
    i_c: float
    w_m: float  # rad/s
    theta_m: float  # rad
    w_o: float
    theta_o: float
    pair_sign: float  # of the hysteresis comparator
    e_electrical: float  # J, taken from the supply side of the phases
    e_copper: float  # J, lost in the resistances
    e_mechanical: float  # J, air-gap torque times speed
    bent_m: float  # rad, of the bristles between motor and housing
    bent_o: float


class Driven(NamedTuple):
    """What controller, bridge and windings do over a step."""

    i: tuple[float, float, float]  # A, of the phases at its end
    more: TruerState  # at its end
    means: tuple[float, float, float]  # A, of the phases
    torque: float  # N m, of the air gap
    taken: float  # J
    lost: float  # J
    pair_sign: float
    supply: Supply


@part
def all_emf_constants(theta_m, fault, c, truer):
    """kappa_k of the three phases, V s/rad, shorted turns that are loops among their turns."""
    h, _ = split_shorts(fault, truer.loops)
    return truer_emf_constants(theta_m, h, fault, c, truer)


@part
def drive(state, more, command, kappas, fault, c, truer, dt):
    """Controller, bridge and windings over ``dt``; the rotor moves as ``state`` says."""
    h, mu = split_shorts(fault, truer.loops)
    i = state.i_a, state.i_b, state.i_c
    sector = hall_sector(c.pole_pairs * state.theta_m)

    asked = advance_speed_loop(
        more.asked, more.pending, more.integral, more.wait, more.late, more.read, more.speed_seen,
        command, state.theta_m, state.theta_o, state.w_m, c.k_position * fault.gain, c, truer, dt,
    )  # fmt: skip
    i_ref = clip(asked[0], -c.i_max, c.i_max)
    i_seen = pair_current(sector, i[0], i[1], i[2])
    pair_sign = hysteresis(i_seen, i_ref, c.half_band, state.pair_sign)
    pair = gate_signals(sector, 1.0)
    now = Electrical(
        (1.0 + more.warmer) * c.resistance, c.inductance, c.leakage, c.short_resistance,
        c.v_supply - more.sagged, c.v_diode,
    )  # fmt: skip
    i_pair = 0.5 * dot(pair, i)
    voltage = advance_current_loop(
        more.voltage, more.voltage_pending, more.voltage_integral, more.voltage_wait,
        more.voltage_late, i_ref, i_pair, now.v_supply, truer, dt,
    )  # fmt: skip
    modulated = left_of_voltage(voltage[0], i_pair, truer) / now.v_supply
    share = modulated if truer.current_loop_proportional_gain > 0.0 else pair_sign
    share = 1e-12 if share == 0.0 else share  # 0 would mean that a leg is off
    g = pair[0] * share, pair[1] * share, pair[2] * share

    e = kappas[0] * state.w_m, kappas[1] * state.w_m, kappas[2] * state.w_m
    if truer.loops == 0.0:
        after, m, taken, lost, supply = advance_bridge(i, e, g, phase_constants(h, now), now, dt)
        loops = mean = 0.0, 0.0, 0.0
    else:
        before = more.loop_a, more.loop_b, more.loop_c
        after, loops, m, mean, taken, lost, supply = advance_shorted_bridge(
            i, before, e, g, h, mu, now, dt
        )
    turned = m[0] - mu[0] * mean[0], m[1] - mu[1] * mean[1], m[2] - mu[2] * mean[2]
    torque = dot(kappas, turned)
    gained = truer.winding_heat_gain_per_watt * lost / dt
    warmer = lag(more.warmer, gained, truer.winding_heat_time_constant, dt)
    sagged = lag(more.sagged, truer.supply_resistance * supply.i_bus, truer.link_time, dt)
    then = TruerState(*(loops + asked + voltage + (warmer, sagged)))
    return Driven(after, then, m, torque, taken, lost, pair_sign, supply)


@part
def move_masses(state, torque, load, fault, c, truer, dt):
    """Speeds and positions after a torque on the motor, and how far bristles are bent, rad."""
    if truer.presliding_motor_stiffness == 0.0:
        return move_sticking(state, torque, 0.0, load, fault, c, dt)
    return move_on_bristles(state, torque, load, fault, c, truer, dt)


@step
def move_sticking(state, torque, ripple, load, fault, c, dt):
    """As `move_masses`, with friction that sticks without giving; a mean torque has a ripple."""
    act_m, act_o, td_m, td_o = _pushed(state, torque, load, fault, c)
    ts_m = dithered_static(c.static_ratio * td_m, td_m, ripple)
    w_m = advance_mobile(state.w_m, act_m, c.mobility_m, ts_m, td_m, dt)
    w_o = advance_mobile(state.w_o, act_o, c.mobility_o, c.static_ratio * td_o, td_o, dt)
    theta_o, w_o = stop_at_ends(state.theta_o + dt * w_o, w_o, c.travel_low, c.travel_high)
    return w_m, state.theta_m + dt * w_m, w_o, theta_o, 0.0, 0.0


@step
def move_on_bristles(state, torque, load, fault, c, truer, dt):
    """As `move_masses`, with friction that gives before it slides."""
    act_m, act_o, td_m, td_o = _pushed(state, torque, load, fault, c)
    fade_m = fading(state.w_m, truer.presliding_stribeck_speed)
    fade_o = fading(state.w_o, truer.presliding_stribeck_speed)
    w_m, bent_m = advance_on_bristles(
        state.w_m, state.bent_m, act_m, c.mobility_m, sliding_torque(td_m, c.static_ratio, fade_m),
        truer.presliding_motor_stiffness, fade_m * truer.presliding_damping, dt,
    )  # fmt: skip
    w_o, bent_o = advance_on_bristles(
        state.w_o, state.bent_o, act_o, c.mobility_o, sliding_torque(td_o, c.static_ratio, fade_o),
        truer.presliding_output_stiffness, fade_o * truer.presliding_damping, dt,
    )  # fmt: skip
    theta_o, w_o = stop_at_ends(state.theta_o + dt * w_o, w_o, c.travel_low, c.travel_high)
    return w_m, state.theta_m + dt * w_m, w_o, theta_o, bent_m, bent_o


@step
def _pushed(state, torque, load, fault, c):
    """Torques on motor and output without friction, and the dynamic friction of both, N m."""
    contact = contact_torque(
        state.theta_m, state.w_m, state.theta_o, state.w_o, fault.half_gap,
        c.contact_stiffness, c.contact_damping,
    )  # fmt: skip
    act_m = torque - c.viscous * state.w_m - contact
    act_o = contact - load
    direction = state.w_o if state.w_o != 0.0 else act_o
    td_m = fault.friction * c.t_m
    td_o = fault.friction * loaded_friction(direction, -load, c.t_o, c.c_opposing, c.c_aiding)
    return act_m, act_o, td_m, td_o


@part
def reference_step(state, more, command, load, fault, c, truer, dt):
    """Advance by ``dt``: state, state of the forms, mean phase currents, and `Supply`."""
    kappas = all_emf_constants(state.theta_m, fault, c, truer)
    driven = drive(state, more, command, kappas, fault, c, truer, dt)
    torque = driven.torque + torque_of_cogging(state.theta_m, truer)
    w_m, theta_m, w_o, theta_o, bent_m, bent_o = move_masses(
        state, torque, load, fault, c, truer, dt
    )
    i_a, i_b, i_c = driven.i
    after = ReferenceState(
        i_a, i_b, i_c, w_m, theta_m, w_o, theta_o, driven.pair_sign,
        state.e_electrical + driven.taken,
        state.e_copper + driven.lost,
        state.e_mechanical + dt * driven.torque * state.w_m,
        bent_m, bent_o,
    )  # fmt: skip
    return after, driven.more, driven.means, driven.supply
