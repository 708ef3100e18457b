"""Constants and state of the truer forms of the reference model.

All in SI and reflected to the motor shaft.
"""

from typing import NamedTuple


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
