"""Trapezoidal brushless motor: sectors, EMF shapes, faults of the windings and of the rotor.

docs/models.md has the equations and their sources ("Inverter and phases", "Truer forms"). Phases
k = 0, 1, 2 are a, b, c.

A loop of shorted turns answers within mu^2 L'/(R_f + mu R), for few turns far below any step: both
models advance its current by backward Euler, i_f <- remains + follows i, with the phase current
``i`` at the end of the step.
"""

import math

import numpy as np

from ematwin.numerics.compile import part, step
from ematwin.numerics.scalar import ROOT_3, THIRD_TURN, clip, fifth, seventh, sincos

SIXTH_TURN = math.pi / 3.0
SINE = 2.0 * math.pi / (3.0 * math.sqrt(3.0))
KEPT_5 = 3.0 * math.sqrt(3.0) / (10.0 * math.pi)
KEPT_7 = 3.0 * math.sqrt(3.0) / (14.0 * math.pi)


@step
def trapezoid(theta):
    """EMF shape f: flat at +1 over 30 to 150 degrees, at -1 over 210 to 330, linear between."""
    turns = theta / (2.0 * math.pi)
    # distance from the middle of the positive flat (90 degrees), in sixths of a turn: 0 to 3
    x = 6.0 * abs((turns - 0.25) - np.floor(turns - 0.25 + 0.5))
    return clip(3.0 - 2.0 * x, -1.0, 1.0)


@step
def hall_sector(theta_e):
    """Sector 0 to 5 of the electrical angle, as a float; sector s spans 30 + 60 s degrees on."""
    s = np.floor(theta_e / SIXTH_TURN - 0.5)
    return s - 6.0 * np.floor(s / 6.0)


@step
def offset_turned(theta_m, turning):
    """Sine and cosine of the turned offset; a share ``turning`` of it turns with the rotor."""
    s, c = sincos(theta_m)
    return turning * s, turning * c + (1.0 - turning)


@step
def gap_factors(theta_m, zeta_cos, zeta_sin, turning):
    """Factors of the phases by eccentricity, of zeta cos(phi) and zeta sin(phi)."""
    s, c = offset_turned(theta_m, turning)
    along = c * zeta_cos - s * zeta_sin  # zeta cos(theta_m + phi), where all of it turns
    across = 0.5 * ROOT_3 * (s * zeta_cos + c * zeta_sin)  # times sin(2 pi/3)
    return 1.0 + along, 1.0 - 0.5 * along + across, 1.0 - 0.5 * along - across


@step
def emf_constants(theta_m, fault, c):
    """kappa_k of the three phases, V s/rad (equally N m/A)."""
    theta_e = c.pole_pairs * theta_m
    gap_a, gap_b, gap_c = gap_factors(theta_m, fault.zeta_cos, fault.zeta_sin, c.turning)
    return (
        fault.h_a * c.k_e * gap_a * trapezoid(theta_e),
        fault.h_b * c.k_e * gap_b * trapezoid(theta_e - THIRD_TURN),
        fault.h_c * c.k_e * gap_c * trapezoid(theta_e - 2.0 * THIRD_TURN),
    )


@step
def phase_inductance(h, inductance, leakage):
    """Inductance of a phase with a share ``h`` of its turns left, H."""
    return (h * h * (1.0 - leakage) + leakage) * inductance


@part
def split_shorts(fault, loops):
    """Shares (3) of turns left, and shares in a loop, of the phases."""
    h = fault.h_a, fault.h_b, fault.h_c
    mu = loops * (1.0 - h[0]), loops * (1.0 - h[1]), loops * (1.0 - h[2])
    return (h[0] + mu[0], h[1] + mu[1], h[2] + mu[2]), mu


@part
def loop_answer(mu, loop, i, e, resistance, turns_inductance, contact, dt):
    """Loop current after ``dt``: ``remains`` (A) and the share it ``follows`` of the phase current.

    ``loop`` and ``i`` are the currents before, A; ``e`` is the EMF of the whole phase, V.
    """
    linked = mu * turns_inductance
    inverse = 1.0 / (mu * linked + dt * (contact + mu * resistance))
    remains = (mu * linked * loop - linked * i + dt * mu * e) * inverse
    return remains, (linked + dt * mu * resistance) * inverse


@part
def truer_shapes(theta_e, rounding, h_5, h_7):
    """EMF shapes f_r of the three phases."""
    if rounding == 0.0 and h_5 == 0.0 and h_7 == 0.0:
        return (
            trapezoid(theta_e),
            trapezoid(theta_e - THIRD_TURN),
            trapezoid(theta_e - 2.0 * THIRD_TURN),
        )
    s, c = sincos(theta_e)
    s_5, c_5 = s * fifth(s * s), c * fifth(c * c)
    s_7, c_7 = s * seventh(s * s), -c * seventh(c * c)
    kept = 1.0 + KEPT_5 * h_5 + KEPT_7 * h_7
    flat = kept * (1.0 - rounding)
    # a fifth harmonic runs backwards: 5 (theta - 120 degrees) is 5 theta + 120 degrees
    sine = kept * rounding * SINE
    first = sine * s + h_5 * s_5 + h_7 * s_7
    across = 0.5 * ROOT_3 * (sine * c - h_5 * c_5 + h_7 * c_7)
    return (
        flat * trapezoid(theta_e) + first,
        flat * trapezoid(theta_e - THIRD_TURN) - 0.5 * first - across,
        flat * trapezoid(theta_e - 2.0 * THIRD_TURN) - 0.5 * first + across,
    )


@part
def truer_emf_constants(theta_m, h, fault, c, truer):
    """kappa_k of the three phases, V s/rad; ``h`` (3) are the shares of their turns left."""
    gap_a, gap_b, gap_c = gap_factors(theta_m, fault.zeta_cos, fault.zeta_sin, c.turning)
    f_a, f_b, f_c = truer_shapes(
        c.pole_pairs * theta_m, truer.emf_rounding, truer.emf_harmonic_5, truer.emf_harmonic_7
    )
    k_e = c.k_e
    if truer.torque_ripple_share != 0.0:
        s, _ = sincos(truer.torque_ripple_cycles * theta_m + truer.torque_ripple_phase)
        k_e *= 1.0 + truer.torque_ripple_share * s
    return h[0] * k_e * gap_a * f_a, h[1] * k_e * gap_b * f_b, h[2] * k_e * gap_c * f_c


@part
def torque_of_cogging(theta_m, truer):
    """Cogging torque on the rotor, N m."""
    if truer.cogging_torque == 0.0:
        return 0.0
    s, _ = sincos(truer.cogging_cycles * theta_m + truer.cogging_phase)
    return -truer.cogging_torque * s
