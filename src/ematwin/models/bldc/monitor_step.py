"""One step of the monitor model: one equivalent phase, rigid play, about 50 us.

docs/models.md, "Monitor model". All of a step happens in its middle: inputs, angles, and the
current, which follows the speed that the rotor will have there (implicit midpoint). Commutations
and impacts count from when they happen ("Steps").

**Pairs.** On the flats of the conducting phases |f| = 1, and zeta is 1 at most, so that

    kappa_eq = k_e (h_p + h_n + C cos theta_m + S sin theta_m),

with what `offset_turned` gives for sine and cosine where some of the offset is fixed in space. Only
the angle changes while a candidate is simulated: the three pairs are computed once, as the pair
without c and the differences of the others from it. In a step with a commutation both pairs count
by their shares of the step.

**Loops** of shorted turns (`ematwin.models.bldc.motor`) change the pair: with g_k = 1, -1, 0 for
the phase with current i, that with -i, and the third, whose loop may carry a current as well,

    kappa_eq = sum g_k kappa_k,   T = kappa_eq i - sum mu_k kappa_k i_fk.

Backward Euler for the loops leaves one equation for i, whose inductance they reduce. In a step with
a commutation g_k lies in between.

`monitor_step` is a `part`, of steps that numba inlines: loops over it compile three times as fast
as where numba inlines all of it, and their lanes are as fast.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.constants import FaultState
from ematwin.models.bldc.inverter import gate_signals
from ematwin.models.bldc.motor import (
    SIXTH_TURN,
    emf_constants,
    loop_answer,
    offset_turned,
    phase_inductance,
)
from ematwin.numerics.backlash import advance_rigid_play, stop_at_ends
from ematwin.numerics.compile import part, step
from ematwin.numerics.friction import dithered_static, loaded_friction
from ematwin.numerics.scalar import ROOT_3, clip

_STANDS = 1e-6  # sectors in a step


class Pairs(NamedTuple):
    """The pair of phases without c; and by how much those without a and without b differ."""

    turns: float  # share of turns left, sum of both
    turns_a: float
    turns_b: float
    mobility: float  # 1/H, inverse of L_eq
    mobility_a: float
    mobility_b: float
    cosine: float  # C
    cosine_a: float
    cosine_b: float
    sine: float  # S
    sine_a: float
    sine_b: float


@step
def pairs_of(fault, c):
    """The three pairs of a candidate."""
    l_a = phase_inductance(fault.h_a, c.inductance, c.leakage)
    l_b = phase_inductance(fault.h_b, c.inductance, c.leakage)
    l_c = phase_inductance(fault.h_c, c.inductance, c.leakage)
    # zeta cos and zeta sin of phi - 2 pi k/3
    near_a, far_a = fault.zeta_cos, fault.zeta_sin
    near_b = -0.5 * near_a + 0.5 * ROOT_3 * far_a
    far_b = -0.5 * far_a - 0.5 * ROOT_3 * near_a
    near_c = -0.5 * near_a - 0.5 * ROOT_3 * far_a
    far_c = -0.5 * far_a + 0.5 * ROOT_3 * near_a
    mobility = 1.0 / (l_a + l_b)
    cosine = fault.h_a * near_a + fault.h_b * near_b
    sine = -fault.h_a * far_a - fault.h_b * far_b
    return Pairs(
        fault.h_a + fault.h_b,
        fault.h_c - fault.h_a,
        fault.h_c - fault.h_b,
        mobility,
        1.0 / (l_b + l_c) - mobility,
        1.0 / (l_c + l_a) - mobility,
        cosine,
        fault.h_c * near_c - fault.h_a * near_a,
        fault.h_c * near_c - fault.h_b * near_b,
        sine,
        fault.h_a * far_a - fault.h_c * far_c,
        fault.h_b * far_b - fault.h_c * far_c,
    )


@step
def shares_off(theta_m, moved, pole_pairs):
    """The shares of a step in which phases a and b are off; else c is.

    ``theta_m`` is the angle in the middle of the step, rad, ``moved`` by how much it changes.
    """
    sectors = pole_pairs * (3.0 / math.pi)
    per_step = 1.0 / clip(abs(sectors * moved), _STANDS, 1.0)
    # from the middle of a sector without b, modulo three sectors: -1.5 to 1.5; a is next, then c
    from_b = sectors * theta_m - 2.0
    from_b -= 3.0 * np.floor(from_b * (1.0 / 3.0) + 0.5)
    from_a = from_b + (2.0 if from_b < -0.5 else -1.0)
    return (
        clip(0.5 + (0.5 - abs(from_a)) * per_step, 0.0, 1.0),
        clip(0.5 + (0.5 - abs(from_b)) * per_step, 0.0, 1.0),
    )


@step
def equivalent_phase(theta_m, moved, pairs, c):
    """R_eq (ohm), 1/L_eq (1/H) and kappa_eq (V s/rad) of a step; arguments as in `shares_off`."""
    off_a, off_b = shares_off(theta_m, moved, c.pole_pairs)
    turns = pairs.turns + off_a * pairs.turns_a + off_b * pairs.turns_b
    mobility = pairs.mobility + off_a * pairs.mobility_a + off_b * pairs.mobility_b
    cosine = pairs.cosine + off_a * pairs.cosine_a + off_b * pairs.cosine_b
    sine = pairs.sine + off_a * pairs.sine_a + off_b * pairs.sine_b
    s, co = offset_turned(theta_m, c.turning)
    return turns * c.resistance, mobility, (turns + cosine * co + sine * s) * c.k_e


class MonitorState(NamedTuple):
    """State of the monitor model."""

    i: float  # A, equivalent current, signed, mean of the last step
    w_m: float  # rad/s
    theta_m: float  # rad
    w_o: float
    theta_o: float
    dw_m: float  # rad/s, what w_m would gain in a step with the acceleration at the end of the last
    i_from: float  # A, from which the next current starts, in the middle of the last step


class Impact(NamedTuple):
    """What an impact did in a step."""

    jump: float  # rad/s, by how much it changed the speed of the motor
    left: float  # share of the step that was left, 0 without an impact


@step
def current_reference(state, command, per_ampere, w_mid, fault, c, half):
    """Current that position and speed loop ask for in the middle of a step, A, within its limit.

    ``command`` is an output position on the motor shaft, rad; ``per_ampere`` a torque, N m/A. The
    speed in the middle is w + (dw + dt kappa (i_mean - i)/J)/2, if other torques stay: the speed
    loop responds to the torque of the same step, which moves both masses where they touch.
    """
    apart = abs(abs(state.theta_m - state.theta_o) - fault.half_gap) > 1e-9  # rad
    mobility = c.mobility_m + (0.0 if apart else 1.0) * (c.mobility_both - c.mobility_m)
    moves = 0.0 if state.w_m == 0.0 else 1.0
    stiffness = per_ampere * (moves * c.k_demand * half * mobility)
    behind = command - (state.theta_o + half * state.w_o)
    w_ref = clip(c.k_position * fault.gain * behind, -c.w_max, c.w_max)
    demand = c.k_demand * (w_ref - w_mid)
    return clip((demand + stiffness * state.i) / (1.0 + stiffness), -c.i_max, c.i_max)


@step
def move_rigidly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt):
    """The state after motor and output have moved under torques, with a rigid contact; the impact.

    ``act_m`` acts on the motor in the middle of the step, ``before_m`` did in the step before;
    ``i`` is the new current.
    """
    td_m = fault.friction * c.t_m
    ts_m = dithered_static(c.static_ratio * td_m, td_m, kappa_eq * c.half_band)
    direction = state.w_o if state.w_o != 0.0 else state.w_m
    td_o = fault.friction * loaded_friction(direction, -load, c.t_o, c.c_opposing, c.c_aiding)
    theta_m, w_m, theta_o, w_o, gains, jump, left = advance_rigid_play(
        state.theta_m, state.w_m, state.theta_o, state.w_o, act_m, before_m, -load,
        c.mobility_m, c.mobility_o, c.mobility_both, c.share_o,
        ts_m, td_m, c.static_ratio * td_o, td_o, fault.half_gap, dt,
    )  # fmt: skip
    return MonitorState(i, w_m, theta_m, w_o, theta_o, dt * gains, i), Impact(jump, left)


@step
def within_ends(state, fault, c):
    """The state, held by the end stops."""
    theta_o, w_o = stop_at_ends(state.theta_o, state.w_o, c.travel_low, c.travel_high)
    # Contact is rigid: the stop also ends the motor's travel, half a gap further on.
    theta_m, w_m = stop_at_ends(
        state.theta_m, state.w_m, c.travel_low - fault.half_gap, c.travel_high + fault.half_gap
    )
    return MonitorState(state.i, w_m, theta_m, w_o, theta_o, state.dw_m, state.i_from)


@step
def answer_impact(state, impact, i_ref, fall, rise, kappa_eq, c, dt):
    """The state, where the current answers an impact from that instant on.

    ``i_ref`` is the reference without the impact; ``fall`` and ``rise`` are by how much the supply
    can change the current in a step, A. The next step starts from half a change less in its
    middle, so that it may change by a whole one as others do.
    """
    wanted = clip(i_ref - c.k_demand * impact.jump, -c.i_max, c.i_max) - state.i
    left = impact.left
    change = clip(wanted, -left * fall, left * rise)
    half_more = 0.5 * (rise if wanted > 0.0 else -fall)
    i_from = state.i + (change - half_more if left > 0.0 else 0.0)
    beside = 0.5 * left * change  # mean over the step
    gained = dt * c.mobility_both * kappa_eq * beside
    return MonitorState(
        state.i + beside, state.w_m + gained, state.theta_m,
        state.w_o + gained, state.theta_o, state.dw_m, i_from,
    )  # fmt: skip


@part
def monitor_step(state, command, load, fault, pairs, c, dt):
    """Advance by ``dt``, command and load of its middle: the state, and the mean power, W."""
    half = 0.5 * dt
    r_eq, per_l_eq, kappa_eq = equivalent_phase(
        state.theta_m + half * state.w_m, dt * state.w_m, pairs, c
    )
    w_mid = state.w_m + 0.5 * state.dw_m
    i_ref = current_reference(state, command, kappa_eq, w_mid, fault, c, half)
    drop = r_eq * state.i + kappa_eq * state.w_m
    # u = clip(drop + l_eq (i_ref - i)/dt, -V, V), i <- i + dt (u - drop)/l_eq; the drop over r_eq
    # is that of the mean of both currents, to first order, where that is a small part of it
    per_volt = dt * per_l_eq
    reach = per_volt * max(1.0 - 0.5 * r_eq * per_volt, 0.5)
    fall, rise = reach * (c.v_supply + drop), reach * (c.v_supply - drop)
    i = clip(i_ref, state.i_from - fall, state.i_from + rise)
    p_mean = i * (r_eq * i + kappa_eq * w_mid + (i - state.i) / per_volt)

    act_m = kappa_eq * i - c.viscous * w_mid
    before_m = kappa_eq * state.i - c.viscous * state.w_m
    after, impact = move_rigidly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt)
    after = answer_impact(after, impact, i_ref, fall, rise, kappa_eq, c, dt)
    return within_ends(after, fault, c), p_mean


class Loops(NamedTuple):
    """What loops of shorted turns add to `MonitorState`."""

    a: float  # A, through the contact between shorted turns of phase a
    b: float
    c: float
    sector: float  # of the last step, which says which phases had its current


@part
def sector_of_step(theta_e, moved_e):
    """Sector, 0 to 6, at a middle ``theta_e``; between two where the next pair takes over."""
    width = max(abs(moved_e) / SIXTH_TURN, _STANDS)
    begin = theta_e / SIXTH_TURN - 0.5 - 0.5 * width
    first = np.floor(begin)
    sector = first + clip((begin + width - first - 1.0) / width, 0.0, 1.0)
    return sector - 6.0 * np.floor(sector / 6.0)


@part
def _loop_in_pair(gate, gate_before, i, w, kappa, mu, loop, c, dt):
    """Terms of the loop of a phase and its EMF in the equation of the pair, and its response.

    Gives the reduction of the ``inertia`` (H) and the ``push`` (V s) of the pair, for which
    inertia i' = push + dt u; ``remains`` and ``follows`` of `loop_answer`.
    """
    turns = (1.0 - c.leakage) * c.inductance
    e = kappa * w
    remains, follows = loop_answer(
        mu, loop, gate_before * i, e, c.resistance, turns, c.short_resistance, dt
    )
    linked = mu * (turns + dt * c.resistance)
    push = gate * (linked * remains - mu * turns * loop - dt * e)
    return gate * gate * linked * follows, push, remains, follows


@part
def looped_monitor_step(state, loops, command, load, fault, c, dt):
    """As `monitor_step` with `Loops`: the state, the loops, and the mean power, W."""
    half = 0.5 * dt
    theta_mid = state.theta_m + half * state.w_m
    w_mid = state.w_m + 0.5 * state.dw_m
    mu_a, mu_b, mu_c = 1.0 - fault.h_a, 1.0 - fault.h_b, 1.0 - fault.h_c
    every_turn = FaultState(
        fault.friction, fault.half_gap, 1.0, 1.0, 1.0, fault.zeta_cos, fault.zeta_sin, fault.gain
    )
    kappa_a, kappa_b, kappa_c = emf_constants(theta_mid, every_turn, c)
    sector = sector_of_step(c.pole_pairs * theta_mid, c.pole_pairs * dt * state.w_m)
    g_a, g_b, g_c = gate_signals(sector, 1.0)
    was_a, was_b, was_c = gate_signals(loops.sector, 1.0)
    taken_a, push_a, remains_a, follows_a = _loop_in_pair(
        g_a, was_a, state.i, w_mid, kappa_a, mu_a, loops.a, c, dt
    )
    taken_b, push_b, remains_b, follows_b = _loop_in_pair(
        g_b, was_b, state.i, w_mid, kappa_b, mu_b, loops.b, c, dt
    )
    taken_c, push_c, remains_c, follows_c = _loop_in_pair(
        g_c, was_c, state.i, w_mid, kappa_c, mu_c, loops.c, c, dt
    )
    # the drop over the resistances is that of the mean of both currents; commutation by itself
    # takes no voltage, as if the pair had always had its current
    inertia = 2.0 * c.inductance + dt * c.resistance - (taken_a + taken_b + taken_c)
    push = (2.0 * c.inductance - dt * c.resistance) * state.i + push_a + push_b + push_c
    kappa_eq = g_a * kappa_a + g_b * kappa_b + g_c * kappa_c
    # what an ampere more makes of torque, with what the loops take of it at once
    per_ampere = kappa_eq - (
        g_a * kappa_a * mu_a * follows_a
        + g_b * kappa_b * mu_b * follows_b
        + g_c * kappa_c * mu_c * follows_c
    )

    i_ref = current_reference(state, command, per_ampere, w_mid, fault, c, half)
    fall = state.i - (push - dt * c.v_supply) / inertia
    rise = (push + dt * c.v_supply) / inertia - state.i
    i = clip(i_ref, state.i_from - fall, state.i_from + rise)
    p_mean = i * (inertia * i - push) / dt
    after_a = remains_a + follows_a * g_a * i
    after_b = remains_b + follows_b * g_b * i
    after_c = remains_c + follows_c * g_c * i

    lost = mu_a * kappa_a * after_a + mu_b * kappa_b * after_b + mu_c * kappa_c * after_c
    lost_before = mu_a * kappa_a * loops.a + mu_b * kappa_b * loops.b + mu_c * kappa_c * loops.c
    act_m = kappa_eq * i - lost - c.viscous * w_mid
    before_m = kappa_eq * state.i - lost_before - c.viscous * state.w_m
    after, impact = move_rigidly(state, i, load, kappa_eq, act_m, before_m, fault, c, dt)
    after = answer_impact(after, impact, i_ref, fall, rise, per_ampere, c, dt)
    return within_ends(after, fault, c), Loops(after_a, after_b, after_c, sector), p_mean
