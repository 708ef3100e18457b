"""Thresholds of faults as a user states them, in the unit of the fault or a physical one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.intervals import Draws
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.quantities import parse_quantity


@dataclass(frozen=True)
class Threshold:
    """Value from which a fault matters."""

    unknown: Unknown  # the fault
    value: float  # in the unit of the unknown, or in `Unknown.physical_unit`
    physical: bool  # the value is physical
    above: bool  # values above are beyond it; else those below are, because healthy lies above

    @property
    def text(self) -> str:
        """The value with its unit."""
        unit = (self.unknown.physical_unit if self.physical else self.unknown.unit) or ""
        return f"{self.value:g} {unit}".rstrip()

    def is_beyond(self, actuator: ParameterSet, drawn: Draws) -> np.ndarray:
        """(N,) of bool, of draws; physical values are multiples of what parameters are in these."""
        one, x = self.unknown, drawn.of(self.unknown.name)
        if self.physical and one.physical is not None:
            places = {name: drawn.of(name) for name in drawn.names if "." in name}
            try:
                x = np.asarray(one.physical(actuator.with_arrays(places), x), dtype=float)
            except TypeError:  # a kind that takes no arrays
                x = np.array([one.physical(actuator, value) for value in x.tolist()], dtype=float)
        return x > self.value if self.above else x < self.value


def thresholds_of(
    given: Mapping[str, float | str], unknowns: Sequence[Unknown], actuator: ParameterSet
) -> dict[str, Threshold]:
    """Thresholds of searched faults by name; a text with a unit is physical.

    `InputError` if there is no such fault, it was held, or the threshold lies outside its range.
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
