"""One step of the reference model: controller, bridge, three phases, two masses, about 1 us.

docs/models.md, "Reference model". Angles, speeds, torques and inertias are on the motor shaft; the
output is reflected to it by the gear ratio. `ReferenceState` is advanced by semi-implicit Euler.

One step holds all truer forms. The constants of a form that is left out (the defaults of `Truer`)
make it vanish, and branches on them skip sines and loops without effect. An actuator without forms
is simulated 10 % slower than by a separate step.

No lanes run it, so that LLVM alone inlines its larger parts (`part`). With numba inlining them it
took nearly three times as long to compile, and gave the same results at the same speed.
"""

from typing import NamedTuple

from ematwin.models.bldc.inverter import (
    Electrical,
    Supply,
    advance_bridge,
    advance_shorted_bridge,
    gate_signals,
    hysteresis,
    pair_current,
    phase_constants,
)
from ematwin.models.bldc.loops import advance_current_loop, advance_speed_loop, left_of_voltage
from ematwin.models.bldc.motor import cogging_torque, hall_sector, split_short, truer_emf_constants
from ematwin.models.bldc.state import TruerState
from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import part
from ematwin.numerics.friction import (
    advance_mobile,
    advance_on_bristles,
    fading,
    loaded_friction,
    sliding_torque,
)
from ematwin.numerics.scalar import clip, lag


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


class Driven(NamedTuple):
    """What controller, bridge and windings do over a step."""

    currents: tuple[float, float, float, float, float, float]  # A, of phases and loops, at its end
    means: tuple[float, float, float]  # A, of the phases
    torque: float  # N m, of the air gap
    taken: float  # J
    lost: float  # J
    pair_sign: float
    asked: tuple[float, float, float, float, float, float, float]  # of `advance_speed_loop`
    voltage: tuple[float, float, float, float, float]  # of `advance_current_loop`
    warmer: float
    sagged: float  # V
    supply: Supply


@part
def all_emf_constants(theta_m, fault, c, truer):
    """kappa_k of the three phases, V s/rad, shorted turns that are loops among their turns."""
    h_a, _ = split_short(fault.h_a, truer.loops)
    h_b, _ = split_short(fault.h_b, truer.loops)
    h_c, _ = split_short(fault.h_c, truer.loops)
    return truer_emf_constants(theta_m, h_a, h_b, h_c, fault, c, truer)


@part
def drive(state, more, command, kappas, fault, c, truer, dt):
    """Controller, bridge and windings over ``dt``; the rotor moves as ``state`` says."""
    h_a, mu_a = split_short(fault.h_a, truer.loops)
    h_b, mu_b = split_short(fault.h_b, truer.loops)
    h_c, mu_c = split_short(fault.h_c, truer.loops)
    kappa_a, kappa_b, kappa_c = kappas
    sector = hall_sector(c.pole_pairs * state.theta_m)

    asked = advance_speed_loop(
        more.asked, more.pending, more.integral, more.wait, more.late, more.read, more.speed_seen,
        command, state.theta_m, state.theta_o, state.w_m, c.k_position * fault.gain, c, truer, dt,
    )  # fmt: skip
    i_ref = clip(asked[0], -c.i_max, c.i_max)
    i_seen = pair_current(sector, state.i_a, state.i_b, state.i_c)
    pair_sign = hysteresis(i_seen, i_ref, c.half_band, state.pair_sign)
    g_a, g_b, g_c = gate_signals(sector, 1.0)
    now = Electrical(
        (1.0 + more.warmer) * c.resistance, c.inductance, c.leakage, c.short_resistance,
        c.v_supply - more.sagged, c.v_diode,
    )  # fmt: skip
    i_pair = 0.5 * (g_a * state.i_a + g_b * state.i_b + g_c * state.i_c)
    voltage = advance_current_loop(
        more.voltage, more.voltage_pending, more.voltage_integral, more.voltage_wait,
        more.voltage_late, i_ref, i_pair, now.v_supply, truer, dt,
    )  # fmt: skip
    modulated = left_of_voltage(voltage[0], i_pair, truer) / now.v_supply
    share = modulated if truer.current_gain > 0.0 else pair_sign
    share = 1e-12 if share == 0.0 else share  # 0 would mean that a leg is off
    g_a, g_b, g_c = g_a * share, g_b * share, g_c * share

    e_a, e_b, e_c = kappa_a * state.w_m, kappa_b * state.w_m, kappa_c * state.w_m
    if truer.loops == 0.0:
        i_a, i_b, i_c, m_a, m_b, m_c, taken, lost, supply = advance_bridge(
            state.i_a, state.i_b, state.i_c, e_a, e_b, e_c, g_a, g_b, g_c,
            phase_constants(h_a, h_b, h_c, now), now, dt,
        )  # fmt: skip
        currents, means = (i_a, i_b, i_c, 0.0, 0.0, 0.0), (m_a, m_b, m_c, 0.0, 0.0, 0.0)
    else:
        currents, means, taken, lost, supply = advance_shorted_bridge(
            state.i_a, state.i_b, state.i_c, more.loop_a, more.loop_b, more.loop_c, e_a, e_b, e_c,
            g_a, g_b, g_c, (h_a, h_b, h_c, mu_a, mu_b, mu_c), now, dt,
        )  # fmt: skip
    m_a, m_b, m_c, mean_a, mean_b, mean_c = means
    torque = (
        kappa_a * (m_a - mu_a * mean_a)
        + kappa_b * (m_b - mu_b * mean_b)
        + kappa_c * (m_c - mu_c * mean_c)
    )
    warmer = lag(more.warmer, truer.heating * lost / dt, truer.heating_time, dt)
    sagged = lag(more.sagged, truer.supply_resistance * supply.i_bus, truer.link_time, dt)
    return Driven(
        currents, (m_a, m_b, m_c), torque, taken, lost, pair_sign, asked, voltage, warmer, sagged,
        supply,
    )  # fmt: skip


@part
def torques_on_masses(state, torque, load, fault, c):
    """Torques but friction on motor and output, and the dynamic friction of both, N m."""
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
def move_masses(state, more, torque, load, fault, c, truer, dt):
    """Speeds and positions ``w_m, theta_m, w_o, theta_o`` after a torque on the motor.

    Also by how much bristles are bent on both sides, rad.
    """
    act_m, act_o, td_m, td_o = torques_on_masses(state, torque, load, fault, c)
    if truer.bristles_m == 0.0:  # friction sticks without giving, which no stiffness comes near
        bent_m, bent_o = 0.0, 0.0
        w_m = advance_mobile(state.w_m, act_m, c.mobility_m, c.static_ratio * td_m, td_m, dt)
        w_o = advance_mobile(state.w_o, act_o, c.mobility_o, c.static_ratio * td_o, td_o, dt)
    else:
        fade_m, fade_o = fading(state.w_m, truer.w_stribeck), fading(state.w_o, truer.w_stribeck)
        w_m, bent_m = advance_on_bristles(
            state.w_m, more.bent_m, act_m, c.mobility_m,
            sliding_torque(td_m, c.static_ratio, fade_m), truer.bristles_m,
            fade_m * truer.bristle_damping, dt,
        )  # fmt: skip
        w_o, bent_o = advance_on_bristles(
            state.w_o, more.bent_o, act_o, c.mobility_o,
            sliding_torque(td_o, c.static_ratio, fade_o), truer.bristles_o,
            fade_o * truer.bristle_damping, dt,
        )  # fmt: skip
    theta_o, w_o = stop_at_ends(state.theta_o + dt * w_o, w_o, c.travel_low, c.travel_high)
    return w_m, state.theta_m + dt * w_m, w_o, theta_o, bent_m, bent_o


@part
def reference_step(state, more, command, load, fault, c, truer, dt):
    """Advance the reference model by ``dt`` under a command (rad) and a load (N m).

    Gives the state, the state of the truer forms, the mean current of each phase within the step,
    and the `Supply`.
    """
    kappas = all_emf_constants(state.theta_m, fault, c, truer)
    driven = drive(state, more, command, kappas, fault, c, truer, dt)
    torque = driven.torque + cogging_torque(state.theta_m, truer)
    w_m, theta_m, w_o, theta_o, bent_m, bent_o = move_masses(
        state, more, torque, load, fault, c, truer, dt
    )
    i_a, i_b, i_c, _, _, _ = driven.currents
    after = ReferenceState(
        i_a, i_b, i_c, w_m, theta_m, w_o, theta_o, driven.pair_sign,
        state.e_electrical + driven.taken,
        state.e_copper + driven.lost,
        state.e_mechanical + dt * driven.torque * state.w_m,
    )  # fmt: skip
    m_a, m_b, m_c = driven.means
    return after, more_after(driven, bent_m, bent_o), m_a, m_b, m_c, driven.supply


@part
def more_after(driven, bent_m, bent_o):
    """State of the truer forms at the end of a step, with bristles bent by so much (rad)."""
    _, _, _, loop_a, loop_b, loop_c = driven.currents
    asked, pending, integral, wait, late, read, speed_seen = driven.asked
    voltage, voltage_pending, voltage_integral, voltage_wait, voltage_late = driven.voltage
    return TruerState(
        loop_a, loop_b, loop_c, asked, pending, integral, wait, late,
        voltage, voltage_pending, voltage_integral, voltage_wait, voltage_late,
        driven.warmer, driven.sagged, bent_m, bent_o, read, speed_seen,
    )  # fmt: skip
