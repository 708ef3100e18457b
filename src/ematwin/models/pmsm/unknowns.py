"""Unknowns of a PMSM servo, in one table: faults and nuisances.

Laws convert the faults to SI.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

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
    ),
    Contrast(
        "demagnetisation_beyond_heat", {"demagnetisation": 1.0}, "flux lost",
        "Lost flux cannot be told from magnets that are merely warm.",
    ),
)  # fmt: skip
