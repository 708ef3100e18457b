"""The same step over arrays, for numpy and JAX alike: selects where the scalar step branches.

``xp`` is the array module; state and magnitudes are arrays of any one shape, or scalars.
"""

import math
from typing import Any

from benchmarks.peers.scalar_step import CLOSED, TOUCHING


def next_speed(xp: Any, w: Any, act: Any, inertia: Any, static: Any, dynamic: Any, dt: Any) -> Any:
    """Dry friction after Borello; a step that would reverse the speed ends at zero."""
    friction = xp.where(w == 0.0, xp.clip(act, -static, static), dynamic * xp.sign(w))
    after = w + dt * (act - friction) / inertia
    return xp.where(w * after < 0.0, 0.0, after)


def set_off(xp: Any, act: Any, inertia: Any, static: Any, dynamic: Any, left: Any) -> Any:
    """Speed after a time ``left`` from rest and the acceleration, zero where friction holds."""
    rate = (act - dynamic * xp.sign(act)) / inertia
    rate = xp.where(xp.abs(act) <= static, 0.0, rate)
    return left * rate, rate


def through_rest(
    xp: Any, w: Any, act: Any, before: Any, inertia: Any, static: Any, dynamic: Any, dt: Any
) -> Any:
    """The same for long steps: what is left of the step after a mass has stopped or broken loose.

    ``before`` is the torque in the middle of the step before: it grows evenly to ``act``. Gives the
    speed, the share of the step until a moving mass came to rest, 1 if it did not, and the
    acceleration at the end.
    """
    rest = w == 0.0
    moving = (act - dynamic * xp.sign(w)) / inertia
    after = w + dt * moving
    size = xp.abs(act)
    grown = size - before * xp.sign(act)
    whole = xp.where(rest, grown, w - after)
    share = xp.where(rest, size - static, w) / xp.where(whole == 0.0, 1.0, whole)
    share = xp.where(rest & (grown <= 0.0), 0.5, share)
    left = dt * xp.where(rest, xp.clip(0.5 + share, 0.5, 1.5), 1.0 - share)
    started, starting = set_off(xp, act, inertia, static, dynamic, left)
    turns = w * after < 0.0
    fresh = rest | turns
    rate = xp.where(fresh, starting, moving)
    return xp.where(fresh, started, after), xp.where(turns, share, 1.0), rate


def electrics(xp: Any, x_m: Any, moved: Any, m: Any, c: Any) -> Any:
    """R, L and kappa of the conducting phases: all, less that which is off.

    A pair that takes over within a step counts by its share, L by 1/L.
    """
    place = c.pole_pairs * x_m / (math.pi / 3.0) - 0.5
    width = xp.maximum(xp.abs(c.pole_pairs * moved / (math.pi / 3.0)), 1e-6)
    sector = xp.floor(place)
    left, right = place - sector, sector + 1.0 - place
    share = xp.maximum(0.5 - xp.minimum(left, right) / width, 0.0)
    r, l, k = _of_sector(xp, x_m, sector, m, c)
    other = _of_sector(xp, x_m, xp.where(left < right, sector - 1.0, sector + 1.0), m, c)
    inductance = 1.0 / ((1.0 - share) / l + share / other[1])
    return r + share * (other[0] - r), inductance, k + share * (other[2] - k)


def _of_sector(xp: Any, x_m: Any, sector: Any, m: Any, c: Any) -> Any:
    pair = sector - 3.0 * xp.floor(sector / 3.0)  # 0: c is off, 1: b, 2: a
    resistance = inductance = kappa = 0.0
    for phase, (h, off) in enumerate(((m.h_a, 2.0), (m.h_b, 1.0), (m.h_c, 0.0))):
        on = xp.where(pair == off, 0.0, 1.0)
        gap = 1.0 + m.zeta * xp.cos(x_m + m.phi - 2.0 * math.pi * phase / 3.0)
        resistance = resistance + on * h
        inductance = inductance + on * (h * h * (1.0 - c.leakage) + c.leakage)
        kappa = kappa + on * h * xp.abs(gap)
    return resistance * c.resistance, inductance * c.inductance, kappa * c.k_e


def end_stop(xp: Any, x: Any, w: Any, low: Any, high: Any) -> Any:
    """A mass that has reached a stop stays there until it moves away from it."""
    w = xp.where(x <= low, xp.maximum(w, 0.0), xp.where(x >= high, xp.minimum(w, 0.0), w))
    return xp.clip(x, low, high), w


def advance(xp: Any, state: Any, command: Any, load: Any, m: Any, c: Any, dt: Any) -> Any:
    """State ``i w_m x_m w_o x_o gained start`` after one step, as in `scalar_step.advance`."""
    i, w_m, x_m, w_o, x_o, gained, start = state
    half = 0.5 * dt
    resistance, inductance, kappa = electrics(xp, x_m + half * w_m, dt * w_m, m, c)
    w_mid = w_m + 0.5 * gained
    touching = xp.abs(xp.abs(x_m - x_o) - m.half_gap) <= TOUCHING
    per_ampere = half * kappa / xp.where(touching, c.j_m + c.j_o, c.j_m)
    per_ampere = xp.where(w_m == 0.0, 0.0, per_ampere)
    g = c.k_speed / (2.0 * c.k_e)
    w_ref = m.gain * c.k_position * (command - x_o - half * w_o)
    w_ref = xp.clip(w_ref, -c.speed_limit, c.speed_limit)
    i_ref = (g * (w_ref - w_mid) + g * per_ampere * i) / (1.0 + g * per_ampere)
    i_ref = xp.clip(i_ref, -c.current_limit, c.current_limit)
    drop = resistance * i + kappa * w_m
    reach = dt / inductance * xp.maximum(1.0 - half * resistance / inductance, 0.5)
    fall, rise = reach * (c.supply + drop), reach * (c.supply - drop)
    after = xp.clip(i_ref, start - fall, start + rise)

    dynamic_m = m.friction * c.t_m
    static_m = xp.maximum(dynamic_m, c.static_ratio * dynamic_m - kappa * c.half_band)
    direction = xp.where(w_o != 0.0, w_o, w_m)
    share = xp.where(direction * load > 0.0, c.c_opposing, c.c_aiding)
    dynamic_o = m.friction * (c.t_o + share * abs(load))
    static_o = c.static_ratio * dynamic_o
    act_m, act_o = kappa * after - c.viscous * w_mid, -load
    before_m = kappa * i - c.viscous * w_m

    free_m = next_speed(xp, w_m, act_m, c.j_m, static_m, dynamic_m, dt)
    free_o = next_speed(xp, w_o, act_o, c.j_o, static_o, dynamic_o, dt)
    x_o_free = x_o + half * (w_o + free_o)
    twist = x_m + half * (w_m + free_m) - x_o_free
    face, before = xp.sign(twist) * m.half_gap, xp.clip(x_m - x_o, -m.half_gap, m.half_gap)
    rest = (free_m == 0.0) & (free_o == 0.0) & (xp.abs(xp.abs(before) - m.half_gap) < CLOSED)
    # apart the motor alone, else one body with the momentum and all torques of both
    apart = (xp.abs(twist) <= m.half_gap) & ~rest
    rolls = apart | (xp.abs(face - before) < CLOSED)
    met = (face - before) / xp.where(rolls, 1.0, twist - before)
    met = xp.where(rolls, 0.0, met)  # share of the step until they meet
    remains = xp.where(rolls, 0.0, 1.0 - met)
    left = dt * (1.0 - met)
    w_met = w_m + met * (free_m - w_m)
    x_met = x_m + met * half * (w_m + w_met)
    w_both = c.j_m * w_met + c.j_o * (w_o + met * (free_o - w_o))
    w = xp.where(apart, w_m, w_both / (c.j_m + c.j_o))
    more = xp.where(apart, 0.0, act_o)
    w_next, until, rate = through_rest(
        xp, w, act_m + more, before_m + more, xp.where(apart, c.j_m, c.j_m + c.j_o),
        xp.where(apart, static_m, static_m + static_o),
        xp.where(apart, dynamic_m, dynamic_m + dynamic_o), left,
    )  # fmt: skip
    # come to rest together, the motor leaves the face that it pushed, and the output stays there
    leaves = ~apart & (until < 1.0) & (twist * w > 0.0)
    alone, slower = set_off(xp, act_m, c.j_m, static_m, dynamic_m, left * (1.0 - until))
    w_o = xp.where(apart, free_o, xp.where(leaves, 0.0, w_next))
    w_next = xp.where(leaves, alone, w_next)
    gained = dt * xp.where(leaves, slower, rate)
    x_m = x_met + 0.5 * left * (w + w_next)
    x_o = xp.where(leaves, x_met - face + 0.5 * left * until * w, x_m - face)
    x_o = xp.where(apart, x_o_free, x_o)
    x_o = xp.clip(x_o, x_m - m.half_gap, x_m + m.half_gap)
    # after an impact the current goes for what the speed loop asks then, and pushes both
    asked = xp.clip(i_ref - g * (w - w_met), -c.current_limit, c.current_limit)
    change = xp.clip(asked - after, -remains * fall, remains * rise)
    more = change - 0.5 * xp.where(asked > after, rise, -fall)
    start = after + xp.where(remains > 0.0, more, 0.0)
    beside = 0.5 * remains * change
    pushed = dt * kappa * beside / (c.j_m + c.j_o)
    after, w_next, w_o = after + beside, w_next + pushed, w_o + pushed
    x_o, w_o = end_stop(xp, x_o, w_o, c.low, c.high)
    x_m, w_next = end_stop(xp, x_m, w_next, c.low - m.half_gap, c.high + m.half_gap)
    return after, w_next, x_m, w_o, x_o, gained, start
