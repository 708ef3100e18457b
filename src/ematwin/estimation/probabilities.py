"""Probabilities that a fault is present, and that it lies beyond a threshold.

The joint density takes each fault to be as likely anywhere in its range, as its interval wants it.
For a probability that is too much: where a recording leaves a fault wide open, "anywhere" is nearly
all outside of healthy, and a healthy gain would be faulty with 80 %. So a fault is also taken to be
absent, within `SMALLEST` of its range, with a separate prior probability: a spike and a slab
(Mitchell and Beauchamp 1988, J. Am. Stat. Assoc. 83, 1023-1032), the spike as wide as that. Draws
within it then count `weight` times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import BEFOREHAND, SMALLEST
from ematwin.estimation.intervals import Draws
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.quantities import parse_quantity

_FEWEST = 20.0  # draws that all together must be worth; else each fault is weighed alone


@dataclass(frozen=True)
class Threshold:
    """Value from which a fault matters.

    Attributes
    ----------
    unknown : the fault
    value : in the unit of the unknown, or in `Unknown.physical_unit`
    physical : whether the value is physical
    above : whether values above are beyond it; else those below are, because healthy lies above
    """

    unknown: Unknown
    value: float
    physical: bool
    above: bool

    @property
    def text(self) -> str:
        """The value with its unit."""
        unit = (self.unknown.physical_unit if self.physical else self.unknown.unit) or ""
        return f"{self.value:g} {unit}".rstrip()

    def is_beyond(self, values: np.ndarray) -> np.ndarray:
        """(N,) of bool, for values (N,) in the unit of the threshold."""
        return np.asarray(values > self.value if self.above else values < self.value)

    def values(self, actuator: ParameterSet, drawn: Draws) -> np.ndarray:
        """(N,) values of draws in the unit of the threshold.

        Physical ones are products, where a fault is a multiple of a parameter.
        """
        one, x = self.unknown, drawn.of(self.unknown.name)
        if not self.physical or one.physical is None:
            return x
        places = {name: drawn.of(name) for name in drawn.names if "." in name}
        try:
            return np.asarray(one.physical(actuator.with_arrays(places), x), dtype=float)
        except TypeError:  # a kind that takes no arrays
            return np.array([one.physical(actuator, value) for value in x.tolist()], dtype=float)


def thresholds_of(
    given: Mapping[str, float | str], unknowns: Sequence[Unknown], actuator: ParameterSet
) -> dict[str, Threshold]:
    """Thresholds of searched faults by name; a text with a unit is physical.

    Raises
    ------
    InputError
        If there is no such fault, it was held, or the threshold lies outside its range.
    """
    known = {one.name: one for one in unknowns if one.role == "fault" and one.direction_of is None}
    found = {}
    for name, value in given.items():
        if name not in known:
            raise InputError(
                f"There is no searched fault {name!r} to compare with a threshold; name one of "
                f"{', '.join(known)}."
            )
        found[name] = _threshold(known[name], value, actuator)
    return found


def _threshold(one: Unknown, given: float | str, actuator: ParameterSet) -> Threshold:
    what, unit, physical = f"The threshold of {one.name}", one.unit, False
    if isinstance(given, str):
        head, _, tail = given.strip().partition(" ")
        physical = bool(tail) and one.physical_unit is not None
        unit = (one.physical_unit or unit) if tail else unit
        if tail.strip().replace(" ", "*") == unit.replace(" ", "*"):
            given, unit = head, ""  # as it is: some units, such as turns, are no unit of SI
        value = parse_quantity(given, unit.replace(" ", "*"), what)
    else:
        value = float(given)
    ends = [one.lower, one.healthy, one.upper]
    if physical:
        ends = [one.physical_value(actuator, end).value for end in ends]
    low, high = min(ends), max(ends)
    threshold = Threshold(one, value, physical, value >= ends[1])
    if not low <= value <= high:
        raise InputError(
            f"{what} must lie in its range [{low:.4g}, {high:.4g}], received {threshold.text}."
        )
    return threshold


@dataclass(frozen=True)
class Presence:
    """Weighted draws of faults that may be absent.

    Attributes
    ----------
    absent : by fault, (N,) of bool
    weights : by fault, (N,) arrays of sum 1
    together : whether one array weighs all faults together; else each is weighed as if it were the
        only one that may be absent, and nothing is known of several at once
    """

    absent: dict[str, np.ndarray]
    weights: dict[str, np.ndarray]
    together: bool

    def probability(self, name: str) -> float:
        """That a fault is present."""
        return float(self.weights[name] @ ~self.absent[name])

    @property
    def healthy(self) -> float | None:
        """The probability that no fault is present; None where draws are of each alone."""
        if not self.absent or not self.together:
            return None
        return float(next(iter(self.weights.values())) @ np.all(list(self.absent.values()), axis=0))


def presence(
    faults: Sequence[Unknown], values: Mapping[str, np.ndarray], mass: np.ndarray | None = None
) -> Presence:
    """Weights of draws by spike and slab.

    All faults are weighed together, unless a few draws would outweigh all others.

    Parameters
    ----------
    faults : that may be absent
    values : draws (N,) of them from the joint density
    mass : (N,) array, how much each draw counts there; all alike if not given
    """
    absent = {
        one.name: np.asarray(np.abs(values[one.name] - one.healthy) < SMALLEST * one.width)
        for one in faults
    }
    with np.errstate(divide="ignore"):
        start = 0.0 if mass is None else np.log(mass)
    logs = {one.name: np.log(weight_of(one)) * absent[one.name] for one in faults}
    together = _normalised(start + np.sum(list(logs.values()), axis=0))
    if mass is not None or 1.0 / float(together @ together) >= _FEWEST:
        return Presence(absent, dict.fromkeys(absent, together), True)
    alone = {name: _normalised(log) for name, log in logs.items()}
    return Presence(absent, alone, False)


def weight_of(one: Unknown) -> float:
    """How many times likelier an absent fault is beforehand than its share of the range."""
    reach = SMALLEST * one.width
    ends = np.clip([one.healthy - reach, one.healthy + reach], one.lower, one.upper)
    share = float(np.diff(ends)[0] / one.width)
    if one.logarithmic:
        share = float(np.diff(np.log(ends))[0] / np.log(one.upper / one.lower))
    return (1.0 - BEFOREHAND) / BEFOREHAND * (1.0 - share) / share


def _normalised(log: np.ndarray) -> np.ndarray:
    found = np.exp(log - log.max())
    return np.asarray(found / found.sum())
