"""Unknown: one number of an actuator that a recording may tell.

A fault, a nominal parameter or a nuisance such as an unrecorded load: each can be searched, held
at a value, or given a prior. Tables of faults, columns of results and bounds of searches
all follow from it.
"""

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal, NamedTuple

import numpy as np

from ematwin.errors import InputError
from ematwin.showing.results import html
from ematwin.showing.text import said, said_between

Role = Literal["fault", "nominal", "nuisance", "symptom"]


class PhysicalValue(NamedTuple):
    """Physical value of an unknown on an actuator."""

    name: str
    normalised: float  # as it is searched
    value: float  # in ``unit``
    healthy: float
    unit: str
    meaning: str

    @property
    def said(self) -> tuple[str, str]:
        """Value and healthy value for people, such as "45 mN m"."""
        return said(self.value, self.unit), said(self.healthy, self.unit)


class Alias(NamedTuple):
    """A direction in which the answer of a twin does not change."""

    pivot: str
    same: dict[str, float]  # changes of others by name that have the effect of its change by one
    held: bool = True  # at the mean of its prior while others are fitted: it widens their intervals
    # it changes the others by shares of their values: what is healthy stays so, and the pivot shows
    # nothing of which faults are there
    multiplies: bool = False


class Contrast(NamedTuple):
    """A combination of faults that tells more than each for itself."""

    name: str
    weights: dict[str, float]  # by name
    meaning: str
    ambiguity: str = ""  # a sentence on other causes
    unit: str = ""  # of ``physical``
    physical: Callable[[Any, float], float] | None = None  # (actuator, combination) -> in ``unit``

    def said(self, actuator: Any, value: float, low: float, high: float) -> tuple[str, str]:
        """Value and interval for people: "4.01 turns", "3.99 to 4.03"."""
        of = self.physical or (lambda actuator, x: x)
        return said_between(of(actuator, value), of(actuator, low), of(actuator, high), self.unit)


def table_of(rows: Sequence[PhysicalValue], marked: Container[str] | None = None) -> str:
    """A table for people; ``marked`` names what stands out, by default all that is not healthy."""
    lines = [f"{'fault':<19} {'k':>6}  {'value':>12}  {'healthy':>12}  meaning"]
    for row in rows:
        value, healthy = row.said
        stands_out = row.value != row.healthy if marked is None else row.name in marked
        lines.append(
            f"{row.name:<19} {row.normalised:>6.4g}  {value:>12}  {healthy:>12}  "
            f"{row.meaning}{'  <' if stands_out else ''}"
        )
    return "\n".join(lines)


def physical_html(title: str, rows: Sequence[PhysicalValue]) -> str:
    """The same table for a notebook, below a title; values that are not healthy are bold."""
    cells = [(row.name, f"{row.normalised:.4g}", *row.said, row.meaning) for row in rows]
    marked = [n for n, row in enumerate(rows) if row.value != row.healthy]
    header = ("fault", "k", "value", "healthy", "meaning")
    return html(title, header, cells, marked=marked)


@dataclass(frozen=True)
class Unknown:
    """One unknown of an actuator.

    Parameters
    ----------
    name : str; a nominal parameter has the place of the parameter, e.g. ``motor.resistance``
    unit : str, SI unit of the value; "" for a ratio or a normalised fault
    meaning : str
    healthy : float, the value of a healthy actuator, or the nominal value
    lower, upper : float, bounds, both included
    role : "fault"; "nominal"; "nuisance" (differs from recording to recording, and is no fault); or
        "symptom" (can be simulated, but is read from residuals and not searched)
    spread : float or None, standard deviation of the prior around ``healthy``; of the logarithm
        where ``logarithmic``. None: no prior
    logarithmic : bool, searched by its logarithm
    marginal : bool, held at its healthy value while faults are searched; its prior widens their
        intervals afterwards
    direction_of : str or None, name of the magnitude whose direction this is, in turns from
        -1/2: the two are searched as the components of a vector
    valleys : int, number of ranges of the value in which the misfit may have separate minima
    physical_unit : str, of ``physical``; None takes ``unit``
    physical : callable or None, ``(actuator, value) -> value in physical_unit``, floats or arrays;
        None where the value itself is physical
    caveat : str, a sentence that is said where this fault is named; "" for none

    Raises
    ------
    InputError
        If the bounds do not hold the healthy value, or a logarithm is not defined on them.
    """

    name: str
    unit: str
    meaning: str
    healthy: float
    lower: float
    upper: float
    role: Role = "fault"
    spread: float | None = None
    logarithmic: bool = False
    marginal: bool = False
    direction_of: str | None = None
    valleys: int = 1
    physical_unit: str | None = None
    physical: Callable[[Any, Any], Any] | None = None
    caveat: str = ""

    def __post_init__(self) -> None:
        if not self.lower < self.upper or not self.lower <= self.healthy <= self.upper:
            raise InputError(
                f"Unknown {self.name} must have lower < upper and a healthy value between them, "
                f"received {self.lower:g}, {self.upper:g} and {self.healthy:g}."
            )
        if self.logarithmic and not self.lower > 0.0:
            raise InputError(
                f"Unknown {self.name} is searched by its logarithm and needs a positive lower "
                f"bound, received {self.lower:g}."
            )
        if self.spread is not None and not self.spread > 0.0:
            raise InputError(
                f"The prior of {self.name} must have a positive spread, received {self.spread:g}."
            )

    @property
    def width(self) -> float:
        """Upper less lower bound."""
        return self.upper - self.lower

    def check(self, value: Any) -> float:
        """The value as a float.

        Raises `InputError` if it is not a number within the bounds.
        """
        what = f"{self.role.capitalize()} {self.name}"
        bounds = f"[{self.lower:g}, {self.upper:g}]" + (f" {self.unit}" if self.unit else "")
        try:
            number = float(value)
        except OverflowError:  # a whole number beyond the floats
            raise InputError(
                f"{what} must lie in {bounds}, received one of more than 300 digits."
            ) from None
        except (TypeError, ValueError):
            raise InputError(f"{what} must be a number in {bounds}, received {value!r}.") from None
        if not self.lower <= number <= self.upper:  # NaN fails this as well
            hint = ""
            # 1.5 is a slip or a factor; 15 or 25 is a percentage
            if self.unit == "" and (self.lower, self.upper) == (0.0, 1.0) and 2.0 <= number <= 100:
                hint = f" If this is a percentage, write {number / 100.0:g}."
            raise InputError(f"{what} must lie in {bounds}, received {number:g}.{hint}")
        return number

    def physical_value(self, actuator: Any, value: float) -> PhysicalValue:
        """Physical value on an actuator."""
        now, healthy = value, self.healthy
        if self.physical is not None:
            now, healthy = self.physical(actuator, value), self.physical(actuator, self.healthy)
        unit = self.unit if self.physical_unit is None else self.physical_unit
        return PhysicalValue(
            self.name, float(value), float(now), float(healthy), unit, self.meaning
        )


class HasUnknowns:
    """Names, bounds and healthy values of ``unknowns``, in their order."""

    unknowns: tuple[Unknown, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """(d,) names."""
        return tuple(one.name for one in self.unknowns)

    @property
    def lower(self) -> np.ndarray:
        """(d,) lower bounds."""
        return np.array([one.lower for one in self.unknowns])

    @property
    def upper(self) -> np.ndarray:
        """(d,) upper bounds."""
        return np.array([one.upper for one in self.unknowns])

    @property
    def healthy(self) -> np.ndarray:
        """(d,) healthy values."""
        return np.array([one.healthy for one in self.unknowns])


@dataclass(frozen=True)
class Times:
    """A factor on a parameter as the value of the parameter; it travels between processes."""

    place: str

    def __call__(self, actuator: Any, factor: Any) -> Any:
        """The value of the parameter, multiplied."""
        return factor * actuator.value(self.place)


def multiple(
    actuator: Any, name: str, place: str, meaning: str, lower: float, upper: float,
    than: str = "healthy one",
) -> Unknown:  # fmt: skip
    """A fault that multiplies a parameter, searched by its logarithm."""
    return Unknown(
        name, "", f"{meaning}, as a multiple of the {than}", 1.0, lower, upper, logarithmic=True,
        physical_unit=actuator.parameter(place)[2], physical=Times(place),
    )  # fmt: skip


def nuisance(
    name: str, unit: str, meaning: str, healthy: float, reach: float, spread: float, **more: Any
) -> Unknown:
    """A nuisance that widens intervals, ``reach`` to both sides; ``more`` as of `Unknown`."""
    low, high, more = healthy - reach, healthy + reach, {"spread": spread, "marginal": True, **more}
    return Unknown(name, unit, meaning, healthy, low, high, "nuisance", **more)


def of_parameter(
    actuator: Any, place: str, factor: float | None, deviation: float | None = None
) -> Unknown:
    """A parameter of an actuator as an unknown.

    ``factor`` is that by which a data sheet may be off, one standard deviation; ``deviation`` the
    same in the unit of a parameter of either sign. None if not known.
    """
    _, value, unit, meaning, _ = actuator.parameter(place)
    low, high = actuator.limits(place)
    # three times smaller or larger than its file says, and four deviations of its prior in any case
    least, deviations = 3.0, 4.0
    logarithmic = value > 0.0 and deviation is None
    if logarithmic:
        tolerance = actuator.tolerance(place)
        usual = factor or 1.0 if tolerance is None else math.sqrt(1.0 + tolerance)
        reach = max(least, usual**deviations)
        low, high = max(value / reach, low), min(value * reach, high)
        if not low < high:
            raise InputError(f"{place} of {actuator.name} has no range to search.")
        deviation = None if factor is None else math.log(factor)
    else:
        reach = least * (abs(value) or 1.0) if deviation is None else deviations * deviation
        low, high = max(value - reach, low), min(value + reach, high)
    return Unknown(
        place, unit, meaning, value, low, high, "nominal", deviation, logarithmic=logarithmic
    )


def no_unknown(name: str, actuator: Any, unknowns: Sequence[Unknown]) -> InputError:
    """The error that names the unknown closest to a name that there is not."""
    known = [one.name for one in unknowns]
    faults = [one.name for one in unknowns if one.role == "fault"]
    places = [row[0] for row in actuator.parameters()]
    close = get_close_matches(name, [*known, *places], n=1, cutoff=0.5)
    hint = f"Did you mean {close[0]}? " if close else ""
    return InputError(
        f"Unknown fault {name!r}. {hint}The faults are {', '.join(faults)}; parameters are named "
        f"by their place, such as {places[0]}."
    )
