"""Back-EMF with a rounded shape and an eccentricity that need not turn with the rotor.

    kappa_k = h_k k_e f_r(theta_e - 2 pi k/3) (1 + zeta (s cos(theta_m + phi - 2 pi k/3)
                                                        + (1 - s) cos(phi - 2 pi k/3))),
    f_r = (1 - r) f + r A sin,   A = 2 pi/(3 sqrt(3)).

The share ``s`` of the offset turns with the rotor (a bent shaft: dynamic eccentricity; 1 is the
paper's form), the rest is fixed in space (a bearing seat: static eccentricity), where each phase
keeps its own gap. ``A`` gives the sine the mean torque of the trapezoid over the 120 degrees in
which a pair conducts, so that ``r`` changes the shape and not the torque constant. Derived here.
"""

import math

from ematwin.models.bldc.motor import trapezoid
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import sincos

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)
_SINE = 2.0 * math.pi / (3.0 * math.sqrt(3.0))
_THIRD = 2.0 * math.pi / 3.0


@part
def gap_factors_between(theta_m, zeta_cos, zeta_sin, turning):
    """The factors of the three phases by eccentricity; arguments as in `gap_factors`."""
    s, c = sincos(theta_m)
    along = zeta_cos + turning * (c * zeta_cos - s * zeta_sin - zeta_cos)
    aside = zeta_sin + turning * (s * zeta_cos + c * zeta_sin - zeta_sin)
    across = _HALF_SQRT3 * aside
    return 1.0 + along, 1.0 - 0.5 * along + across, 1.0 - 0.5 * along - across


@part
def rounded_shapes(theta_e, rounding):
    """EMF shapes f_r of the three phases."""
    s, c = sincos(theta_e)
    flat = 1.0 - rounding
    sine = rounding * _SINE
    across = _HALF_SQRT3 * c
    return (
        flat * trapezoid(theta_e) + sine * s,
        flat * trapezoid(theta_e - _THIRD) + sine * (-0.5 * s - across),
        flat * trapezoid(theta_e - 2.0 * _THIRD) + sine * (-0.5 * s + across),
    )


@part
def truer_emf_constants(theta_m, h_a, h_b, h_c, fault, c, truer):
    """kappa_k of the three phases, V s/rad; ``h_k`` is the share of their turns that is left."""
    gap_a, gap_b, gap_c = gap_factors_between(
        theta_m, fault.zeta_cos, fault.zeta_sin, truer.turning
    )
    f_a, f_b, f_c = rounded_shapes(c.pole_pairs * theta_m, truer.rounding)
    return h_a * c.k_e * gap_a * f_a, h_b * c.k_e * gap_b * f_b, h_c * c.k_e * gap_c * f_c
