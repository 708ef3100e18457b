"""One step of the reference model: three phases, inverter, two masses, about 1 us.

docs/models.md, "Reference model". Angles, speeds, torques and inertias are on the motor shaft; the
output is reflected to it by the gear ratio. `ReferenceState` is advanced by semi-implicit Euler.

No lanes run it, so that LLVM alone inlines its larger parts (`part`). With numba inlining them it
took nearly three times as long to compile, and gave the same results at the same speed.
"""

from typing import NamedTuple

from ematwin.models.bldc.controller import current_reference
from ematwin.models.bldc.inverter import (
    advance_phase,
    gate_signals,
    hysteresis,
    pair_current,
    share_until_blocked,
    terminal_voltages,
)
from ematwin.models.bldc.motor import emf_constants, hall_sector, phase_inductance
from ematwin.numerics.backlash import contact_torque, stop_at_ends
from ematwin.numerics.compile import part, step
from ematwin.numerics.friction import advance_mobile, loaded_friction
from ematwin.numerics.scalar import clip


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


@step
def phase_constants(fault, c):
    """Resistances, inverse inductances and EMF constants of the phases."""
    return (
        fault.h_a * c.resistance,
        fault.h_b * c.resistance,
        fault.h_c * c.resistance,
        1.0 / phase_inductance(fault.h_a, c.inductance, c.leakage),
        1.0 / phase_inductance(fault.h_b, c.inductance, c.leakage),
        1.0 / phase_inductance(fault.h_c, c.inductance, c.leakage),
    )


class Supply(NamedTuple):
    """Voltages and current of the bridge, means over a step."""

    v_a: float  # V, terminals of the motor above the lower rail
    v_b: float
    v_c: float
    i_bus: float  # A, out of the supply
    v_bus: float  # V


@step
def _conduct(i_a, i_b, i_c, e_a, e_b, e_c, g_a, g_b, g_c, phases, c, dt):
    """Advance the phases until ``dt`` or until the diode of an off leg blocks.

    Gives the share of ``dt`` done, the currents then, the energies taken in and lost, and the
    `Supply` meanwhile.
    """
    r_a, r_b, r_c, y_a, y_b, y_c = phases
    v_a, v_b, v_c, v_n, on_a, on_b, on_c = terminal_voltages(
        g_a, g_b, g_c, i_a, i_b, i_c, e_a, e_b, e_c, r_a, r_b, r_c, y_a, y_b, y_c,
        c.v_supply, c.v_diode,
    )  # fmt: skip
    n_a = advance_phase(i_a, v_a, v_n, e_a, r_a, y_a, on_a, dt)
    n_b = advance_phase(i_b, v_b, v_n, e_b, r_b, y_b, on_b, dt)
    n_c = advance_phase(i_c, v_c, v_n, e_c, r_c, y_c, on_c, dt)
    share_a = share_until_blocked(i_a, n_a, g_a != 0.0)
    share_b = share_until_blocked(i_b, n_b, g_b != 0.0)
    share_c = share_until_blocked(i_c, n_c, g_c != 0.0)
    share = share_a * share_b * share_c  # at most one leg is off
    n_a = i_a + share * (n_a - i_a) if share_a == 1.0 else 0.0
    n_b = i_b + share * (n_b - i_b) if share_b == 1.0 else 0.0
    n_c = i_c + share * (n_c - i_c) if share_c == 1.0 else 0.0
    m_a = 0.5 * (i_a + n_a)
    m_b = 0.5 * (i_b + n_b)
    m_c = 0.5 * (i_c + n_c)
    taken = share * dt * (v_a * m_a + v_b * m_b + v_c * m_c)
    lost = share * dt * (r_a * m_a * m_a + r_b * m_b * m_b + r_c * m_c * m_c)
    # through the upper switches, and back through the upper diodes
    i_bus = (
        m_a * clip(v_a / c.v_supply, 0.0, 1.0)
        + m_b * clip(v_b / c.v_supply, 0.0, 1.0)
        + m_c * clip(v_c / c.v_supply, 0.0, 1.0)
    )
    return share, n_a, n_b, n_c, taken, lost, Supply(v_a, v_b, v_c, i_bus, c.v_supply)


@part
def advance_bridge(i_a, i_b, i_c, e_a, e_b, e_c, g_a, g_b, g_c, phases, c, dt):
    """Phase currents after ``dt``; their means, the energies taken in and lost, the `Supply`."""
    share, n_a, n_b, n_c, taken, lost, supply = _conduct(
        i_a, i_b, i_c, e_a, e_b, e_c, g_a, g_b, g_c, phases, c, dt
    )
    m_a = 0.5 * (i_a + n_a)
    m_b = 0.5 * (i_b + n_b)
    m_c = 0.5 * (i_c + n_c)
    if share < 1.0:  # the rest of the step, with the off leg at zero
        rest = 1.0 - share
        _, p_a, p_b, p_c, more_taken, more_lost, then = _conduct(
            n_a, n_b, n_c, e_a, e_b, e_c, g_a, g_b, g_c, phases, c, rest * dt
        )
        m_a = share * m_a + rest * 0.5 * (n_a + p_a)
        m_b = share * m_b + rest * 0.5 * (n_b + p_b)
        m_c = share * m_c + rest * 0.5 * (n_c + p_c)
        n_a, n_b, n_c = p_a, p_b, p_c
        taken += more_taken
        lost += more_lost
        supply = Supply(
            share * supply.v_a + rest * then.v_a,
            share * supply.v_b + rest * then.v_b,
            share * supply.v_c + rest * then.v_c,
            share * supply.i_bus + rest * then.i_bus,
            c.v_supply,
        )
    return n_a, n_b, n_c, m_a, m_b, m_c, taken, lost, supply


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
def moved(state, w_m, w_o, c, dt):
    """Speeds and positions ``w_m, theta_m, w_o, theta_o`` after a step with these speeds."""
    theta_o, w_o = stop_at_ends(state.theta_o + dt * w_o, w_o, c.travel_low, c.travel_high)
    return w_m, state.theta_m + dt * w_m, w_o, theta_o


@part
def move_masses(state, torque, load, fault, c, dt):
    """Speeds and positions ``w_m, theta_m, w_o, theta_o`` after a torque on the motor."""
    act_m, act_o, td_m, td_o = torques_on_masses(state, torque, load, fault, c)
    w_m = advance_mobile(state.w_m, act_m, c.mobility_m, c.static_ratio * td_m, td_m, dt)
    w_o = advance_mobile(state.w_o, act_o, c.mobility_o, c.static_ratio * td_o, td_o, dt)
    return moved(state, w_m, w_o, c, dt)


@part
def reference_step(state, command, load, fault, phases, c, dt):
    """Advance the reference model by ``dt`` under a command (rad) and a load (N m).

    Gives the state, the mean current of each phase within the step, and the `Supply`.
    """
    kappa_a, kappa_b, kappa_c = emf_constants(state.theta_m, fault, c)
    sector = hall_sector(c.pole_pairs * state.theta_m)

    i_ref = current_reference(
        command, state.theta_o, state.w_m, c.k_position * fault.gain, c.k_speed, c.w_max,
        2.0 * c.k_e, c.i_max,
    )  # fmt: skip
    i_seen = pair_current(sector, state.i_a, state.i_b, state.i_c)
    pair_sign = hysteresis(i_seen, i_ref, c.half_band, state.pair_sign)
    g_a, g_b, g_c = gate_signals(sector, pair_sign)

    i_a, i_b, i_c, m_a, m_b, m_c, taken, lost, supply = advance_bridge(
        state.i_a, state.i_b, state.i_c,
        kappa_a * state.w_m, kappa_b * state.w_m, kappa_c * state.w_m,
        g_a, g_b, g_c, phases, c, dt,
    )  # fmt: skip
    torque = kappa_a * m_a + kappa_b * m_b + kappa_c * m_c

    w_m, theta_m, w_o, theta_o = move_masses(state, torque, load, fault, c, dt)
    after = ReferenceState(
        i_a, i_b, i_c, w_m, theta_m, w_o, theta_o, pair_sign,
        state.e_electrical + taken,
        state.e_copper + lost,
        state.e_mechanical + dt * torque * state.w_m,
    )  # fmt: skip
    return after, m_a, m_b, m_c, supply
