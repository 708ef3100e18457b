"""The parameters of an actuator as the kernels take them: reflected to the motor shaft."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.state import Constants, Truer
from ematwin.models.bldc.unknowns import FIXED, LOAD
from ematwin.numerics.side_by_side import by_candidate

# fields of `Truer` by parameter, for each section of the file
_STATED = {
    "emf": {"rounding": "rounding", "harmonic_5": "harmonic_5", "harmonic_7": "harmonic_7"},
    "torque_ripple": {"share": "ripple", "cycles": "ripple_cycles", "phase": "ripple_phase"},
    "cogging": {"torque": "cogging", "cycles": "cogging_cycles", "phase": "cogging_phase"},
    "presliding": {
        "motor_stiffness": "bristles_m", "output_stiffness": "bristles_o",
        "damping": "bristle_damping", "stribeck_speed": "w_stribeck",
    },
    "winding_heat": {"gain_per_watt": "heating", "time_constant": "heating_time"},
    "supply": {"resistance": "supply_resistance"},
    "speed_loop": {
        "integral_gain": "integral_gain", "sample_time": "sample_time", "delay": "delay",
    },
    "current_loop": {
        "proportional_gain": "current_gain", "integral_gain": "current_integral",
        "sample_time": "current_sample", "delay": "current_delay", "lost_voltage": "lost_voltage",
    },
}  # fmt: skip


def kernel_constants(
    actuator: BldcActuator, load_gain: Any = 1.0, load_offset: Any = 0.0, load_delay: Any = 0.0
) -> Constants:
    """Constants of the equations in docs/models.md, SI, phase values, on the motor shaft.

    Where parameters are arrays (B,), so are the constants that depend on them. ``load_gain``,
    ``load_offset`` (N m on the output) and ``load_delay`` (s) correct the recorded load.
    """
    motor, drive, control = actuator.motor, actuator.drive, actuator.controller
    gear, contact = actuator.transmission, actuator.contact
    turns, offset = actuator.shorted_turns, actuator.eccentricity
    return Constants(
        resistance=motor.resistance / 2.0,
        inductance=motor.inductance / 2.0,
        leakage=motor.leakage_share,
        k_e=motor.emf_constant / 2.0,
        pole_pairs=float(motor.pole_pairs),
        turning=1.0 if offset is None else offset.turning_share,
        short_resistance=1.0 if turns is None else turns.resistance,
        v_supply=drive.supply_voltage,
        v_diode=drive.diode_drop,
        # a current loop modulates its voltage in place of the comparator
        half_band=drive.hysteresis_band / 2.0 if actuator.current_loop is None else 0.0,
        i_max=drive.current_limit,
        w_max=control.speed_limit,
        k_position=control.position_gain,
        viscous=motor.viscous_damping,
        t_m=motor.friction_torque,
        t_o=gear.friction_torque,
        static_ratio=gear.static_ratio,
        c_opposing=1.0 / gear.efficiency_opposing - 1.0,
        c_aiding=1.0 - gear.efficiency_aiding,
        half_gap=gear.backlash / 2.0,
        contact_stiffness=contact.stiffness,
        contact_damping=contact.damping,
        travel_low=gear.travel_low * gear.ratio,
        travel_high=gear.travel_high * gear.ratio,
        load_gain=load_gain,
        load_offset=load_offset / gear.ratio,
        load_delay=load_delay,
        mobility_m=1.0 / motor.inertia,
        mobility_o=1.0 / gear.output_inertia,
        mobility_both=1.0 / (motor.inertia + gear.output_inertia),
        share_o=gear.output_inertia / (motor.inertia + gear.output_inertia),
        k_demand=control.speed_gain / motor.emf_constant,
    )


def truer_constants(actuator: BldcActuator, count_offset: float = 0.5) -> Truer:
    """Constants of the forms that the reference model alone has.

    ``count_offset`` says where within a step the counts of encoders begin.
    """
    found: dict[str, float] = {} if actuator.shorted_turns is None else {"loops": 1.0}
    for key, names in _STATED.items():
        section = getattr(actuator, key)
        if section is not None:
            found |= {field: 1.0 * getattr(section, name) for name, field in names.items()}
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
    own = actuator.varied(candidates, FIXED)
    load = {name: candidates[name] for name in LOAD if name in candidates}
    if "skew" in candidates:
        # a command that came late makes all of the twin late, and its load must be as late
        load["load_delay"] = candidates["skew"]
    if own is actuator and not load:
        return None
    return by_candidate(kernel_constants(own, **load), count)
