"""The plain values that kernels share: of an actuator, of a fault vector, and of truer forms.

All are in SI and on the motor shaft; windings are those of one phase.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, cast

import numpy as np

from ematwin.models.bldc import faults as law
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import step
from ematwin.numerics.side_by_side import by_candidate

# what both models need of an actuator, by name; docs/models.md has the equations
_OF_ACTUATOR: dict[str, Callable[[BldcActuator], Any]] = {
    "resistance": lambda a: a.motor.resistance / 2.0,  # ohm
    "inductance": lambda a: a.motor.inductance / 2.0,  # H
    "leakage": lambda a: a.motor.leakage_share,  # share of the inductance outside the turns
    "k_e": lambda a: a.motor.emf_constant / 2.0,  # V s/rad
    "pole_pairs": lambda a: float(a.motor.pole_pairs),
    # share of the eccentricity that turns with the rotor
    "turning": lambda a: 1.0 if a.eccentricity is None else a.eccentricity.turning_share,
    # ohm, between shorted turns that are a loop
    "short_resistance": lambda a: 1.0 if a.shorted_turns is None else a.shorted_turns.resistance,
    "v_supply": lambda a: a.drive.supply_voltage,  # V
    "v_diode": lambda a: a.drive.diode_drop,  # V
    # A; a current loop modulates its voltage in place of the comparator
    "half_band": lambda a: a.drive.hysteresis_band / 2.0 if a.current_loop is None else 0.0,
    "i_max": lambda a: a.drive.current_limit,  # A
    "w_max": lambda a: a.controller.speed_limit,  # rad/s
    "k_position": lambda a: a.controller.position_gain,  # 1/s
    "viscous": lambda a: a.motor.viscous_damping,  # N m s/rad
    "t_m": lambda a: a.motor.friction_torque,  # N m, dynamic friction on the motor side
    "t_o": lambda a: a.transmission.friction_torque,  # N m, on the output side
    "static_ratio": lambda a: a.transmission.static_ratio,
    "c_opposing": lambda a: 1.0 / a.transmission.efficiency_opposing - 1.0,
    "c_aiding": lambda a: 1.0 - a.transmission.efficiency_aiding,
    "half_gap": lambda a: a.transmission.backlash / 2.0,  # rad, healthy
    "contact_stiffness": lambda a: a.contact.stiffness,  # N m/rad
    "contact_damping": lambda a: a.contact.damping,  # N m s/rad
    "travel_low": lambda a: a.transmission.travel_low * a.transmission.ratio,  # rad
    "travel_high": lambda a: a.transmission.travel_high * a.transmission.ratio,  # rad
    # 1/(kg m^2), so that no step divides by inertias; of both masses together
    "mobility_m": lambda a: 1.0 / a.motor.inertia,
    "mobility_o": lambda a: 1.0 / a.transmission.output_inertia,
    "mobility_both": lambda a: 1.0 / _inertia(a),
    "share_o": lambda a: a.transmission.output_inertia / _inertia(a),  # of the inertia of both
    # A s/rad, current that a speed error asks for
    "k_demand": lambda a: a.controller.speed_gain / a.motor.emf_constant,
}
# actual over recorded load; N m beside the recorded load; s, by which the recorded load is early
_OF_LOAD = ("load_gain", "load_offset", "load_delay")
Constants = cast(Any, namedtuple)("Constants", (*_OF_ACTUATOR, *_OF_LOAD))
HALF_GAP, LOAD_DELAY, V_SUPPLY = map(
    Constants._fields.index, ("half_gap", "load_delay", "v_supply")
)


def _inertia(actuator: BldcActuator) -> Any:
    return actuator.motor.inertia + actuator.transmission.output_inertia


def kernel_constants(
    actuator: BldcActuator, load_gain: Any = 1.0, load_offset: Any = 0.0, load_delay: Any = 0.0
) -> Any:
    """`Constants` of an actuator, (B,) arrays where parameters are; the load in N m and s."""
    of_actuator = (constant(actuator) for constant in _OF_ACTUATOR.values())
    return Constants(*of_actuator, load_gain, load_offset / actuator.transmission.ratio, load_delay)


friction_factor, backlash_factor = step(law.friction_factor), step(law.backlash_factor)
turns_left, gain_factor = step(law.turns_left), step(law.gain_factor)
eccentricity_angle = step(law.eccentricity_angle)


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
    """Constants of the truer forms; the defaults are the paper's forms.

    Most are parameters of optional sections, and have the names of both.
    """

    loops: float = 0.0  # 1: shorted turns are a loop; 0: they are missing
    emf_rounding: float = 0.0  # share of a sine in the EMF shape
    emf_harmonic_5: float = 0.0  # of the EMF shape
    emf_harmonic_7: float = 0.0
    torque_ripple_share: float = 0.0  # share of all torques and EMFs
    torque_ripple_cycles: float = 1.0  # in a turn of the motor
    torque_ripple_phase: float = 0.0  # rad
    cogging_torque: float = 0.0  # N m
    cogging_cycles: float = 1.0  # in a turn of the motor
    cogging_phase: float = 0.0  # rad
    speed_loop_integral_gain: float = 0.0  # N m/rad
    speed_loop_sample_time: float = 0.0  # s; 0 is continuous
    speed_loop_delay: float = 0.0  # s
    current_loop_proportional_gain: float = (
        0.0  # V/A, of the current loop; 0: the drive follows within its voltage
    )
    current_loop_integral_gain: float = 0.0  # V/(A s)
    current_loop_sample_time: float = 1.0  # s
    current_loop_delay: float = 0.0  # s
    current_loop_lost_voltage: float = 0.0  # V, across the pair
    presliding_motor_stiffness: float = (
        0.0  # N m/rad, on the motor side; 0: friction sticks without giving
    )
    presliding_output_stiffness: float = 0.0  # N m/rad, of the output side
    presliding_damping: float = 0.0  # N m s/rad, at rest
    presliding_stribeck_speed: float = 1.0  # rad/s
    winding_heat_gain_per_watt: float = (
        0.0  # 1/W, resistance gained by a steady loss, of that at the start
    )
    winding_heat_time_constant: float = 1.0  # s
    supply_resistance: float = 0.0  # ohm
    link_time: float = 0.0  # s, of its link behind that resistance
    motor_step: float = 0.0  # rad, of the motor's encoder; 0 reads angle and speed as they are
    output_step: float = 0.0  # rad on the motor shaft, of the output's
    count_offset: float = 0.5  # of a step, where counts begin
    filter_share: float = 1.0  # of a new speed that the filter passes with each sample


# fields of `Truer`, and their names in the section of a form
_OF_FORMS = {
    key: [(name, name[len(key) + 1 :]) for name in Truer._fields if name.startswith(f"{key}_")]
    for key in law.REFERENCE_ALONE
}


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
    read: float = 0.0  # rad, angle of the motor at the last sample of the speed loop
    speed_seen: float = 0.0  # rad/s, by differences of such angles, filtered
    voltage: float = 0.0  # V, across the pair, by the current loop
    voltage_pending: float = 0.0  # V, that will be
    voltage_integral: float = 0.0  # V
    voltage_wait: float = 0.0  # s, until the next sample of the current loop
    voltage_late: float = 0.0  # s, until what is pending is applied
    warmer: float = 0.0  # share of the resistance at the start that windings have gained
    sagged: float = 0.0  # V, that the supply has less than without current


def truer_constants(actuator: BldcActuator, count_offset: float = 0.5) -> Truer:
    """Constants of the reference's forms; counts begin at ``count_offset`` of a step."""
    found: dict[str, float] = {} if actuator.shorted_turns is None else {"loops": 1.0}
    for key in law.REFERENCE_ALONE:
        section = getattr(actuator, key)
        if section is not None:
            found |= {name: 1.0 * getattr(section, own) for name, own in _OF_FORMS[key]}
    if actuator.supply is not None:
        found["link_time"] = actuator.supply.resistance * actuator.supply.capacitance
    encoder, speed = actuator.encoder, actuator.speed_loop
    if encoder is not None and speed is not None:
        lag = np.maximum(encoder.filter_time, 1e-9)  # s: a filter so fast is none
        found |= {
            "motor_step": encoder.motor_step, "count_offset": count_offset,
            "output_step": encoder.output_step * actuator.transmission.ratio,
            "filter_share": -np.expm1(-speed.sample_time / lag),
        }  # fmt: skip
    return Truer(**found)


def constants_by_candidate(
    actuator: BldcActuator, candidates: Mapping[str, Any], count: int
) -> np.ndarray | None:
    """(B, 32) array of the constants of B candidates; None where all share the actuator's."""
    own = actuator.varied(candidates, law.FIXED)
    load = {name: candidates[name] for name in law.LOAD if name in candidates}
    if "skew" in candidates:
        # a command that came late makes all of the twin late, and its load must be as late
        load["load_delay"] = candidates["skew"]
    if own is actuator and not load:
        return None
    return by_candidate(kernel_constants(own, **load), count)
