"""Constants and state of the truer forms of the reference model.

All in SI and reflected to the motor shaft. Each value has one at which the paper's form results.
"""

from typing import NamedTuple

from ematwin.numerics.compile import step


class Truer(NamedTuple):
    """Constants of the truer forms."""

    loops: float  # 1: shorted turns are a loop; 0: they are missing
    rounding: float  # share of a sine in the EMF shape
    harmonic_5: float  # of the EMF shape
    harmonic_7: float
    ripple: float  # share of all torques and EMFs
    ripple_cycles: float  # in a turn of the motor
    ripple_phase: float  # rad
    cogging: float  # N m
    cogging_cycles: float  # in a turn of the motor
    cogging_phase: float  # rad
    integral_gain: float  # N m/rad
    sample_time: float  # s; 0 is continuous
    delay: float  # s
    current_gain: float  # V/A, of the current loop; 0: the drive follows within its voltage
    current_integral: float  # V/(A s)
    current_sample: float  # s
    current_delay: float  # s
    lost_voltage: float  # V, across the pair
    bristles_m: float  # N m/rad, stiffness on the motor side; 0: friction sticks without giving
    bristles_o: float  # N m/rad, of the output side
    bristle_damping: float  # N m s/rad, at rest
    w_stribeck: float  # rad/s
    heating: float  # 1/W, resistance gained by a steady loss, of that at the start
    heating_time: float  # s
    supply_resistance: float  # ohm
    link_time: float  # s, of its link behind that resistance
    motor_step: float  # rad, of the motor's encoder; 0 reads angle and speed as they are
    output_step: float  # rad on the motor shaft, of the output's
    count_offset: float  # of a step, where counts begin
    filter_share: float  # of a new speed that the filter passes with each sample


NEUTRAL = Truer(
    loops=0.0, rounding=0.0, harmonic_5=0.0, harmonic_7=0.0, ripple=0.0, ripple_cycles=1.0,
    ripple_phase=0.0, cogging=0.0, cogging_cycles=1.0, cogging_phase=0.0,
    integral_gain=0.0, sample_time=0.0, delay=0.0,
    current_gain=0.0, current_integral=0.0, current_sample=1.0, current_delay=0.0,
    lost_voltage=0.0, bristles_m=0.0, bristles_o=0.0, bristle_damping=0.0, w_stribeck=1.0,
    heating=0.0, heating_time=1.0, supply_resistance=0.0, link_time=0.0,
    motor_step=0.0, output_step=0.0, count_offset=0.5, filter_share=1.0,
)  # fmt: skip


class TruerState(NamedTuple):
    """State of the truer forms."""

    loop_a: float  # A, through the contact between shorted turns of phase a
    loop_b: float
    loop_c: float
    asked: float  # A, by the speed loop
    pending: float  # A, that will be asked for
    integral: float  # N m
    wait: float  # s, until the next sample of the speed loop
    late: float  # s, until what is pending is asked for
    voltage: float  # V, across the pair, by the current loop
    voltage_pending: float  # V, that will be
    voltage_integral: float  # V
    voltage_wait: float  # s, until the next sample of the current loop
    voltage_late: float  # s, until what is pending is applied
    warmer: float  # share of the resistance at the start that windings have gained
    sagged: float  # V, that the supply has less than without current
    bent_m: float  # rad, of the bristles between motor and housing
    bent_o: float
    read: float  # rad, angle of the motor at the last sample of the speed loop
    speed_seen: float  # rad/s, by differences of such angles, filtered


REST = TruerState(*[0.0] * 19)


@step
def truer_state(values):
    """The fields of `TruerState` from an array (19,)."""
    return TruerState(
        values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7],
        values[8], values[9], values[10], values[11], values[12], values[13], values[14],
        values[15], values[16], values[17], values[18],
    )  # fmt: skip
