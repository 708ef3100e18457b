"""The two phases that conduct, in series: what a step of the monitor model asks for in each sector.

With p and n the conducting phases, h_k the share of turns left, zeta the eccentricity ratio and phi
its direction (`ematwin.models.bldc.motor`),

    R_eq = (h_p + h_n) R,   L_eq = L_p + L_n,
    kappa_eq = k_e sum over p, n of h_k (1 + zeta cos(theta_m + phi - 2 pi k/3))
             = k_e (h_p + h_n + C cos theta_m + S sin theta_m).

On the 120 degree flats |f| = 1, and zeta is 1 at most, so that no magnitude is left to take. All
but the angle is the same for as long as a candidate is simulated: three pairs, worked out once.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.motor import phase_inductance
from ematwin.numerics.compile import step
from ematwin.numerics.scalar import sincos

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)
_SECTORS_PER_RAD = 3.0 / math.pi
_THIRD = 1.0 / 3.0


class Pairs(NamedTuple):
    """Each pair of phases, by the one that is off."""

    turns_a: float  # share of turns left, sum of both
    turns_b: float
    turns_c: float
    mobility_a: float  # 1/H, inverse of L_eq
    mobility_b: float
    mobility_c: float
    cosine_a: float  # C
    cosine_b: float
    cosine_c: float
    sine_a: float  # S
    sine_b: float
    sine_c: float


@step
def pairs_of(fault, c):
    """The three pairs of a candidate."""
    l_a = phase_inductance(fault.h_a, c.inductance, c.leakage)
    l_b = phase_inductance(fault.h_b, c.inductance, c.leakage)
    l_c = phase_inductance(fault.h_c, c.inductance, c.leakage)
    # zeta cos and zeta sin of phi - 2 pi k/3
    near_a, far_a = fault.zeta_cos, fault.zeta_sin
    near_b = -0.5 * near_a + _HALF_SQRT3 * far_a
    far_b = -0.5 * far_a - _HALF_SQRT3 * near_a
    near_c = -0.5 * near_a - _HALF_SQRT3 * far_a
    far_c = -0.5 * far_a + _HALF_SQRT3 * near_a
    return Pairs(
        fault.h_b + fault.h_c,
        fault.h_c + fault.h_a,
        fault.h_a + fault.h_b,
        1.0 / (l_b + l_c),
        1.0 / (l_c + l_a),
        1.0 / (l_a + l_b),
        fault.h_b * near_b + fault.h_c * near_c,
        fault.h_c * near_c + fault.h_a * near_a,
        fault.h_a * near_a + fault.h_b * near_b,
        -fault.h_b * far_b - fault.h_c * far_c,
        -fault.h_c * far_c - fault.h_a * far_a,
        -fault.h_a * far_a - fault.h_b * far_b,
    )


@step
def equivalent_phase(theta_m, pairs, c):
    """R_eq (ohm), 1/L_eq (1/H) and kappa_eq (V s/rad) at a rotor angle."""
    sector = np.floor(c.pole_pairs * _SECTORS_PER_RAD * theta_m - 0.5)
    third = sector - 3.0 * np.floor(sector * _THIRD)  # sectors 0 and 3: c is off, 1 and 4: b
    off_c = third == 0.0
    off_b = third == 1.0
    turns = pairs.turns_c if off_c else (pairs.turns_b if off_b else pairs.turns_a)
    mobility = pairs.mobility_c if off_c else (pairs.mobility_b if off_b else pairs.mobility_a)
    cosine = pairs.cosine_c if off_c else (pairs.cosine_b if off_b else pairs.cosine_a)
    sine = pairs.sine_c if off_c else (pairs.sine_b if off_b else pairs.sine_a)
    s, co = sincos(theta_m)
    return turns * c.resistance, mobility, (turns + cosine * co + sine * s) * c.k_e


@step
def lane_pairs(paired, n):
    """The pairs of lane ``n`` from an array (12, lanes), a row for each field."""
    return Pairs(
        paired[0, n], paired[1, n], paired[2, n], paired[3, n], paired[4, n], paired[5, n],
        paired[6, n], paired[7, n], paired[8, n], paired[9, n], paired[10, n], paired[11, n],
    )  # fmt: skip
