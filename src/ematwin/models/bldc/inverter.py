"""Three-leg inverter with freewheeling diodes, star point free, hysteresis regulation.

Each leg is driven high (1), low (-1) or off (0); values in between are means of pulse-width
modulation. The current of an off leg decays through a diode, then stays zero until the voltage at
its terminal passes a rail by the forward drop of a diode.
"""

from ematwin.numerics.compile import step
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
    """Current that the regulator sees, A: max |i_k|, with the sign of the driven pair.

    While commutation moves current from one leg to the next this is the current of the phase
    that both pairs share. The torque follows it.
    """
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
    ``v_n = sum(y_k (v_k - R_k i_k - e_k)) / sum(y_k)`` over the conducting legs, because their
    current slopes add up to zero.
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
    """Share of a step after which the diode of an off leg blocks, because its current is zero.

    A badly shorted phase gains amperes in a microsecond: without this, a step would pass zero by as
    much, and energy would be lost or made.
    """
    return i / (i - i_next) if (not driven) & (i * i_next < 0.0) else 1.0
