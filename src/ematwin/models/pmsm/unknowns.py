"""Unknowns of a PMSM servo, in one table, and what kernels make of them: `Constants`.

Laws convert the faults to SI.
"""

import math
from collections import namedtuple
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.servo import dry_friction, load_nuisances
from ematwin.models.servo import normalised_fault as _fault
from ematwin.models.unknown import Alias, Contrast, Unknown

# Laws of the faults, in SI; each magnitude is normalised to [0, 1].
FRICTION, BACKLASH = 2.0, 9.0  # added at most, of the healthy value
LOST_FLUX = 0.5  # at most
CONNECTOR = 3.0  # added resistance at most, of that of a phase


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
    """Share of the turns of a phase that are shorted, 30 % at most.

    The root, so that the current which a short draws grows in proportion to the fault.
    """
    return 0.3 * np.sqrt(k)


def flux_left(k: Any) -> Any:
    """Share of the flux of the magnets that is left."""
    return 1.0 - LOST_FLUX * k


def direction(k: Any) -> Any:
    """Direction of an eccentricity, rad."""
    return 2.0 * math.pi * (k - 0.5)


def sensor_gain(k: Any) -> Any:
    """Gain of a current sensor, within 20 %."""
    return 1.0 + 0.4 * (k - 0.5)


def sensor_offset(k: Any, limit: Any) -> Any:
    """Offset of a current sensor, A, within 5 % of the current limit of the drive."""
    return 0.1 * limit * (k - 0.5)


def resolver_offset(k: Any) -> Any:
    """Error of the angle of commutation, rad electrical, within 10 degrees."""
    return 2.0 * math.radians(10.0) * (k - 0.5)


# Counted or chosen: these cannot differ between candidates.
FIXED = (
    "motor.pole_pairs", "motor.cogging_periods", "drive.current_bits", "drive.current_range",
    "drive.motor_steps", "drive.output_steps", "controller.current_time", "controller.speed_time",
    "controller.position_time", "transmission.ratio", "steps.reference", "steps.monitor",
)  # fmt: skip


UNKNOWNS = (
    _fault("friction", "dry friction on the motor shaft", "N m",
           lambda a, k: dry_friction(a) * friction_factor(k)),
    _fault("backlash", "backlash on the motor shaft", "rad",
           lambda a, k: a.transmission.backlash * backlash_factor(k)),
    _fault("gain", "proportional position gain", "1/s",
           lambda a, k: a.controller.position_gain * gain_factor(k), 0.5),
    *(
        _fault(f"short_{x}", f"shorted turns of phase {x}", "%",
               lambda a, k: 100.0 * shorted_share(np.maximum(k, 0.0)))
        for x in "abc"
    ),
    _fault("demagnetisation", "flux of the magnets", "Wb",
           lambda a, k: a.motor.flux * flux_left(k)),
    _fault("static_eccentricity", "offset of the bore over the air gap", "", None),
    _fault("static_direction", "direction of the offset of the bore", "deg",
           lambda a, k: np.degrees(direction(k)), 0.5, direction_of="static_eccentricity"),
    _fault("dynamic_eccentricity", "offset of the rotor over the air gap", "", None),
    _fault("dynamic_direction", "direction of the offset of the rotor", "deg",
           lambda a, k: np.degrees(direction(k)), 0.5, direction_of="dynamic_eccentricity"),
    *(
        _fault(f"connector_{x}", f"resistance in the connector of phase {x}", "ohm",
               lambda a, k: CONNECTOR * a.motor.resistance * k)
        for x in "abc"
    ),
    *(
        _fault(f"sensor_gain_{x}", f"gain of the current sensor of phase {x}", "",
               lambda a, k: sensor_gain(k), 0.5)
        for x in "ab"
    ),
    *(
        _fault(f"sensor_offset_{x}", f"offset of the current sensor of phase {x}", "A",
               lambda a, k: sensor_offset(k, a.controller.current_limit), 0.5)
        for x in "ab"
    ),
    _fault("resolver_offset", "error of the angle of commutation, electrical", "deg",
           lambda a, k: np.degrees(resolver_offset(k)), 0.5),
)  # fmt: skip

FAULTS = tuple(one.name for one in UNKNOWNS)
SHORTS = ("short_a", "short_b", "short_c")


def _share_alike(actuator: Any, mu: float, factor: float) -> float:
    """Per cent of the turns that draw what ``mu`` do, over a contact ``factor`` times as large.

    Alike is mu^2/(R_f + mu (1 - 2 mu/3) R), the conductance at the terminals.
    """
    contact, resistance = actuator.motor.short_resistance, actuator.motor.resistance
    drawn = mu**2 / (contact + mu * (1.0 - 2.0 * mu / 3.0) * resistance)
    # (1 + 2/3 R G) x^2 - R G x - factor R_f G = 0
    square, linear = 1.0 + 2.0 / 3.0 * resistance * drawn, resistance * drawn
    root = math.sqrt(linear**2 + 4.0 * square * factor * contact * drawn)
    return 100.0 * (linear + root) / (2.0 * square)


def unknowns(actuator: Any) -> tuple[Unknown, ...]:
    """Faults and nuisances of an actuator, in the order of tables."""
    contact = float(actuator.motor.short_resistance)

    caveat = (
        f"The share of shorted turns holds for a contact of {contact:g} ohm "
        "(motor.short_resistance): at the terminals the two are one number, and 10 % of the turns "
        f"over this contact look like {_share_alike(actuator, 0.1, 2.0):.2g} % over twice its "
        f"resistance and {_share_alike(actuator, 0.1, 0.5):.2g} % over half of it."
    )
    return (
        *(replace(one, caveat=caveat) if one.name in SHORTS else one for one in UNKNOWNS),
        Unknown("short_resistance", "ohm", "contact resistance of shorted turns", contact,
                min(1e-3, 0.5 * contact), max(20.0, 2.0 * contact), "nuisance",
                spread=0.4 * contact, marginal=True),
        *load_nuisances(actuator),
    )  # fmt: skip


def aliases(actuator: Any, values: Mapping[str, float]) -> list[Alias]:
    """Directions in which the response does not change: each fault against its parameter."""
    k = {one.name: values.get(one.name, one.healthy) for one in UNKNOWNS}
    contact = values.get("short_resistance", float(actuator.motor.short_resistance))
    resistance = values.get("motor.resistance", actuator.motor.resistance)
    loops = {name: _loop(max(k[name], 0.0), contact, resistance) for name in SHORTS}
    left = flux_left(k["demagnetisation"])
    worn = friction_factor(k["friction"]) / FRICTION
    wider = backlash_factor(k["backlash"]) / BACKLASH
    same = {
        "motor.flux": {"demagnetisation": -left / LOST_FLUX},
        # (1 + 3 k) R in each phase, and a part of R in a loop; of a large short to a quarter
        "motor.resistance": {
            **{f"connector_{x}": 1.0 / CONNECTOR + k[f"connector_{x}"] for x in "abc"},
            **{name: -k[name] * part / total for name, (part, total) in loops.items()},
        },
        "transmission.friction_torque": {"friction": worn, "motor.friction_torque": -1.0},
        "transmission.backlash": {"backlash": wider},
        "controller.position_gain": {"gain": gain_factor(k["gain"])},
    }
    found = [Alias(pivot, changes, held=False) for pivot, changes in same.items()]
    # the time constant of a shorted loop, which tells its contact from its share, is as short as a
    # step of the monitor model: slopes of that say nothing of it
    shares = {name: -1.0 / total for name, (_, total) in loops.items()}
    return [*found, Alias("short_resistance", shares, multiplies=True)]


def _loop(k: float, contact: float, resistance: float) -> tuple[float, float]:
    """Resistance of the shorted turns (ohm), and that over which a short grows with its contact.

    The conductance at the terminals, mu^2/(R_f + mu (1 - 2 mu/3) R), stays where the logarithm of k
    grows by dR_f over the second.
    """
    mu = shorted_share(k)
    part = mu * (1.0 - 2.0 * mu / 3.0) * resistance
    return float(part), float(contact + part - 0.5 * mu * (1.0 - 4.0 * mu / 3.0) * resistance)


CONTRASTS = (
    Contrast(
        "connector_common", {f"connector_{x}": 1.0 / 3.0 for x in "abc"},
        "resistance added to all phases alike",
        "Resistance added to all phases alike cannot be told from a warm winding.",
        "ohm", lambda a, k: float(CONNECTOR * a.motor.resistance * k),
    ),
    Contrast(
        "demagnetisation_beyond_heat", {"demagnetisation": 1.0}, "flux lost",
        "Lost flux cannot be told from magnets that are merely warm.",
        "%", lambda a, k: 100.0 * LOST_FLUX * k,
    ),
)  # fmt: skip


# What both models need of one candidate, by name, of a servo (a) and its unknowns (k). SI, on the
# motor shaft; windings and voltages are of one phase, peak.
_OF_CANDIDATE: dict[str, Callable[[Any, Mapping[str, Any]], Any]] = {
    "pole_pairs": lambda a, k: float(a.motor.pole_pairs),
    "resistance": lambda a, k: a.motor.resistance,  # ohm
    "l_d": lambda a, k: a.motor.inductance_d,  # H
    "l_q": lambda a, k: a.motor.inductance_q,  # H
    # V s/rad of the shaft, amplitude; what magnets are left included
    "k_e": lambda a, k: a.motor.pole_pairs * a.motor.flux * flux_left(k["demagnetisation"]),
    "h_5": lambda a, k: a.motor.harmonic_5,
    "h_7": lambda a, k: a.motor.harmonic_7,
    # static change of the flux with the place in the bore; and that which turns with the rotor
    "static_x": lambda a, k: _offset(a, k, "static", np.cos),
    "static_y": lambda a, k: _offset(a, k, "static", np.sin),
    "dynamic_x": lambda a, k: _offset(a, k, "dynamic", np.cos),
    "dynamic_y": lambda a, k: _offset(a, k, "dynamic", np.sin),
    # ohm, in the connector
    "added_a": lambda a, k: CONNECTOR * a.motor.resistance * k["connector_a"],
    "added_b": lambda a, k: CONNECTOR * a.motor.resistance * k["connector_b"],
    "added_c": lambda a, k: CONNECTOR * a.motor.resistance * k["connector_c"],
    "v_supply": lambda a, k: a.drive.supply_voltage,  # V
    # V, error of a leg: dead time and drop
    "v_leg": lambda a, k: (
        a.drive.supply_voltage * a.drive.dead_time / a.controller.current_time + a.drive.device_drop
    ),
    "knee": lambda a, k: a.drive.knee_current,  # A
    # of the current sensors; A
    "gain_a": lambda a, k: sensor_gain(k["sensor_gain_a"]),
    "gain_b": lambda a, k: sensor_gain(k["sensor_gain_b"]),
    "offset_a": lambda a, k: sensor_offset(k["sensor_offset_a"], a.controller.current_limit),
    "offset_b": lambda a, k: sensor_offset(k["sensor_offset_b"], a.controller.current_limit),
    "resolver": lambda a, k: resolver_offset(k["resolver_offset"]),  # rad, electrical
    "k_position": lambda a, k: a.controller.position_gain * gain_factor(k["gain"]),  # 1/s
    "k_speed": lambda a, k: a.controller.speed_gain,  # N m s/rad
    "k_total": lambda a, k: a.controller.speed_integral,  # N m/rad
    "k_current": lambda a, k: a.controller.current_gain,  # V/A
    "k_voltage": lambda a, k: a.controller.current_integral,  # V/(A s)
    "w_max": lambda a, k: a.controller.speed_limit,  # rad/s
    "i_max": lambda a, k: a.controller.current_limit,  # A
    # as set in the drive: N m/A, Wb, H
    "set_torque": lambda a, k: a.controller.torque_constant,
    "set_flux": lambda a, k: a.controller.flux,
    "set_d": lambda a, k: a.controller.inductance_d,
    "set_q": lambda a, k: a.controller.inductance_q,
    "j_m": lambda a, k: a.motor.inertia,  # kg m^2
    "j_o": lambda a, k: a.transmission.output_inertia,
    "viscous_m": lambda a, k: a.motor.viscous_damping,  # N m s/rad
    "viscous_o": lambda a, k: a.transmission.viscous_damping,
    # N m, in motion
    "friction_m": lambda a, k: a.motor.friction_torque * friction_factor(k["friction"]),
    "friction_o": lambda a, k: a.transmission.friction_torque * friction_factor(k["friction"]),
    "static_ratio": lambda a, k: a.transmission.static_ratio,
    "w_stribeck": lambda a, k: a.transmission.stribeck_speed,  # rad/s
    "cogging": lambda a, k: a.motor.cogging_torque,  # N m
    "cogging_periods": lambda a, k: float(a.motor.cogging_periods),
    "cogging_phase": lambda a, k: a.motor.cogging_phase,  # rad
    "half_gap": lambda a, k: 0.5 * a.transmission.backlash * backlash_factor(k["backlash"]),  # rad
    "stiffness": lambda a, k: a.transmission.stiffness,  # N m/rad
    "damping": lambda a, k: a.transmission.damping,  # N m s/rad
    "travel_low": lambda a, k: a.transmission.travel_low * a.transmission.ratio,  # rad
    "travel_high": lambda a, k: a.transmission.travel_high * a.transmission.ratio,  # rad
    # N m/rad; 0: friction sticks without giving. N m s/rad, at rest
    "bristles_m": lambda a, k: 0.0 if a.presliding is None else a.presliding.motor_stiffness,
    "bristles_o": lambda a, k: 0.0 if a.presliding is None else a.presliding.output_stiffness,
    "bristle_damping": lambda a, k: 0.0 if a.presliding is None else a.presliding.damping,
    # 1/W, resistance gained by a steady loss, of that at the start; s
    "heating": lambda a, k: 0.0 if a.winding_heat is None else a.winding_heat.gain_per_watt,
    "heating_time": lambda a, k: 1.0 if a.winding_heat is None else a.winding_heat.time_constant,
    "load_gain": lambda a, k: k["load_gain"],  # actual over recorded load
    "load_offset": lambda a, k: k["load_offset"] / a.transmission.ratio,  # N m
}
# Of a shorted loop: its current seen at the terminals, per volt (S); what is left of it after a
# step; R/mu + R_f/mu^2 (ohm)
_OF_LOOPS = tuple(f"{name}_{x}" for name in ("loop", "decay", "loss") for x in "abc")
Constants = cast(Any, namedtuple)("Constants", (*_OF_CANDIDATE, *_OF_LOOPS))


def _offset(actuator: Any, k: Mapping[str, Any], which: str, component: Any) -> Any:
    size = actuator.motor.gap_share * k[f"{which}_eccentricity"]
    return size * component(direction(k[f"{which}_direction"]))


def constants_of(actuator: PmsmActuator, candidates: Mapping[str, Any], step: float) -> Any:
    """`Constants` of candidates, numbers or (B,) arrays.

    ``candidates`` are values of unknowns and, by place, of parameters; all others are healthy.
    ``step`` is that over which the currents of shorted loops decay, s.
    """
    own = actuator.varied(candidates, FIXED)
    k = {one.name: one.healthy for one in unknowns(actuator)}
    k["short_resistance"] = own.motor.short_resistance  # its healthy value is a parameter
    k.update({name: candidates[name] for name in k if name in candidates})
    loops = [_loop_constants(own.motor, k[name], k["short_resistance"], step) for name in SHORTS]
    of_loops = (one for phases in zip(*loops, strict=True) for one in phases)
    return Constants(*(of(own, k) for of in _OF_CANDIDATE.values()), *of_loops)


def _loop_constants(motor: Any, k: Any, contact: Any, step: float) -> tuple[Any, Any, Any]:
    """Conductance (S), decay in a step, and loss resistance (ohm) of a short (docs/pmsm.md)."""
    mu, least = shorted_share(np.abs(k)), 1e-9  # monitoring looks a little below zero
    some = np.maximum(mu, least)
    inside = mu * (1.0 - 2.0 * mu / 3.0)
    total = contact + inside * motor.resistance
    rate = total / (np.maximum(inside, least) * motor.leakage)
    loss = motor.resistance / some + contact / some**2
    return np.copysign(mu * mu, k) / total, np.exp(-rate * step), np.where(mu > 0.0, loss, 0.0 * mu)
