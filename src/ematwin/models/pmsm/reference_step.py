"""One step of the reference model: three phases in the stator's frame, some microseconds.

docs/pmsm.md, "Reference model". The state of the windings is the flux that their currents make, in
the stator's frame. EMF, connectors, legs and shorted loops are computed for each phase;
the explicit midpoint rule advances all of them.
"""

from typing import NamedTuple

from ematwin.models.pmsm.monitor_step import advance_with_bristles, leg_error
from ematwin.numerics.compile import part, step
from ematwin.numerics.scalar import ROOT_3, clip, fifth, lag, seventh, sincos


class ReferenceState(NamedTuple):
    """State of the reference model, and its energies since the start."""

    psi_alpha: float  # Wb
    psi_beta: float
    j_a: float  # A, what shorted loops draw: mu i_f
    j_b: float
    j_c: float
    w_m: float  # rad/s
    theta_m: float  # rad
    w_o: float
    theta_o: float
    e_electrical: float  # J, taken in at the terminals
    e_copper: float  # J, lost in windings, connectors and shorts
    e_mechanical: float  # J, torque of the gap times speed
    bent_m: float  # rad, of the bristles between motor and housing
    bent_o: float
    warmer: float  # share of the resistance at the start that windings have gained


class Windings(NamedTuple):
    """Rates of the windings at an instant."""

    d_alpha: float  # V, change of the flux
    d_beta: float
    u_a: float  # V, over all turns of a phase
    u_b: float
    u_c: float
    torque: float  # N m
    taken: float  # W, in at the terminals
    lost: float  # W
    heat: float  # W, of that in windings and shorts


@step
def phase_emf(sine, wider, c):
    """EMF over speed of a phase, V s/rad.

    ``sine`` of the electrical angle from the phase; ``wider`` is how much more flux eccentricity
    leads through it.
    """
    s_2 = sine * sine
    return -c.k_e * (1.0 + wider) * sine * (1.0 + c.h_5 * fifth(s_2) + c.h_7 * seventh(s_2))


@step
def currents_of(psi_alpha, psi_beta, s, co, c):
    """Currents that make a flux: in the stator's frame, and in that of the rotor."""
    i_d = (co * psi_alpha + s * psi_beta) / c.l_d
    i_q = (co * psi_beta - s * psi_alpha) / c.l_q
    return co * i_d - s * i_q, s * i_d + co * i_q, i_d, i_q


@step
def phase_currents(now, c):
    """Currents of phases a and b at the terminals, of a `ReferenceState`, A."""
    s, co = sincos(c.pole_pairs * now.theta_m)
    x, y, _, _ = currents_of(now.psi_alpha, now.psi_beta, s, co, c)
    drawn = (now.j_a + now.j_b + now.j_c) / 3.0
    return x - drawn + now.j_a, -0.5 * x + 0.5 * ROOT_3 * y - drawn + now.j_b


@part
def windings(psi_alpha, psi_beta, j_a, j_b, j_c, w_m, theta_m, v_a, v_b, v_c, resistance, c):
    """`Windings` at a state, under leg voltages, with the present ``resistance`` of a phase."""
    s, co = sincos(c.pole_pairs * theta_m)
    x, y, i_d, i_q = currents_of(psi_alpha, psi_beta, s, co, c)
    drawn = (j_a + j_b + j_c) / 3.0
    # of all turns, weighed by their number; they add up to -3 drawn
    t_a = x - drawn
    t_b = -0.5 * x + 0.5 * ROOT_3 * y - drawn
    t_c = -0.5 * x - 0.5 * ROOT_3 * y - drawn
    i_a = t_a + j_a
    i_b = t_b + j_b
    i_c = t_c + j_c
    w_a, w_b, w_c = v_a - leg_error(i_a, c), v_b - leg_error(i_b, c), v_c - leg_error(i_c, c)
    s_m, c_m = sincos(theta_m)
    e_x = c.static_x + c.dynamic_x * c_m - c.dynamic_y * s_m
    e_y = 0.5 * ROOT_3 * (c.static_y + c.dynamic_x * s_m + c.dynamic_y * c_m)
    across = 0.5 * ROOT_3 * co
    k_a = phase_emf(s, e_x, c)
    k_b = phase_emf(-0.5 * s - across, e_y - 0.5 * e_x, c)
    k_c = phase_emf(-0.5 * s + across, -e_y - 0.5 * e_x, c)
    # voltages over the turns, the star point's taken off: what the connectors leave
    n_a = w_a - c.added_a * i_a
    n_b = w_b - c.added_b * i_b
    n_c = w_c - c.added_c * i_c
    mean = (n_a + n_b + n_c) / 3.0
    k_0 = (k_a + k_b + k_c) / 3.0
    d_alpha = n_a - mean - w_m * (k_a - k_0) - resistance * x
    d_beta = (n_b - n_c - w_m * (k_b - k_c)) / ROOT_3 - resistance * y
    torque = (
        k_a * t_a + k_b * t_b + k_c * t_c
        + 1.5 * c.pole_pairs * (c.l_d - c.l_q) * i_d * i_q
    )  # fmt: skip
    taken = w_a * i_a + w_b * i_b + w_c * i_c
    lost = (
        (resistance + c.added_a) * i_a * i_a - 2.0 * resistance * i_a * j_a
        + c.loss_a * j_a * j_a
        + (resistance + c.added_b) * i_b * i_b - 2.0 * resistance * i_b * j_b
        + c.loss_b * j_b * j_b
        + (resistance + c.added_c) * i_c * i_c - 2.0 * resistance * i_c * j_c
        + c.loss_c * j_c * j_c
    )  # fmt: skip
    heat = lost - c.added_a * i_a * i_a - c.added_b * i_b * i_b - c.added_c * i_c * i_c
    zero = w_m * k_0 - mean
    return Windings(d_alpha, d_beta, n_a + zero, n_b + zero, n_c + zero, torque, taken, lost, heat)


@part
def leg_errors(now, c):
    """What dead time and devices take from each leg, V."""
    i_a, i_b = phase_currents(now, c)
    return leg_error(i_a, c), leg_error(i_b, c), leg_error(-i_a - i_b, c)


@part
def reference_step(now, v_a, v_b, v_c, load, c, dt):
    """Advance by ``dt`` under leg voltages (V) and a load (N m); `ReferenceState`."""
    half = 0.5 * dt
    resistance = (1.0 + now.warmer) * c.resistance
    first = windings(
        now.psi_alpha, now.psi_beta, now.j_a, now.j_b, now.j_c, now.w_m, now.theta_m,
        v_a, v_b, v_c, resistance, c,
    )  # fmt: skip
    j_a = now.j_a + (1.0 - c.decay_a) * (c.loop_a * first.u_a - now.j_a)
    j_b = now.j_b + (1.0 - c.decay_b) * (c.loop_b * first.u_b - now.j_b)
    j_c = now.j_c + (1.0 - c.decay_c) * (c.loop_c * first.u_c - now.j_c)
    then = windings(
        now.psi_alpha + half * first.d_alpha, now.psi_beta + half * first.d_beta,
        0.5 * (now.j_a + j_a), 0.5 * (now.j_b + j_b), 0.5 * (now.j_c + j_c),
        now.w_m, now.theta_m + half * now.w_m, v_a, v_b, v_c, resistance, c,
    )  # fmt: skip
    motion, bent_m, bent_o = advance_with_bristles(now, then.torque, load, c, dt)
    return ReferenceState(
        now.psi_alpha + dt * then.d_alpha,
        now.psi_beta + dt * then.d_beta,
        now.j_a + (1.0 - c.decay_a) * (c.loop_a * then.u_a - now.j_a),
        now.j_b + (1.0 - c.decay_b) * (c.loop_b * then.u_b - now.j_b),
        now.j_c + (1.0 - c.decay_c) * (c.loop_c * then.u_c - now.j_c),
        motion.w_m, motion.theta_m, motion.w_o, motion.theta_o,
        now.e_electrical + dt * then.taken,
        now.e_copper + dt * then.lost,
        now.e_mechanical + dt * then.torque * now.w_m,
        bent_m, bent_o, lag(now.warmer, c.heating * then.heat, c.heating_time, dt),
    )  # fmt: skip


@step
def leg_voltages(v_alpha, v_beta, v_supply):
    """Mean voltages of the legs above the middle of the link, by space-vector modulation.

    The common part centres the largest and the smallest (Holmes and Lipo 2003, Pulse Width
    Modulation for Power Converters, section 6.3); a leg gives half of the link at most.
    """
    v_a = v_alpha
    v_b = -0.5 * v_alpha + 0.5 * ROOT_3 * v_beta
    v_c = -v_a - v_b
    common = 0.5 * (max(v_a, max(v_b, v_c)) + min(v_a, min(v_b, v_c)))
    half = 0.5 * v_supply
    return (
        clip(v_a - common, -half, half),
        clip(v_b - common, -half, half),
        clip(v_c - common, -half, half),
    )


@part
def applied_step(now, v_alpha, v_beta, load, c, dt):
    """As `reference_step`, under the voltage vector that the legs are to give."""
    v_a, v_b, v_c = leg_voltages(v_alpha, v_beta, c.v_supply)
    return reference_step(now, v_a, v_b, v_c, load, c, dt)
