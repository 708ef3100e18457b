"""Motor of the reference model beyond the paper: a rounded EMF, and cogging.

In place of the trapezoid f of `ematwin.models.bldc.motor`,

    f_r = (1 - r) f + r A sin,   A = 2 pi/(3 sqrt(3)).

``A`` gives the sine the mean torque of the trapezoid over the 120 degrees in which a pair conducts,
so that ``r`` changes the shape and not the torque constant. Derived here.

Magnets are drawn to teeth with as many cycles in a turn as both have in common:
T_cog = -A sin(N theta_m + phi_c) does no work over a turn, whether a current flows or not. The
fundamental of what textbooks on permanent-magnet machines give as a Fourier series.
"""

import math

from ematwin.models.bldc.motor import gap_factors, trapezoid
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import sincos

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)
_SINE = 2.0 * math.pi / (3.0 * math.sqrt(3.0))
_THIRD = 2.0 * math.pi / 3.0


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
    gap_a, gap_b, gap_c = gap_factors(theta_m, fault.zeta_cos, fault.zeta_sin, c.turning)
    f_a, f_b, f_c = rounded_shapes(c.pole_pairs * theta_m, truer.rounding)
    return h_a * c.k_e * gap_a * f_a, h_b * c.k_e * gap_b * f_b, h_c * c.k_e * gap_c * f_c


@part
def cogging_torque(theta_m, truer):
    """Cogging torque on the rotor, N m."""
    s, _ = sincos(truer.cogging_cycles * theta_m + truer.cogging_phase)
    return -truer.cogging * s
