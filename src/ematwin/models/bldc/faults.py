"""The eight normalised fault components: names, order, bounds, healthy values, errors.

ESREL 2020 paper, sections 6 and 7.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.unknowns import FAULTS, UNKNOWNS, fault
from ematwin.models.optional import Study, Values
from ematwin.models.unknown import PhysicalValue, Unknown, physical_html, table_of
from ematwin.showing.results import frame_of_rows

HEALTHY = np.array([one.healthy for one in UNKNOWNS])
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


@dataclass(frozen=True)
class Faults:
    """A fault vector: eight magnitudes in [0, 1], healthy by default.

    `print` shows physical values on the default actuator, `physical` on any.

    Raises `InputError` if a value is not a number in [0, 1].
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
            value = fault(field.name).check(getattr(self, field.name))
            object.__setattr__(self, field.name, value)

    @classmethod
    def of(cls, values: "Faults | Mapping[str, float] | np.ndarray | None") -> "Faults":
        """Faults from a mapping of names to values, a vector (8,), or None for healthy."""
        if values is None:
            return cls()
        if isinstance(values, Faults):
            return values
        if isinstance(values, Mapping):
            for name in values:
                if name not in FAULTS:
                    close = get_close_matches(name, FAULTS, n=1, cutoff=0.5)
                    hint = f"Did you mean {close[0]}? " if close else ""
                    raise InputError(
                        f"Unknown fault {name!r}. {hint}The faults are {', '.join(FAULTS)}."
                    )
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

    def physical(self, actuator: "BldcActuator | str | None" = None) -> list[PhysicalValue]:
        """The physical value of each component on an actuator (the default one if None)."""
        chosen = BldcActuator.load() if actuator is None else BldcActuator.load(actuator)
        from ematwin.models.bldc.model import MODEL

        return MODEL.describe(chosen, self.as_dict())

    def describe(self, actuator: "BldcActuator | str | None" = None) -> str:
        """A table for people: each component, normalised and physical, against healthy."""
        return table_of(self.physical(actuator))

    def __str__(self) -> str:
        return self.describe()

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each component, by name; needs pandas."""
        return frame_of_rows((row._asdict() for row in self.physical()), "name")

    to_dataframe = to_frame

    def _repr_html_(self) -> str:
        """Physical values on the default actuator, in a notebook."""
        return physical_html(repr(self), self.physical())

    def __repr__(self) -> str:
        given = [
            f"{name}={value:g}"
            for (name, value), healthy in zip(self.as_dict().items(), HEALTHY, strict=True)
            if value != healthy
        ]
        return f"Faults({', '.join(given)})"


def error_percent(
    estimated: np.ndarray, injected: np.ndarray, *, wrapped: bool = False
) -> np.ndarray:
    """Err% of the paper (section 7.1), (...) array, in its exact form unless ``wrapped``.

    100 sqrt( sum_{1..6} (k - k^)^2 + k^_6 (k_7 - k^_7)^2 + (k_8 - k^_8)^2 ), k^ injected; both
    (..., 8) arrays. ``wrapped`` takes the direction as an angle: k_7 = 0 and k_7 = 1 are the same.
    """
    k_hat = np.asarray(injected)
    gap = np.asarray(estimated) - k_hat
    turn = gap[..., 6]
    if wrapped:
        turn = turn - np.round(turn)
    total = (gap[..., :6] ** 2).sum(axis=-1) + k_hat[..., 5] * turn**2 + gap[..., 7] ** 2
    return np.asarray(100.0 * np.sqrt(total))


def error_percent_wrapped(estimated: np.ndarray, injected: np.ndarray) -> np.ndarray:
    """`error_percent` with the direction of the eccentricity as an angle."""
    return error_percent(estimated, injected, wrapped=True)


class PaperStudy(Study):
    """The paper's cases and its error measure."""

    def cases(self, faults: tuple[Unknown, ...]) -> dict[str, dict[str, float]]:
        """Table 1 of the paper."""
        return PAPER_CASES

    def error_percent(
        self, faults: tuple[Unknown, ...], found: Values, injected: Values, *, wrapped: bool = False
    ) -> float:
        """Err% of the paper; ``wrapped`` takes the direction of the eccentricity as an angle."""
        one, other = (np.array([values[name] for name in FAULTS]) for values in (found, injected))
        return float(error_percent(one, other, wrapped=wrapped))
