"""The plain values that both models share: constants of one candidate, faults included.

All in SI on the motor shaft; windings and voltages of one phase, peak.
"""

import math
from typing import Any, NamedTuple

import numpy as np

FRICTION, BACKLASH = 2.0, 9.0  # added at most, of the healthy value
SHORTED = 0.3  # of the turns of a phase, at most
LOST_FLUX = 0.5  # at most
CONNECTOR = 3.0  # added resistance at most, of that of a phase
SENSOR_GAIN, SENSOR_OFFSET = 0.2, 0.05  # at most, to both sides; of the current limit
RESOLVER = math.radians(10.0)  # electrical, at most, to both sides


class Constants(NamedTuple):
    """What both models need of one candidate."""

    pole_pairs: float
    resistance: float  # ohm
    l_d: float  # H
    l_q: float  # H
    k_e: float  # V s/rad of the shaft, amplitude; what magnets are left included
    h_5: float
    h_7: float
    static_x: float  # static change of the flux with the place in the bore
    static_y: float
    dynamic_x: float  # the same, turning with the rotor
    dynamic_y: float
    added_a: float  # ohm, in the connector
    added_b: float
    added_c: float
    loop_a: float  # S, current of a shorted loop seen at the terminals, per volt
    loop_b: float
    loop_c: float
    decay_a: float  # of the loop's current in a step
    decay_b: float
    decay_c: float
    loss_a: float  # ohm, R/mu + R_f/mu^2
    loss_b: float
    loss_c: float
    v_supply: float  # V
    v_leg: float  # V, error of a leg: dead time and drop
    knee: float  # A
    gain_a: float  # of the current sensors
    gain_b: float
    offset_a: float  # A
    offset_b: float
    resolver: float  # rad, electrical
    k_position: float  # 1/s
    k_speed: float  # N m s/rad
    k_total: float  # N m/rad, of the integral
    k_current: float  # V/A
    k_voltage: float  # V/(A s), of the integral
    w_max: float  # rad/s
    i_max: float  # A
    set_torque: float  # N m/A, as set in the drive
    set_flux: float  # Wb
    set_d: float  # H
    set_q: float  # H
    j_m: float  # kg m^2
    j_o: float
    viscous_m: float  # N m s/rad
    viscous_o: float
    friction_m: float  # N m, in motion
    friction_o: float
    static_ratio: float
    w_stribeck: float  # rad/s
    cogging: float  # N m
    cogging_periods: float
    cogging_phase: float  # rad
    half_gap: float  # rad
    stiffness: float  # N m/rad
    damping: float  # N m s/rad
    travel_low: float  # rad
    travel_high: float  # rad
    bristles_m: float  # N m/rad, stiffness on the motor side; 0: friction sticks without giving
    bristles_o: float
    bristle_damping: float  # N m s/rad, at rest
    heating: float  # 1/W, resistance gained by a steady loss, of that at the start
    heating_time: float  # s
    load_gain: float  # actual over recorded load
    load_offset: float  # N m


def friction_factor(k: Any) -> Any:
    """Factor on all dry friction."""
    return 1.0 + FRICTION * k


def backlash_factor(k: Any) -> Any:
    """Factor on the healthy backlash."""
    return 1.0 + BACKLASH * k


def gain_factor(k: Any) -> Any:
    """Factor on the position gain."""
    return 0.5 + k


def shorted_share(k: Any) -> Any:
    """Share of the turns of a phase that are shorted.

    The root, so that the current which a short draws grows in proportion to the fault.
    """
    return SHORTED * np.sqrt(k)


def flux_left(k: Any) -> Any:
    """Share of the flux of the magnets that is left."""
    return 1.0 - LOST_FLUX * k


def direction(k: Any) -> Any:
    """Direction of an eccentricity, rad."""
    return 2.0 * math.pi * (k - 0.5)


def sensor_gain(k: Any) -> Any:
    """Gain of a current sensor."""
    return 1.0 + 2.0 * SENSOR_GAIN * (k - 0.5)


def sensor_offset(k: Any, limit: Any) -> Any:
    """Offset of a current sensor, A, for a drive with a current limit."""
    return 2.0 * SENSOR_OFFSET * limit * (k - 0.5)


def resolver_offset(k: Any) -> Any:
    """Error of the angle of commutation, rad, electrical."""
    return 2.0 * RESOLVER * (k - 0.5)
