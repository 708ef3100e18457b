"""The eight normalised fault components: names, order, bounds, healthy values, errors.

ESREL 2020 paper, sections 6 and 7.1.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.plant.parameters import Actuator

FAULTS = (
    "friction", "backlash", "short_a", "short_b", "short_c", "eccentricity",
    "eccentricity_phase", "gain",
)  # fmt: skip
HEALTHY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5])
HEALTHY.flags.writeable = False

# Table 1 of the paper: the ten fault vectors, in its order.
PAPER_CASES = {
    "Low F": {"friction": 0.25},
    "High F": {"friction": 0.75},
    "Low B": {"backlash": 0.10},
    "High B": {"backlash": 0.75},
    "High Na": {"short_a": 0.80},
    "Low Na": {"short_a": 0.30},
    "Low Z": {"eccentricity": 0.25},
    "High Z": {"eccentricity": 0.75},
    "Low Gain": {"gain": 0.25},
    "High Gain": {"gain": 0.75},
}


class PhysicalValue(NamedTuple):
    """What a fault component means on an actuator."""

    name: str
    normalised: float
    value: float
    healthy: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Faults:
    """A fault vector: eight magnitudes in [0, 1]. What is not given is healthy.

    `print` says what the vector means on the default actuator, `physical` on any.

    Raises
    ------
    InputError
        If a value is not a number in [0, 1].
    """

    friction: float = 0.0
    backlash: float = 0.0
    short_a: float = 0.0
    short_b: float = 0.0
    short_c: float = 0.0
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.5
    gain: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _in_unit(field.name, getattr(self, field.name)))

    @classmethod
    def of(cls, values: "Faults | Mapping[str, float] | np.ndarray | None") -> "Faults":
        """Faults from a mapping of names to values, a vector (8,), or None for healthy."""
        if values is None:
            return cls()
        if isinstance(values, Faults):
            return values
        if isinstance(values, Mapping):
            for name in values:
                check_name(name)
            return cls(**values)
        vector = np.asarray(values, dtype=float)
        if vector.shape != (8,):
            raise InputError(
                f"A fault vector has 8 components ({', '.join(FAULTS)}), received shape "
                f"{vector.shape}."
            )
        return cls(*vector.tolist())

    @property
    def vector(self) -> np.ndarray:
        """(8,) array in the order of `FAULTS`."""
        return np.array([getattr(self, name) for name in FAULTS])

    def as_dict(self) -> dict[str, float]:
        """Names and normalised values."""
        return {name: getattr(self, name) for name in FAULTS}

    def physical(self, actuator: "Actuator | str | None" = None) -> list[PhysicalValue]:
        """The physical value of each component on an actuator (the default one if None)."""
        chosen = Actuator.load() if actuator is None else Actuator.load(actuator)
        motor, gear = chosen.motor, chosen.transmission
        torque = motor.friction_torque + gear.friction_torque
        turns = motor.turns_per_phase
        gain = chosen.controller.position_gain
        phase = "direction of the eccentricity"
        if self.eccentricity == 0.0:
            phase += " (no meaning without eccentricity)"
        rows = [
            ("friction", torque * (1.0 + 2.0 * self.friction), torque, "N m",
             "dynamic dry friction on the motor shaft"),
            ("backlash", gear.backlash * (1.0 + 99.0 * self.backlash), gear.backlash, "rad",
             "backlash on the motor shaft"),
            ("short_a", turns * self.short_a, 0.0, "turns", f"shorted in phase a, of {turns}"),
            ("short_b", turns * self.short_b, 0.0, "turns", f"shorted in phase b, of {turns}"),
            ("short_c", turns * self.short_c, 0.0, "turns", f"shorted in phase c, of {turns}"),
            ("eccentricity", self.eccentricity, 0.0, "", "rotor offset over air gap"),
            ("eccentricity_phase", 360.0 * (self.eccentricity_phase - 0.5), 0.0, "deg", phase),
            ("gain", gain * (0.5 + self.gain), gain, "1/s", "proportional position gain"),
        ]  # fmt: skip
        return [
            PhysicalValue(name, getattr(self, name), float(value), float(healthy), unit, meaning)
            for name, value, healthy, unit, meaning in rows
        ]

    def describe(self, actuator: "Actuator | str | None" = None) -> str:
        """A table for people: each component, normalised and physical, against healthy."""
        lines = [f"{'fault':<19} {'k':>6}  {'value':>12}  {'healthy':>12}  meaning"]
        for row in self.physical(actuator):
            value = f"{row.value:.4g} {row.unit}".rstrip()
            healthy = f"{row.healthy:.4g} {row.unit}".rstrip()
            mark = "" if row.normalised == HEALTHY[FAULTS.index(row.name)] else "  <"
            lines.append(
                f"{row.name:<19} {row.normalised:>6.4g}  {value:>12}  {healthy:>12}  "
                f"{row.meaning}{mark}"
            )
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.describe()

    def __repr__(self) -> str:
        given = [
            f"{name}={value:g}"
            for (name, value), healthy in zip(self.as_dict().items(), HEALTHY, strict=True)
            if value != healthy
        ]
        return f"Faults({', '.join(given)})"


def check_name(name: str) -> None:
    """Raise `InputError` if there is no such fault."""
    if name not in FAULTS:
        close = get_close_matches(name, FAULTS, n=1, cutoff=0.5)
        hint = f"Did you mean {close[0]}? " if close else ""
        raise InputError(f"Unknown fault {name!r}. {hint}The faults are {', '.join(FAULTS)}.")


def _in_unit(name: str, value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"Fault {name} must be a number in [0, 1], received {value!r}.") from None
    if not 0.0 <= number <= 1.0:  # NaN fails this as well
        hint = (
            f" It looks like per cent; write {number / 100.0:g}." if 1.0 < number <= 100.0 else ""
        )
        raise InputError(f"Fault {name} must lie in [0, 1], received {number:g}.{hint}")
    return number


def error_percent(estimated: np.ndarray, injected: np.ndarray) -> np.ndarray:
    """Err% of the paper (section 7.1), kept in its exact form.

    100 sqrt( sum_{1..6} (k - k^)^2 + k^_6 (k_7 - k^_7)^2 + (k_8 - k^_8)^2 ), k^ injected. The
    direction of the eccentricity counts as much as there is eccentricity.

    Parameters
    ----------
    estimated, injected : (..., 8) arrays

    Returns
    -------
    (...) array, per cent
    """
    return _error_percent(np.asarray(estimated), np.asarray(injected), wrapped=False)


def error_percent_wrapped(estimated: np.ndarray, injected: np.ndarray) -> np.ndarray:
    """`error_percent` with the direction taken as an angle: k_7 = 0 and k_7 = 1 are the same."""
    return _error_percent(np.asarray(estimated), np.asarray(injected), wrapped=True)


def _error_percent(k: np.ndarray, k_hat: np.ndarray, *, wrapped: bool) -> np.ndarray:
    gap = k - k_hat
    turn = gap[..., 6]
    if wrapped:
        turn = turn - np.round(turn)
    total = (gap[..., :6] ** 2).sum(axis=-1) + k_hat[..., 5] * turn**2 + gap[..., 7] ** 2
    return np.asarray(100.0 * np.sqrt(total))


def eccentricity_vector(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """zeta cos(phi) and zeta sin(phi) of fault vectors (..., 8)."""
    phi = 2.0 * math.pi * (k[..., 6] - 0.5)
    return k[..., 5] * np.cos(phi), k[..., 5] * np.sin(phi)
