"""The plain values that every kernel shares: actuator constants and one fault vector.

All in SI and reflected to the motor shaft.
"""

import math
from typing import NamedTuple

from ematwin.kernels.compile import step


class Constants(NamedTuple):
    """What both models need of the actuator, in SI on the motor shaft."""

    resistance: float  # ohm, one phase
    inductance: float  # H, one phase
    leakage: float  # share of the inductance outside the turns
    k_e: float  # V s/rad, one phase
    pole_pairs: float
    v_supply: float  # V
    v_diode: float  # V
    half_band: float  # A
    i_max: float  # A
    w_max: float  # rad/s
    k_position: float  # 1/s
    k_speed: float  # N m s/rad
    j_m: float  # kg m^2
    j_o: float  # kg m^2, reflected
    viscous: float  # N m s/rad
    t_m: float  # N m, dynamic friction on the motor side
    t_o: float  # N m, dynamic friction on the output side, reflected
    static_ratio: float
    c_opposing: float  # 1/eta_o - 1
    c_aiding: float  # 1 - eta_a
    half_gap: float  # rad, healthy
    contact_stiffness: float  # N m/rad
    contact_damping: float  # N m s/rad
    travel_low: float  # rad
    travel_high: float  # rad


class FaultState(NamedTuple):
    """The physical magnitudes of one fault vector, as the equations use them."""

    friction: float  # factor on all dry friction
    half_gap: float  # rad
    h_a: float  # share of turns left
    h_b: float
    h_c: float
    zeta_cos: float  # zeta cos(phi)
    zeta_sin: float  # zeta sin(phi)
    gain: float  # factor on the position gain


@step
def fault_state(k1, k2, k3, k4, k5, k6, k7, k8, half_gap):
    """Physical magnitudes of a normalised fault vector (paper, section 6).

    friction x (1 + 2 k1); backlash x (1 + 99 k2); shares of turns left 1 - k3..5; zeta = k6;
    phi = 2 pi (k7 - 1/2); position gain x (1/2 + k8).
    """
    phi = 2.0 * math.pi * (k7 - 0.5)
    return FaultState(
        1.0 + 2.0 * k1,
        half_gap * (1.0 + 99.0 * k2),
        1.0 - k3,
        1.0 - k4,
        1.0 - k5,
        k6 * math.cos(phi),
        k6 * math.sin(phi),
        0.5 + k8,
    )
