"""Three-leg inverter with freewheeling diodes, star point free, and the phases behind it.

Each leg is driven high (1), low (-1) or off (0); values in between are means of pulse-width
modulation. The current of an off leg decays through a diode, then stays zero until the voltage at
its terminal passes a rail by the forward drop of a diode.

With backward Euler for the loops of shorted turns a phase looks to the bridge like one with another
inductance and EMF, so that the bridge, its diodes included, is the same with them and without.

Quantities of the three phases are triples.
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

    v: tuple[float, float, float]  # V, terminals of the motor above the lower rail
    i_bus: float  # A, out of the supply
    v_bus: float  # V


@step
def mixed(x, y, share):
    """Triple of a ``share`` of ``x``, the rest of ``y``."""
    rest = 1.0 - share
    return share * x[0] + rest * y[0], share * x[1] + rest * y[1], share * x[2] + rest * y[2]


@step
def dot(x, y):
    """Sum of the products of two triples."""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@step
def _terminal(v, i, v_open, driven, v_supply, v_diode):
    """Voltage of a terminal that has ``v_open`` without current; whether its leg conducts."""
    lower = (i > 0.0) | ((i == 0.0) & (v_open < -v_diode))
    upper = (i < 0.0) | ((i == 0.0) & (v_open > v_supply + v_diode))
    free = -v_diode if lower else (v_supply + v_diode if upper else v_open)
    return v if driven else free, driven | lower | upper


@step
def _star_point(v, i, e, r, y, on):
    """Voltage of the star point, V, by what conducting legs leave over their inductances."""
    w_a = y[0] if on[0] else 0.0
    w_b = y[1] if on[1] else 0.0
    w_c = y[2] if on[2] else 0.0
    left = v[0] - r[0] * i[0] - e[0], v[1] - r[1] * i[1] - e[1], v[2] - r[2] * i[2] - e[2]
    return dot((w_a, w_b, w_c), left) / (w_a + w_b + w_c)


@step
def terminal_voltages(g, i, e, r, y, v_supply, v_diode):
    """Terminal voltages (3) and star point, V, and which legs conduct (3).

    ``g`` drives the legs, of which at most one is off; ``e`` are back-EMFs and ``y_k = 1/L_k``.
    """
    v = 0.5 * (1.0 + g[0]) * v_supply, 0.5 * (1.0 + g[1]) * v_supply, 0.5 * (1.0 + g[2]) * v_supply
    driven = g[0] != 0.0, g[1] != 0.0, g[2] != 0.0
    v_n = _star_point(v, i, e, r, y, driven)
    # of the off leg the open-circuit voltage is star point plus its EMF
    v_a, on_a = _terminal(v[0], i[0], v_n + e[0], driven[0], v_supply, v_diode)
    v_b, on_b = _terminal(v[1], i[1], v_n + e[1], driven[1], v_supply, v_diode)
    v_c, on_c = _terminal(v[2], i[2], v_n + e[2], driven[2], v_supply, v_diode)
    v, on = (v_a, v_b, v_c), (on_a, on_b, on_c)
    if (on_a == driven[0]) & (on_b == driven[1]) & (on_c == driven[2]):
        return v, v_n, on
    return v, _star_point(v, i, e, r, y, on), on


@step
def _phase_after(i, v, v_n, e, r, y, on, g, dt):
    """Phase current after ``dt``, and the share of it after which an off leg's diode blocks."""
    # A badly shorted phase gains amperes in a microsecond: without this, a step would pass zero by
    # as much, and energy would be lost or made.
    after = i + dt * y * (v - v_n - r * i - e) if on else 0.0
    return after, i / (i - after) if (g == 0.0) & (i * after < 0.0) else 1.0


@part
def phase_constants(h, c):
    """Resistances and inverse inductances (3) of phases with shares ``h`` (3) of their turns."""
    r = h[0] * c.resistance, h[1] * c.resistance, h[2] * c.resistance
    return r, (
        1.0 / phase_inductance(h[0], c.inductance, c.leakage),
        1.0 / phase_inductance(h[1], c.inductance, c.leakage),
        1.0 / phase_inductance(h[2], c.inductance, c.leakage),
    )


@step
def _conduct(i, e, g, phases, c, dt):
    """Advance until a diode blocks: share done, currents, energies taken and lost, `Supply`."""
    r, y = phases
    v, v_n, on = terminal_voltages(g, i, e, r, y, c.v_supply, c.v_diode)
    n_a, share_a = _phase_after(i[0], v[0], v_n, e[0], r[0], y[0], on[0], g[0], dt)
    n_b, share_b = _phase_after(i[1], v[1], v_n, e[1], r[1], y[1], on[1], g[1], dt)
    n_c, share_c = _phase_after(i[2], v[2], v_n, e[2], r[2], y[2], on[2], g[2], dt)
    share = share_a * share_b * share_c  # at most one leg is off
    n = (
        i[0] + share * (n_a - i[0]) if share_a == 1.0 else 0.0,
        i[1] + share * (n_b - i[1]) if share_b == 1.0 else 0.0,
        i[2] + share * (n_c - i[2]) if share_c == 1.0 else 0.0,
    )
    m = mixed(i, n, 0.5)
    taken = share * dt * dot(v, m)
    lost = share * dt * (r[0] * m[0] * m[0] + r[1] * m[1] * m[1] + r[2] * m[2] * m[2])
    # through the upper switches, and back through the upper diodes
    above = (
        clip(v[0] / c.v_supply, 0.0, 1.0), clip(v[1] / c.v_supply, 0.0, 1.0),
        clip(v[2] / c.v_supply, 0.0, 1.0),
    )  # fmt: skip
    return share, n, taken, lost, Supply(v, dot(m, above), c.v_supply)


@part
def advance_bridge(i, e, g, phases, c, dt):
    """Phase currents after ``dt``; their means, the energies taken in and lost, the `Supply`."""
    share, n, taken, lost, supply = _conduct(i, e, g, phases, c, dt)
    m = mixed(i, n, 0.5)
    if share < 1.0:  # the rest of the step, with the off leg at zero
        rest = 1.0 - share
        _, p, more_taken, more_lost, then = _conduct(n, e, g, phases, c, rest * dt)
        m = mixed(m, mixed(n, p, 0.5), share)
        i_bus = share * supply.i_bus + rest * then.i_bus
        supply = Supply(mixed(supply.v, then.v, share), i_bus, c.v_supply)
        n, taken, lost = p, taken + more_taken, lost + more_lost
    return n, m, taken, lost, supply


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
def advance_shorted_bridge(i, loops, e, g, h, mu, c, dt):
    """`advance_bridge` with ``loops`` (3), A: these after ``dt`` and their means as well."""
    a = seen_phase(i[0], loops[0], e[0], h[0], mu[0], c, dt)
    b = seen_phase(i[1], loops[1], e[1], h[1], mu[1], c, dt)
    p = seen_phase(i[2], loops[2], e[2], h[2], mu[2], c, dt)
    n, m, taken, _, supply = advance_bridge(
        i, (a.e, b.e, p.e), g, ((a.r, b.r, p.r), (a.y, b.y, p.y)), c, dt
    )
    after = (
        a.remains + a.follows * n[0], b.remains + b.follows * n[1], p.remains + p.follows * n[2]
    )  # fmt: skip
    mean = mixed(loops, after, 0.5)
    lost = dt * (
        copper_loss(m[0], mean[0], mu[0], a.r, c.short_resistance)
        + copper_loss(m[1], mean[1], mu[1], b.r, c.short_resistance)
        + copper_loss(m[2], mean[2], mu[2], p.r, c.short_resistance)
    )
    return n, after, m, mean, taken, lost, supply
