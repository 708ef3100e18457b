"""Motor of the reference model beyond the paper: shape of the EMF, torque ripple, cogging.

In place of the trapezoid f of `ematwin.models.bldc.motor`,

    f_r = (1 + 3 sqrt(3)/(10 pi) h_5 + 3 sqrt(3)/(14 pi) h_7) ((1 - r) f + r A sin)
          + h_5 sin(5 .) + h_7 sin(7 .),   A = 2 pi/(3 sqrt(3)).

The factors give each shape the mean of the trapezoid over the 120 degrees in which a phase
conducts, so that ``r``, ``h_5`` and ``h_7`` change the shape and not the torque constant. Derived
here.

A flux that varies with the rotor's turn alike in all phases changes EMF and torque in the same
proportion, as no energy comes from it: kappa_k (1 + rho sin(M theta_m + phi_r)).

Magnets are drawn to teeth with as many cycles in a turn as both have in common:
T_cog = -A sin(N theta_m + phi_c) does no work over a turn, whether a current flows or not. The
fundamental of what textbooks on permanent-magnet machines give as a Fourier series.
"""

import math

from ematwin.models.bldc.motor import gap_factors, trapezoid
from ematwin.numerics.compile import part
from ematwin.numerics.scalar import fifth, seventh, sincos

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)
SINE = 2.0 * math.pi / (3.0 * math.sqrt(3.0))
_THIRD = 2.0 * math.pi / 3.0
KEPT_5 = 3.0 * math.sqrt(3.0) / (10.0 * math.pi)
KEPT_7 = 3.0 * math.sqrt(3.0) / (14.0 * math.pi)


@part
def truer_shapes(theta_e, rounding, h_5, h_7):
    """EMF shapes f_r of the three phases."""
    if rounding == 0.0 and h_5 == 0.0 and h_7 == 0.0:
        return trapezoid(theta_e), trapezoid(theta_e - _THIRD), trapezoid(theta_e - 2.0 * _THIRD)
    s, c = sincos(theta_e)
    s_5, c_5 = s * fifth(s * s), c * fifth(c * c)
    s_7, c_7 = s * seventh(s * s), -c * seventh(c * c)
    kept = 1.0 + KEPT_5 * h_5 + KEPT_7 * h_7
    flat = kept * (1.0 - rounding)
    # a fifth harmonic runs backwards: 5 (theta - 120 degrees) is 5 theta + 120 degrees
    sine = kept * rounding * SINE
    first = sine * s + h_5 * s_5 + h_7 * s_7
    across = _HALF_SQRT3 * (sine * c - h_5 * c_5 + h_7 * c_7)
    return (
        flat * trapezoid(theta_e) + first,
        flat * trapezoid(theta_e - _THIRD) - 0.5 * first - across,
        flat * trapezoid(theta_e - 2.0 * _THIRD) - 0.5 * first + across,
    )


@part
def truer_emf_constants(theta_m, h_a, h_b, h_c, fault, c, truer):
    """kappa_k of the three phases, V s/rad; ``h_k`` is the share of their turns that is left."""
    gap_a, gap_b, gap_c = gap_factors(theta_m, fault.zeta_cos, fault.zeta_sin, c.turning)
    f_a, f_b, f_c = truer_shapes(
        c.pole_pairs * theta_m, truer.rounding, truer.harmonic_5, truer.harmonic_7
    )
    k_e = c.k_e
    if truer.ripple != 0.0:
        s, _ = sincos(truer.ripple_cycles * theta_m + truer.ripple_phase)
        k_e *= 1.0 + truer.ripple * s
    return h_a * k_e * gap_a * f_a, h_b * k_e * gap_b * f_b, h_c * k_e * gap_c * f_c


@part
def cogging_torque(theta_m, truer):
    """Cogging torque on the rotor, N m."""
    if truer.cogging == 0.0:
        return 0.0
    s, _ = sincos(truer.cogging_cycles * theta_m + truer.cogging_phase)
    return -truer.cogging * s
