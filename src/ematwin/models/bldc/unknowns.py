"""What is unknown of a brushless actuator: its faults, in one table.

ESREL 2020 paper, section 6. The magnitudes are normalised to [0, 1]; the laws that turn them into
physical ones are those that the kernel calls (`ematwin.models.bldc.state`).
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from ematwin.models.unknown import Unknown


def _law(name: str, k: float) -> float:
    from ematwin.models.bldc import state  # compiles nothing, but needs numba

    return float(getattr(state, name).py_func(k))


def _friction(actuator: Any, k: float) -> float:
    torque = actuator.motor.friction_torque + actuator.transmission.friction_torque
    return float(torque * _law("friction_factor", k))


def _backlash(actuator: Any, k: float) -> float:
    return float(actuator.transmission.backlash * _law("backlash_factor", k))


def _turns(actuator: Any, k: float) -> float:
    turns = actuator.motor.turns_per_phase
    return float(turns - turns * _law("turns_left", k))


def _degrees(actuator: Any, k: float) -> float:
    return math.degrees(_law("eccentricity_angle", k))


def _gain(actuator: Any, k: float) -> float:
    return float(actuator.controller.position_gain * _law("gain_factor", k))


def _fault(
    name: str,
    meaning: str,
    unit: str,
    physical: Callable[[Any, float], float] | None,
    healthy: float = 0.0,
    **more: Any,
) -> Unknown:
    return Unknown(
        name, "", meaning, healthy, 0.0, 1.0, physical_unit=unit, physical=physical, **more
    )


UNKNOWNS = (
    _fault("friction", "dynamic dry friction on the motor shaft", "N m", _friction,
           slack=0.1),
    # the misfit has separate valleys for a small, a middling and a large gap
    _fault("backlash", "backlash on the motor shaft", "rad", _backlash, valleys=3,
           slack=0.005),
    _fault("short_a", "shorted turns in phase a", "turns", _turns, slack=0.05),
    _fault("short_b", "shorted turns in phase b", "turns", _turns, slack=0.05),
    _fault("short_c", "shorted turns in phase c", "turns", _turns, slack=0.05),
    _fault("eccentricity", "rotor offset over air gap", "", None),
    _fault("eccentricity_phase", "direction of the eccentricity", "deg", _degrees, 0.5,
           direction_of="eccentricity"),
    _fault("gain", "proportional position gain", "1/s", _gain, 0.5),
)  # fmt: skip

FAULTS = tuple(one.name for one in UNKNOWNS)


# Known exactly, or of no effect on the monitor model: these cannot differ between candidates.
FIXED = (
    "motor.pole_pairs", "motor.turns_per_phase", "transmission.ratio", "steps.reference",
    "steps.monitor",
)  # fmt: skip


@cache
def fault(name: str) -> Unknown:
    """The fault of a name."""
    return next(one for one in UNKNOWNS if one.name == name)
