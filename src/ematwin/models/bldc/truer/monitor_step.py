"""One step of the monitor model with shorted turns that are loops.

As `monitor_step`, but with a loop current in each phase (`shorted_turns`). Of the two phases of the
sector one takes the current i, the other -i, so that with g_k = 1, -1, 0

    kappa_eq = sum g_k kappa_k,   T = kappa_eq i - sum mu_k kappa_k i_fk.

The third phase carries no current, but its loop may. Backward Euler for the loops leaves one
equation for the equivalent current, whose inductance the loops reduce. In a step with a commutation
each pair counts by its share, so that g_k lies in between.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.inverter import gate_signals
from ematwin.models.bldc.monitor_step import (
    answer_impact,
    controller_stiffness,
    current_demand,
    move_rigidly,
    touching,
    within_ends,
)
from ematwin.models.bldc.motor import emf_constants
from ematwin.models.bldc.state import FaultState
from ematwin.models.bldc.truer.shorted_turns import loop_answer
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import clip

_SECTOR = math.pi / 3.0  # rad
_STANDS = 1e-6  # sectors in a step


class Loops(NamedTuple):
    """What loops of shorted turns add to `MonitorState`."""

    a: float  # A, through the contact between shorted turns of phase a
    b: float
    c: float
    sector: float  # of the last step, which says which phases had its current


@part
def sector_of_step(theta_e, moved_e):
    """Sector, 0 to 6; ``theta_e`` is the angle in the middle, which changes by ``moved_e``.

    Sectors as in `hall_sector`. A step in which the next pair takes over has a sector between both,
    by their shares; `gate_signals` then gives the mean of both pairs.
    """
    width = max(abs(moved_e) / _SECTOR, _STANDS)
    begin = theta_e / _SECTOR - 0.5 - 0.5 * width
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
    """Advance the monitor model and `Loops` by ``dt``; arguments as in `monitor_step`.

    Gives the state, the loops, and the mean electrical power of the step.
    """
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

    stiffness = per_ampere * controller_stiffness(state, touching(state, fault), c, half)
    demand = current_demand(
        command, state.theta_o + half * state.w_o, w_mid, c.k_position * fault.gain,
        c.k_demand, c.w_max,
    )  # fmt: skip
    i_ref = clip((demand + stiffness * state.i) / (1.0 + stiffness), -c.i_max, c.i_max)
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
