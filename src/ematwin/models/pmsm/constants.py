"""Candidates as the kernels take them: parameters with faults, SI on the motor shaft.

Windings and voltages are of one phase, peak.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ematwin.models.pmsm import unknowns as law
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.numerics.side_by_side import by_candidate


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


def constants_of(
    actuator: PmsmActuator, candidates: Mapping[str, Any], count: int, step: float
) -> np.ndarray:
    """(B, 65) array, the fields of `Constants` of B candidates.

    ``candidates`` are values (B,) of unknowns and, by place, of parameters; all others are
    healthy. ``step`` is that over which the currents of shorted loops decay, s.
    """
    return by_candidate(fields_of(actuator, candidates, step), count)


def fields_of(actuator: PmsmActuator, candidates: Mapping[str, Any], step: float) -> Constants:
    """The same as numbers, or (B,) arrays where candidates differ."""
    own = actuator.varied(candidates, law.FIXED)
    motor, drive, control = own.motor, own.drive, own.controller
    gear, bristles, heat = own.transmission, own.presliding, own.winding_heat
    k = {one.name: one.healthy for one in law.unknowns(actuator)}
    k["short_resistance"] = motor.short_resistance  # its healthy value is a parameter
    k.update({name: candidates[name] for name in k if name in candidates})
    loops = zip(*(_loop(motor, k[f"short_{x}"], k["short_resistance"], step) for x in "abc"),
                strict=True)  # fmt: skip
    (loop_a, loop_b, loop_c), (decay_a, decay_b, decay_c), (loss_a, loss_b, loss_c) = loops
    static = motor.gap_share * k["static_eccentricity"]
    dynamic = motor.gap_share * k["dynamic_eccentricity"]
    static_at = law.direction(k["static_direction"])
    dynamic_at = law.direction(k["dynamic_direction"])
    friction = law.friction_factor(k["friction"])
    added = law.CONNECTOR * motor.resistance
    return Constants(
        pole_pairs=float(motor.pole_pairs),
        resistance=motor.resistance,
        l_d=motor.inductance_d,
        l_q=motor.inductance_q,
        k_e=motor.pole_pairs * motor.flux * law.flux_left(k["demagnetisation"]),
        h_5=motor.harmonic_5,
        h_7=motor.harmonic_7,
        static_x=static * np.cos(static_at),
        static_y=static * np.sin(static_at),
        dynamic_x=dynamic * np.cos(dynamic_at),
        dynamic_y=dynamic * np.sin(dynamic_at),
        added_a=added * k["connector_a"], added_b=added * k["connector_b"],
        added_c=added * k["connector_c"],
        loop_a=loop_a, loop_b=loop_b, loop_c=loop_c,
        decay_a=decay_a, decay_b=decay_b, decay_c=decay_c,
        loss_a=loss_a, loss_b=loss_b, loss_c=loss_c,
        v_supply=drive.supply_voltage,
        v_leg=drive.supply_voltage * drive.dead_time / control.current_time + drive.device_drop,
        knee=drive.knee_current,
        gain_a=law.sensor_gain(k["sensor_gain_a"]),
        gain_b=law.sensor_gain(k["sensor_gain_b"]),
        offset_a=law.sensor_offset(k["sensor_offset_a"], control.current_limit),
        offset_b=law.sensor_offset(k["sensor_offset_b"], control.current_limit),
        resolver=law.resolver_offset(k["resolver_offset"]),
        k_position=control.position_gain * law.gain_factor(k["gain"]),
        k_speed=control.speed_gain,
        k_total=control.speed_integral,
        k_current=control.current_gain,
        k_voltage=control.current_integral,
        w_max=control.speed_limit,
        i_max=control.current_limit,
        set_torque=control.torque_constant,
        set_flux=control.flux,
        set_d=control.inductance_d,
        set_q=control.inductance_q,
        j_m=motor.inertia,
        j_o=gear.output_inertia,
        viscous_m=motor.viscous_damping,
        viscous_o=gear.viscous_damping,
        friction_m=motor.friction_torque * friction,
        friction_o=gear.friction_torque * friction,
        static_ratio=gear.static_ratio,
        w_stribeck=gear.stribeck_speed,
        cogging=motor.cogging_torque,
        cogging_periods=float(motor.cogging_periods),
        cogging_phase=motor.cogging_phase,
        half_gap=0.5 * gear.backlash * law.backlash_factor(k["backlash"]),
        stiffness=gear.stiffness,
        damping=gear.damping,
        travel_low=gear.travel_low * gear.ratio,
        travel_high=gear.travel_high * gear.ratio,
        bristles_m=0.0 if bristles is None else bristles.motor_stiffness,
        bristles_o=0.0 if bristles is None else bristles.output_stiffness,
        bristle_damping=0.0 if bristles is None else bristles.damping,
        heating=0.0 if heat is None else heat.gain_per_watt,
        heating_time=1.0 if heat is None else heat.time_constant,
        load_gain=k["load_gain"],
        load_offset=k["load_offset"] / gear.ratio,
    )  # fmt: skip


def _loop(motor: Any, k: Any, contact: Any, step: float) -> tuple[Any, Any, Any]:
    """Conductance (S), decay in a step, and loss resistance (ohm) of a short (docs/pmsm.md)."""
    mu, least = law.shorted_share(np.abs(k)), 1e-9  # monitoring looks a little below zero
    some = np.maximum(mu, least)
    inside = mu * (1.0 - 2.0 * mu / 3.0)
    total = contact + inside * motor.resistance
    rate = total / (np.maximum(inside, least) * motor.leakage)
    loss = motor.resistance / some + contact / some**2
    return np.copysign(mu * mu, k) / total, np.exp(-rate * step), np.where(mu > 0.0, loss, 0.0 * mu)
