"""The monitor model's step for one candidate, written out again: it shares no code with the kernel.

Plain Python with `math`: `solve_ivp` runs it as it is, numba compiles it. All of a step happens in
its middle: inputs, angles, and the current, which follows the speed that the rotor will have there.
Commutations and impacts count from when they happen.
"""

import math

from numba.extending import register_jitable

TOUCHING = 1e-9  # rad
CLOSED = 1e-12  # rad


@register_jitable
def next_speed(w, act, inertia, static, dynamic, dt):
    """Dry friction after Borello; a step that would reverse the speed ends at zero."""
    held = min(max(act, -static), static)
    friction = held if w == 0.0 else math.copysign(dynamic, w)
    after = w + dt * (act - friction) / inertia
    return 0.0 if w * after < 0.0 else after


@register_jitable
def set_off(act, inertia, static, dynamic, left):
    """Speed after a time ``left`` from rest and the acceleration, zero where friction holds."""
    if abs(act) <= static:
        return 0.0, 0.0
    rate = (act - math.copysign(dynamic, act)) / inertia
    return left * rate, rate


@register_jitable
def through_rest(w, act, before, inertia, static, dynamic, dt):
    """The same for long steps: what is left of the step after a mass has stopped or broken loose.

    ``before`` is the torque in the middle of the step before: it grows evenly to ``act``. Gives the
    speed, the share of the step until a moving mass came to rest, 1 if it did not, and the
    acceleration at the end.
    """
    until = 1.0
    if w != 0.0:
        rate = (act - math.copysign(dynamic, w)) / inertia
        after = w + dt * rate
        if w * after >= 0.0:
            return after, 1.0, rate
        until = w / (w - after)
        left = dt * (1.0 - until)
    else:
        grown = abs(act) - math.copysign(before, act * before)
        since = (abs(act) - static) / grown if grown > 0.0 else 0.5
        left = dt * min(max(0.5 + since, 0.5), 1.5)
    after, rate = set_off(act, inertia, static, dynamic, left)
    return after, until, rate


@register_jitable
def electrics(x_m, sector, m, c):
    """R, L and kappa of the two phases in series that conduct in a sector."""
    off = (2, 1, 0)[int(sector) % 3]
    resistance = inductance = kappa = 0.0
    for phase in range(3):
        if phase != off:
            h = (m.h_a, m.h_b, m.h_c)[phase]
            resistance += h * c.resistance
            inductance += (h * h * (1.0 - c.leakage) + c.leakage) * c.inductance
            gap = 1.0 + m.zeta * math.cos(x_m + m.phi - 2.0 * math.pi * phase / 3.0)
            kappa += h * c.k_e * abs(gap)
    return resistance, inductance, kappa


@register_jitable
def electrics_of_step(x_m, moved, m, c):
    """The same of a step; a pair that takes over within it counts by its share, L by 1/L."""
    place = c.pole_pairs * x_m / (math.pi / 3.0) - 0.5
    width = max(abs(c.pole_pairs * moved / (math.pi / 3.0)), 1e-6)
    sector = math.floor(place)
    resistance, inductance, kappa = electrics(x_m, sector, m, c)
    left, right = place - sector, sector + 1.0 - place
    if min(left, right) < 0.5 * width:
        share = 0.5 - min(left, right) / width
        r, l, k = electrics(x_m, sector - 1.0 if left < right else sector + 1.0, m, c)
        resistance += share * (r - resistance)
        inductance = 1.0 / ((1.0 - share) / inductance + share / l)
        kappa += share * (k - kappa)
    return resistance, inductance, kappa


@register_jitable
def wanted_speed(command, x_o, m, c):
    """The position loop, with its limit."""
    return min(max(m.gain * c.k_position * (command - x_o), -c.speed_limit), c.speed_limit)


@register_jitable
def advance(i, w_m, x_m, w_o, x_o, gained, start, command, load, m, c, dt):
    """State after one step; ``i`` is the mean current of the step.

    ``gained`` is what ``w_m`` gains in a step with the acceleration at the end of the one before,
    ``start`` the current from which the next one goes on; ``command`` and ``load`` are those of the
    middle of the step; ``m`` are `Magnitudes`, ``c`` a `Plant`.
    """
    half = 0.5 * dt
    resistance, inductance, kappa = electrics_of_step(x_m + half * w_m, dt * w_m, m, c)
    # the speed in the middle if all torques stayed, and how an ampere more would change it
    w_mid = w_m + 0.5 * gained
    touching = abs(abs(x_m - x_o) - m.half_gap) <= TOUCHING
    per_ampere = half * kappa / (c.j_m + c.j_o if touching else c.j_m)
    if w_m == 0.0:
        per_ampere = 0.0
    # i = g (w_ref - w_mid - per_ampere (i - i_before)), solved for i
    g = c.k_speed / (2.0 * c.k_e)
    demand = g * (wanted_speed(command, x_o + half * w_o, m, c) - w_mid)
    i_ref = (demand + g * per_ampere * i) / (1.0 + g * per_ampere)
    i_ref = min(max(i_ref, -c.current_limit), c.current_limit)
    drop = resistance * i + kappa * w_m
    # how far the supply drives it; what the current adds to the drop slows it down
    reach = dt / inductance * max(1.0 - half * resistance / inductance, 0.5)
    fall, rise = reach * (c.supply + drop), reach * (c.supply - drop)
    after = min(max(i_ref, start - fall), start + rise)

    dynamic_m = m.friction * c.t_m
    static_m = max(dynamic_m, c.static_ratio * dynamic_m - kappa * c.half_band)
    direction = w_o if w_o != 0.0 else w_m
    share = c.c_opposing if direction * load > 0.0 else c.c_aiding
    dynamic_o = m.friction * (c.t_o + share * abs(load))
    static_o = c.static_ratio * dynamic_o
    act_m, act_o = kappa * after - c.viscous * w_mid, -load
    before_m = kappa * i - c.viscous * w_m

    free_m = next_speed(w_m, act_m, c.j_m, static_m, dynamic_m, dt)
    free_o = next_speed(w_o, act_o, c.j_o, static_o, dynamic_o, dt)
    x_o_free = x_o + half * (w_o + free_o)
    twist = x_m + half * (w_m + free_m) - x_o_free
    face = math.copysign(m.half_gap, twist)
    before = min(max(x_m - x_o, -m.half_gap), m.half_gap)
    rest = free_m == 0.0 and free_o == 0.0 and abs(abs(before) - m.half_gap) < CLOSED
    jump = remains = 0.0
    if abs(twist) <= m.half_gap and not rest:
        w = w_m
        w_m, _, rate = through_rest(w, act_m, before_m, c.j_m, static_m, dynamic_m, dt)
        x_m = x_m + half * (w + w_m)
        w_o, x_o = free_o, min(max(x_o_free, x_m - m.half_gap), x_m + m.half_gap)
    else:  # they meet, or stay together: one body with the momentum and all torques of both
        j, met = c.j_m + c.j_o, 0.0
        if abs(face - before) >= CLOSED:
            met = (face - before) / (twist - before)  # share of the step
            remains = 1.0 - met
        left = dt * (1.0 - met)
        w_met = w_m + met * (free_m - w_m)
        x_met = x_m + met * half * (w_m + w_met)
        w = (c.j_m * w_met + c.j_o * (w_o + met * (free_o - w_o))) / j
        jump = w - w_met
        w_m, until, rate = through_rest(
            w, act_m + act_o, before_m + act_o, j, static_m + static_o, dynamic_m + dynamic_o, left
        )
        if until < 1.0 and twist * w > 0.0:
            # at rest the motor leaves the face that it pushed, and the output stays where it is
            w_m, rate = set_off(act_m, c.j_m, static_m, dynamic_m, left * (1.0 - until))
            x_m, x_o = x_met + 0.5 * left * (w + w_m), x_met - face + 0.5 * left * until * w
            w_o, x_o = 0.0, min(max(x_o, x_m - m.half_gap), x_m + m.half_gap)
        else:
            x_m = x_met + 0.5 * left * (w + w_m)
            w_o, x_o = w_m, x_m - face

    start = after
    if remains > 0.0:
        # after an impact the current goes for what the speed loop asks then, and pushes both
        asked = min(max(i_ref - g * jump, -c.current_limit), c.current_limit)
        change = min(max(asked - after, -remains * fall), remains * rise)
        start = after + change - 0.5 * (rise if asked > after else -fall)
        beside = 0.5 * remains * change
        after += beside
        pushed = dt * kappa * beside / (c.j_m + c.j_o)
        w_m, w_o = w_m + pushed, w_o + pushed
    if x_o <= c.low:
        x_o, w_o = c.low, max(w_o, 0.0)
    elif x_o >= c.high:
        x_o, w_o = c.high, min(w_o, 0.0)
    if x_m <= c.low - m.half_gap:
        x_m, w_m = c.low - m.half_gap, max(w_m, 0.0)
    elif x_m >= c.high + m.half_gap:
        x_m, w_m = c.high + m.half_gap, min(w_m, 0.0)
    return after, w_m, x_m, w_o, x_o, dt * rate, start
