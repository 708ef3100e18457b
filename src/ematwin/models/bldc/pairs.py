"""The two conducting phases in series, for each sector of the monitor model.

With p and n the conducting phases, h_k the share of turns left, zeta the eccentricity ratio and phi
its direction (`ematwin.models.bldc.motor`),

    R_eq = (h_p + h_n) R,   L_eq = L_p + L_n,
    kappa_eq = k_e sum over p, n of h_k (1 + zeta cos(theta_m + phi - 2 pi k/3))
             = k_e (h_p + h_n + C cos theta_m + S sin theta_m),

with what `offset_turned` gives for sine and cosine where some of the offset is fixed in space.

On the 120 degree flats |f| = 1, and zeta is 1 at most, so that no magnitude is left to take. Only
the angle changes while a candidate is simulated. So the three pairs are computed once, as the pair
without c and the differences of the others from it. In a step with a commutation both pairs count
by their shares of the step.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.motor import offset_turned, phase_inductance
from ematwin.numerics.compile import step
from ematwin.numerics.scalar import ROOT_3, clip

_SECTORS_PER_RAD = 3.0 / math.pi
_STANDS = 1e-6  # sectors in a step


class Pairs(NamedTuple):
    """The pair of phases without c; and by how much those without a and without b differ."""

    turns: float  # share of turns left, sum of both
    turns_a: float
    turns_b: float
    mobility: float  # 1/H, inverse of L_eq
    mobility_a: float
    mobility_b: float
    cosine: float  # C
    cosine_a: float
    cosine_b: float
    sine: float  # S
    sine_a: float
    sine_b: float


@step
def pairs_of(fault, c):
    """The three pairs of a candidate."""
    l_a = phase_inductance(fault.h_a, c.inductance, c.leakage)
    l_b = phase_inductance(fault.h_b, c.inductance, c.leakage)
    l_c = phase_inductance(fault.h_c, c.inductance, c.leakage)
    # zeta cos and zeta sin of phi - 2 pi k/3
    near_a, far_a = fault.zeta_cos, fault.zeta_sin
    near_b = -0.5 * near_a + 0.5 * ROOT_3 * far_a
    far_b = -0.5 * far_a - 0.5 * ROOT_3 * near_a
    near_c = -0.5 * near_a - 0.5 * ROOT_3 * far_a
    far_c = -0.5 * far_a + 0.5 * ROOT_3 * near_a
    mobility = 1.0 / (l_a + l_b)
    cosine = fault.h_a * near_a + fault.h_b * near_b
    sine = -fault.h_a * far_a - fault.h_b * far_b
    return Pairs(
        fault.h_a + fault.h_b,
        fault.h_c - fault.h_a,
        fault.h_c - fault.h_b,
        mobility,
        1.0 / (l_b + l_c) - mobility,
        1.0 / (l_c + l_a) - mobility,
        cosine,
        fault.h_c * near_c - fault.h_a * near_a,
        fault.h_c * near_c - fault.h_b * near_b,
        sine,
        fault.h_a * far_a - fault.h_c * far_c,
        fault.h_b * far_b - fault.h_c * far_c,
    )


@step
def shares_off(theta_m, moved, pole_pairs):
    """The shares of a step in which phases a and b are off; else c is.

    ``theta_m`` is the angle in the middle of the step, rad, ``moved`` by how much it changes.
    """
    sectors = pole_pairs * _SECTORS_PER_RAD
    per_step = 1.0 / clip(abs(sectors * moved), _STANDS, 1.0)
    # from the middle of a sector without b, modulo three sectors: -1.5 to 1.5; a is next, then c
    from_b = sectors * theta_m - 2.0
    from_b -= 3.0 * np.floor(from_b * (1.0 / 3.0) + 0.5)
    from_a = from_b + (2.0 if from_b < -0.5 else -1.0)
    return (
        clip(0.5 + (0.5 - abs(from_a)) * per_step, 0.0, 1.0),
        clip(0.5 + (0.5 - abs(from_b)) * per_step, 0.0, 1.0),
    )


@step
def equivalent_phase(theta_m, moved, pairs, c):
    """R_eq (ohm), 1/L_eq (1/H) and kappa_eq (V s/rad) of a step; arguments as in `shares_off`."""
    off_a, off_b = shares_off(theta_m, moved, c.pole_pairs)
    turns = pairs.turns + off_a * pairs.turns_a + off_b * pairs.turns_b
    mobility = pairs.mobility + off_a * pairs.mobility_a + off_b * pairs.mobility_b
    cosine = pairs.cosine + off_a * pairs.cosine_a + off_b * pairs.cosine_b
    sine = pairs.sine + off_a * pairs.sine_a + off_b * pairs.sine_b
    s, co = offset_turned(theta_m, c.turning)
    return turns * c.resistance, mobility, (turns + cosine * co + sine * s) * c.k_e
