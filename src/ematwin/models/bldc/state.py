"""The plain values that kernels share: actuator constants, one fault vector, and truer forms.

All in SI and reflected to the motor shaft.
"""

from typing import NamedTuple

import numpy as np

from ematwin.models.bldc import unknowns as law
from ematwin.numerics.compile import step

friction_factor, backlash_factor = step(law.friction_factor), step(law.backlash_factor)
turns_left, gain_factor = step(law.turns_left), step(law.gain_factor)
eccentricity_angle = step(law.eccentricity_angle)


class Constants(NamedTuple):
    """What both models need of the actuator, in SI on the motor shaft."""

    resistance: float  # ohm, one phase
    inductance: float  # H, one phase
    leakage: float  # share of the inductance outside the turns
    k_e: float  # V s/rad, one phase
    pole_pairs: float
    turning: float  # share of the eccentricity that turns with the rotor
    short_resistance: float  # ohm, between shorted turns that are a loop
    v_supply: float  # V
    v_diode: float  # V
    half_band: float  # A
    i_max: float  # A
    w_max: float  # rad/s
    k_position: float  # 1/s
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
    load_gain: float  # actual over recorded load
    load_offset: float  # N m, beside the recorded load
    load_delay: float  # s, by which the recorded load is early
    mobility_m: float  # 1/(kg m^2), so that no step divides by inertias
    mobility_o: float
    mobility_both: float  # of both together
    share_o: float  # of the inertia of both
    k_demand: float  # A s/rad, current that a speed error asks for: speed gain/(2 k_e)


HALF_GAP = Constants._fields.index("half_gap")
LOAD_DELAY = Constants._fields.index("load_delay")
V_SUPPLY = Constants._fields.index("v_supply")


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
def fault_state(k, half_gap):
    """Physical magnitudes of a normalised fault vector (8,) (paper, section 6)."""
    phi = eccentricity_angle(k[6])
    return FaultState(
        friction_factor(k[0]), half_gap * backlash_factor(k[1]), turns_left(k[2]), turns_left(k[3]),
        turns_left(k[4]), k[5] * np.cos(phi), k[5] * np.sin(phi), gain_factor(k[7]),
    )  # fmt: skip


class Truer(NamedTuple):
    """Constants of the truer forms; the defaults are the paper's forms."""

    loops: float = 0.0  # 1: shorted turns are a loop; 0: they are missing
    rounding: float = 0.0  # share of a sine in the EMF shape
    harmonic_5: float = 0.0  # of the EMF shape
    harmonic_7: float = 0.0
    ripple: float = 0.0  # share of all torques and EMFs
    ripple_cycles: float = 1.0  # in a turn of the motor
    ripple_phase: float = 0.0  # rad
    cogging: float = 0.0  # N m
    cogging_cycles: float = 1.0  # in a turn of the motor
    cogging_phase: float = 0.0  # rad
    integral_gain: float = 0.0  # N m/rad
    sample_time: float = 0.0  # s; 0 is continuous
    delay: float = 0.0  # s
    current_gain: float = 0.0  # V/A, of the current loop; 0: the drive follows within its voltage
    current_integral: float = 0.0  # V/(A s)
    current_sample: float = 1.0  # s
    current_delay: float = 0.0  # s
    lost_voltage: float = 0.0  # V, across the pair
    bristles_m: float = 0.0  # N m/rad, on the motor side; 0: friction sticks without giving
    bristles_o: float = 0.0  # N m/rad, of the output side
    bristle_damping: float = 0.0  # N m s/rad, at rest
    w_stribeck: float = 1.0  # rad/s
    heating: float = 0.0  # 1/W, resistance gained by a steady loss, of that at the start
    heating_time: float = 1.0  # s
    supply_resistance: float = 0.0  # ohm
    link_time: float = 0.0  # s, of its link behind that resistance
    motor_step: float = 0.0  # rad, of the motor's encoder; 0 reads angle and speed as they are
    output_step: float = 0.0  # rad on the motor shaft, of the output's
    count_offset: float = 0.5  # of a step, where counts begin
    filter_share: float = 1.0  # of a new speed that the filter passes with each sample


class TruerState(NamedTuple):
    """State of the truer forms; by default at rest."""

    loop_a: float = 0.0  # A, through the contact between shorted turns of phase a
    loop_b: float = 0.0
    loop_c: float = 0.0
    asked: float = 0.0  # A, by the speed loop
    pending: float = 0.0  # A, that will be asked for
    integral: float = 0.0  # N m
    wait: float = 0.0  # s, until the next sample of the speed loop
    late: float = 0.0  # s, until what is pending is asked for
    voltage: float = 0.0  # V, across the pair, by the current loop
    voltage_pending: float = 0.0  # V, that will be
    voltage_integral: float = 0.0  # V
    voltage_wait: float = 0.0  # s, until the next sample of the current loop
    voltage_late: float = 0.0  # s, until what is pending is applied
    warmer: float = 0.0  # share of the resistance at the start that windings have gained
    sagged: float = 0.0  # V, that the supply has less than without current
    bent_m: float = 0.0  # rad, of the bristles between motor and housing
    bent_o: float = 0.0
    read: float = 0.0  # rad, angle of the motor at the last sample of the speed loop
    speed_seen: float = 0.0  # rad/s, by differences of such angles, filtered
