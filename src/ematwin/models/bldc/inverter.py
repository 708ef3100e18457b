"""Three-leg inverter with freewheeling diodes, star point free, and the phases behind it.

Each leg is driven high (1), low (-1) or off (0); values in between are means of pulse-width
modulation. The current of an off leg decays through a diode, then stays zero until the voltage at
its terminal passes a rail by the forward drop of a diode.

With backward Euler for the loops of shorted turns a phase looks to the bridge like one with another
inductance and EMF, so that the bridge, its diodes included, is the same with them and without.
"""

from typing import NamedTuple

from ematwin.models.bldc.motor import loop_answer, phase_inductance
from ematwin.numerics.compile import part, step
from ematwin.numerics.scalar import clip


@step
def _sectors_apart(sector, middle):
    """Distance of two sectors around the circle, 0 to 3."""
    away = abs(sector - middle)
    return min(away, 6.0 - away)


@step
def gate_signals(sector, pair_sign):
    """Drive of the legs a, b, c: 1 high, -1 low, 0 off.

    In sector s the pair is (a,b) (a,c) (b,c) (b,a) (c,a) (c,b); ``pair_sign`` = 1 puts its first
    leg high and its second low, -1 the other way round. Between two sectors, up to 6, it is the
    mean of both pairs by their shares.
    """
    g_a = clip(1.5 - _sectors_apart(sector, 0.5), -1.0, 1.0)
    g_b = clip(1.5 - _sectors_apart(sector, 2.5), -1.0, 1.0)
    return g_a * pair_sign, g_b * pair_sign, -(g_a + g_b) * pair_sign


@step
def hysteresis(i, i_ref, half_band, pair_sign):
    """Sign of the bridge after the comparator: the last one within the band."""
    falls = i > i_ref + half_band
    rises = i < i_ref - half_band
    held = 1.0 if rises else pair_sign
    return -1.0 if falls else held


@step
def pair_current(gate_sector, i_a, i_b, i_c):
    """Current that the regulator sees, A: max |i_k|, with the sign of the driven pair."""
    g_a, g_b, g_c = gate_signals(gate_sector, 1.0)
    size = 0.5 * (abs(i_a) + abs(i_b) + abs(i_c))
    return size if g_a * i_a + g_b * i_b + g_c * i_c >= 0.0 else -size


@step
def _free_leg(i, v_open, v_supply, v_diode):
    """Terminal voltage of an off leg, and whether it conducts.

    ``v_open`` is the voltage that the terminal would have without current.
    """
    lower = (i > 0.0) | ((i == 0.0) & (v_open < -v_diode))
    upper = (i < 0.0) | ((i == 0.0) & (v_open > v_supply + v_diode))
    v = -v_diode if lower else (v_supply + v_diode if upper else v_open)
    return v, lower | upper


@step
def _star_point(u_a, u_b, u_c, on_a, on_b, on_c, y_a, y_b, y_c):
    """Voltage of the star point, V, by what conducting legs leave over their inductances."""
    w_a = y_a if on_a else 0.0
    w_b = y_b if on_b else 0.0
    w_c = y_c if on_c else 0.0
    return (w_a * u_a + w_b * u_b + w_c * u_c) / (w_a + w_b + w_c)


@step
def terminal_voltages(g_a, g_b, g_c, i_a, i_b, i_c, e_a, e_b, e_c, r_a, r_b, r_c,
                      y_a, y_b, y_c, v_supply, v_diode):  # fmt: skip
    """Terminal voltages and star point, V; gives ``v_a, v_b, v_c, v_n, on_a, on_b, on_c``.

    ``e_k`` are back-EMFs and ``y_k = 1/L_k``. Of the three legs at most one is off.
    """
    v_a = 0.5 * (1.0 + g_a) * v_supply
    v_b = 0.5 * (1.0 + g_b) * v_supply
    v_c = 0.5 * (1.0 + g_c) * v_supply
    on_a, on_b, on_c = g_a != 0.0, g_b != 0.0, g_c != 0.0
    v_n = _star_point(
        v_a - r_a * i_a - e_a, v_b - r_b * i_b - e_b, v_c - r_c * i_c - e_c, on_a, on_b, on_c,
        y_a, y_b, y_c,
    )  # fmt: skip
    # the off leg: open-circuit voltage is star point plus its EMF
    f_a, free_a = _free_leg(i_a, v_n + e_a, v_supply, v_diode)
    f_b, free_b = _free_leg(i_b, v_n + e_b, v_supply, v_diode)
    f_c, free_c = _free_leg(i_c, v_n + e_c, v_supply, v_diode)
    v_a = v_a if on_a else f_a
    v_b = v_b if on_b else f_b
    v_c = v_c if on_c else f_c
    on_a, on_b, on_c = on_a | free_a, on_b | free_b, on_c | free_c
    v_n = _star_point(
        v_a - r_a * i_a - e_a, v_b - r_b * i_b - e_b, v_c - r_c * i_c - e_c, on_a, on_b, on_c,
        y_a, y_b, y_c,
    )  # fmt: skip
    return v_a, v_b, v_c, v_n, on_a, on_b, on_c


@step
def advance_phase(i, v, v_n, e, r, y, on, dt):
    """Phase current after ``dt``, as if its diode, if it flows through one, never blocked."""
    return i + dt * y * (v - v_n - r * i - e) if on else 0.0


@step
def share_until_blocked(i, i_next, driven):
    """Share of a step after which the diode of an off leg blocks, because its current is zero."""
    return i / (i - i_next) if (not driven) & (i * i_next < 0.0) else 1.0


class Electrical(NamedTuple):
    """Constants of windings and bridge over a step."""

    resistance: float  # ohm, one phase
    inductance: float  # H, one phase
    leakage: float
    short_resistance: float  # ohm
    v_supply: float  # V
    v_diode: float  # V


class Supply(NamedTuple):
    """Voltages and current of the bridge, means over a step."""

    v_a: float  # V, terminals of the motor above the lower rail
    v_b: float
    v_c: float
    i_bus: float  # A, out of the supply
    v_bus: float  # V


@part
def phase_constants(h_a, h_b, h_c, c):
    """Resistances and inverse inductances of phases with shares ``h`` of their turns left."""
    return (
        h_a * c.resistance,
        h_b * c.resistance,
        h_c * c.resistance,
        1.0 / phase_inductance(h_a, c.inductance, c.leakage),
        1.0 / phase_inductance(h_b, c.inductance, c.leakage),
        1.0 / phase_inductance(h_c, c.inductance, c.leakage),
    )


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
    m_a, m_b, m_c = 0.5 * (i_a + n_a), 0.5 * (i_b + n_b), 0.5 * (i_c + n_c)
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
    m_a, m_b, m_c = 0.5 * (i_a + n_a), 0.5 * (i_b + n_b), 0.5 * (i_c + n_c)
    if share < 1.0:  # the rest of the step, with the off leg at zero
        rest = 1.0 - share
        _, p_a, p_b, p_c, more_taken, more_lost, then = _conduct(
            n_a, n_b, n_c, e_a, e_b, e_c, g_a, g_b, g_c, phases, c, rest * dt
        )
        m_a = share * m_a + rest * 0.5 * (n_a + p_a)
        m_b = share * m_b + rest * 0.5 * (n_b + p_b)
        m_c = share * m_c + rest * 0.5 * (n_c + p_c)
        n_a, n_b, n_c = p_a, p_b, p_c
        taken, lost = taken + more_taken, lost + more_lost
        supply = Supply(
            share * supply.v_a + rest * then.v_a,
            share * supply.v_b + rest * then.v_b,
            share * supply.v_c + rest * then.v_c,
            share * supply.i_bus + rest * then.i_bus,
            c.v_supply,
        )
    return n_a, n_b, n_c, m_a, m_b, m_c, taken, lost, supply


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
