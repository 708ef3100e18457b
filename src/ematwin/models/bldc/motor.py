"""Trapezoidal brushless motor: sectors, EMF shapes, faults of the windings and of the rotor.

Phases k = 0, 1, 2 (a, b, c). With h_k the share of turns left, zeta the eccentricity ratio and
phi its direction (paper, section 6; docs/models.md):

    R_k = h_k R,   L_k = (h_k^2 (1 - l) + l) L,
    kappa_k = h_k k_e f(theta_e - 2 pi k/3) (1 + zeta (s cos(theta_m + phi - 2 pi k/3)
                                                      + (1 - s) cos(phi - 2 pi k/3))).

``l`` is the share of the inductance that lies outside the turns (leads, connections): it keeps a
fully shorted phase finite. The share ``s`` of the offset turns with the rotor (a bent shaft; 1 is
the paper's form), the rest is fixed in space (a bearing seat), so that each phase keeps its gap;
this is derived here.
"""

import math

import numpy as np

from ematwin.numerics.compile import step
from ematwin.numerics.scalar import ROOT_3, THIRD_TURN, clip, sincos

_SIXTH_TURN = math.pi / 3.0


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
    s = np.floor(theta_e / _SIXTH_TURN - 0.5)
    return s - 6.0 * np.floor(s / 6.0)


@step
def offset_turned(theta_m, turning):
    """Sine and cosine of the turned offset; a share ``turning`` of it turns with the rotor."""
    s, c = sincos(theta_m)
    return turning * s, turning * c + (1.0 - turning)


@step
def gap_factors(theta_m, zeta_cos, zeta_sin, turning):
    """The factors of the three phases by eccentricity, 1 + zeta (...) above.

    ``zeta_cos`` and ``zeta_sin`` are zeta cos(phi) and zeta sin(phi).
    """
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
