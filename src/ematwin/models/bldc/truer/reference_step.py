"""One step of the reference model with the truer forms.

As `reference_step`, but with the EMF shapes as they are, torque ripple, cogging, friction that
gives before it slides, a winding that warms, a supply that sags, and a loop current in each phase.
With backward Euler for the loops a phase looks to the bridge like one with another inductance and
EMF, so that the bridge, its diodes included, is the same.
"""

from typing import NamedTuple

from ematwin.models.bldc.inverter import gate_signals, hysteresis, pair_current
from ematwin.models.bldc.motor import hall_sector, phase_inductance
from ematwin.models.bldc.reference_step import (
    ReferenceState,
    Supply,
    advance_bridge,
    move_masses,
    moved,
    torques_on_masses,
)
from ematwin.models.bldc.truer.loops import (
    advance_current_loop,
    advance_speed_loop,
    left_of_voltage,
)
from ematwin.models.bldc.truer.motor import cogging_torque, truer_emf_constants
from ematwin.models.bldc.truer.shorted_turns import loop_answer, split_short
from ematwin.models.bldc.truer.state import TruerState
from ematwin.numerics.compile import part
from ematwin.numerics.lugre import advance_on_bristles, fading, sliding_torque
from ematwin.numerics.scalar import clip, lag

_HALF = 1e-12  # of the supply across the pair: a drive of 0 would mean that a leg is off


class Electrical(NamedTuple):
    """Constants of windings and bridge over a step."""

    resistance: float  # ohm, one phase
    inductance: float  # H, one phase
    leakage: float
    short_resistance: float  # ohm
    v_supply: float  # V
    v_diode: float  # V


class SeenPhase(NamedTuple):
    """A phase as the bridge sees it over a step, and how its loop answers."""

    e: float  # V
    r: float  # ohm
    y: float  # 1/H
    remains: float  # A
    follows: float


@part
def seen_phase(i, loop, e, h, mu, c, dt):
    """The phase with a loop eliminated, for linearly implicit Euler over ``dt``."""
    r = h * c.resistance
    turns = h * h * (1.0 - c.leakage) * c.inductance
    remains, follows = loop_answer(mu, loop, i, e, r, turns, c.short_resistance, dt)
    linked = mu * (turns + dt * r)
    inertia = phase_inductance(h, c.inductance, c.leakage) + dt * r - linked * follows
    # the loop current if i stayed as it is
    still = remains + follows * i
    seen = e - mu * r * still - mu * turns * (still - loop) / dt
    return SeenPhase(seen, r, 1.0 / inertia, remains, follows)


@part
def copper_loss(m, loop, mu, r, contact):
    """Power lost in a phase with mean current ``m`` and in its loop, W."""
    through = m - loop
    return (1.0 - mu) * r * m * m + mu * r * through * through + contact * loop * loop


@part
def advance_shorted_bridge(i_a, i_b, i_c, loop_a, loop_b, loop_c, e_a, e_b, e_c,
                           g_a, g_b, g_c, turns, c, dt):  # fmt: skip
    """`advance_bridge` with loops.

    ``turns`` are h_a, h_b, h_c and mu_a, mu_b, mu_c. Gives currents and loop currents after ``dt``,
    the means of both, the energies taken in and lost, and the `Supply`.
    """
    h_a, h_b, h_c, mu_a, mu_b, mu_c = turns
    a = seen_phase(i_a, loop_a, e_a, h_a, mu_a, c, dt)
    b = seen_phase(i_b, loop_b, e_b, h_b, mu_b, c, dt)
    p = seen_phase(i_c, loop_c, e_c, h_c, mu_c, c, dt)
    n_a, n_b, n_c, m_a, m_b, m_c, taken, _, supply = advance_bridge(
        i_a, i_b, i_c, a.e, b.e, p.e, g_a, g_b, g_c, (a.r, b.r, p.r, a.y, b.y, p.y), c, dt
    )
    after_a = a.remains + a.follows * n_a
    after_b = b.remains + b.follows * n_b
    after_c = p.remains + p.follows * n_c
    mean_a = 0.5 * (loop_a + after_a)
    mean_b = 0.5 * (loop_b + after_b)
    mean_c = 0.5 * (loop_c + after_c)
    lost = dt * (
        copper_loss(m_a, mean_a, mu_a, a.r, c.short_resistance)
        + copper_loss(m_b, mean_b, mu_b, b.r, c.short_resistance)
        + copper_loss(m_c, mean_c, mu_c, p.r, c.short_resistance)
    )
    currents = n_a, n_b, n_c, after_a, after_b, after_c
    return currents, (m_a, m_b, m_c, mean_a, mean_b, mean_c), taken, lost, supply


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
def drive(state, more, command, fault, c, truer, dt):
    """Controller, bridge and windings over ``dt``; the rotor moves as ``state`` says."""
    h_a, mu_a = split_short(fault.h_a, truer.loops)
    h_b, mu_b = split_short(fault.h_b, truer.loops)
    h_c, mu_c = split_short(fault.h_c, truer.loops)
    kappa_a, kappa_b, kappa_c = truer_emf_constants(state.theta_m, h_a, h_b, h_c, fault, c, truer)
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
    share = _HALF if share == 0.0 else share
    g_a, g_b, g_c = g_a * share, g_b * share, g_c * share

    currents, means, taken, lost, supply = advance_shorted_bridge(
        state.i_a, state.i_b, state.i_c, more.loop_a, more.loop_b, more.loop_c,
        kappa_a * state.w_m, kappa_b * state.w_m, kappa_c * state.w_m,
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
def slide(state, more, torque, load, fault, c, truer, dt):
    """Speeds and positions as of `move_masses`, and how far bristles are bent, ``m`` and ``o``."""
    if truer.bristles_m == 0.0:
        return move_masses(state, torque, load, fault, c, dt), 0.0, 0.0
    act_m, act_o, td_m, td_o = torques_on_masses(state, torque, load, fault, c)
    fade_m, fade_o = fading(state.w_m, truer.w_stribeck), fading(state.w_o, truer.w_stribeck)
    w_m, bent_m = advance_on_bristles(
        state.w_m, more.bent_m, act_m, c.mobility_m, sliding_torque(td_m, c.static_ratio, fade_m),
        truer.bristles_m, fade_m * truer.bristle_damping, dt,
    )  # fmt: skip
    w_o, bent_o = advance_on_bristles(
        state.w_o, more.bent_o, act_o, c.mobility_o, sliding_torque(td_o, c.static_ratio, fade_o),
        truer.bristles_o, fade_o * truer.bristle_damping, dt,
    )  # fmt: skip
    return moved(state, w_m, w_o, c, dt), bent_m, bent_o


@part
def truer_reference_step(state, more, command, load, fault, c, truer, dt):
    """Advance the reference model by ``dt``; arguments as in `reference_step`.

    Gives the state, the state of the truer forms, the mean current of each phase within the step,
    and the `Supply`.
    """
    driven = drive(state, more, command, fault, c, truer, dt)
    torque = driven.torque + cogging_torque(state.theta_m, truer)
    (w_m, theta_m, w_o, theta_o), bent_m, bent_o = slide(
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
