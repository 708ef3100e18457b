"""Directions in which a kind knows that its answer does not change, in coordinates of a chart.

A fault and the parameter that it multiplies count as a product: `Model.aliases` names a pivot and
the same change in other unknowns. The column of the pivot in a Jacobian is made of theirs, and
while they are fitted most pivots are held, so that no descent strays where priors alone decide.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Alias, Unknown

Aliases = Callable[[Mapping[str, float]], Sequence[Alias]]
_FACTOR = 1.02  # by which a parameter grows


def aliases_of(
    model: Model, actuator: ParameterSet, problem: Problem, point: np.ndarray
) -> Aliases:
    """The aliases of a kind, or where it names none, those that its twin shows.

    ``problem`` has all unknowns free; the twin is asked at a point (d,) of it.
    """
    if type(model).aliases is not Model.aliases:
        return partial(model.aliases, actuator)
    known = {one.name: one for one in problem.unknowns}
    shown = _shown_by_twin(actuator, problem, point)

    def aliases(values: Mapping[str, float]) -> list[Alias]:
        found = []
        for name, place in shown:
            change = _stand_in(actuator, known[name], values, place).slope
            if not known[name].logarithmic:
                change *= values[name]
            found.append(Alias(place, {name: change}, held=False))
        return found

    return aliases


class _StandIn(NamedTuple):
    """A change of a fault with the effect of a parameter that grows by `_FACTOR`.

    Attributes
    ----------
    slope : float, change of the fault's logarithm per change of the parameter's logarithm
    against : float, the value of the fault that takes the parameter's growth back
    """

    slope: float
    against: float


def _stand_in(
    actuator: ParameterSet, one: Unknown, values: Mapping[str, float], place: str
) -> _StandIn:
    """By the physical value of a fault, which is proportional to it; else by their product."""
    k = values[one.name]
    plain = _StandIn(1.0, k / _FACTOR)
    if one.physical is None:
        return plain
    places = {name: value for name, value in values.items() if "." in name}
    grown = {**places, place: places[place] * _FACTOR}
    try:
        now = float(one.physical(actuator.with_arrays(places), k))
        then = float(one.physical(actuator.with_arrays(grown), k))
    except (TypeError, ValueError):  # a kind that takes no arrays
        return plain
    if not (now > 0.0 and then > 0.0):
        return plain
    return _StandIn(float(np.log(then / now) / np.log(_FACTOR)), k * now / then)


def _shown_by_twin(
    actuator: ParameterSet, problem: Problem, point: np.ndarray
) -> list[tuple[str, str]]:
    """Faults, each with a parameter whose change a change of the fault takes back entirely.

    Such are a gap and how many times it is as wide: answers stay the same but for rounding where
    both are changed against one another.
    """
    names, values = list(problem.names), problem.values(point)
    places = [n for n, one in enumerate(problem.unknowns) if one.role == "nominal"]
    rows, asked = [point], []
    for f, one in enumerate(problem.unknowns):
        if one.role != "fault" or not point[f] > 0.0:
            continue
        for p in places:
            stand_in = _stand_in(actuator, one, values, names[p])
            if stand_in.slope and one.lower <= stand_in.against <= one.upper:
                grown, both = point.copy(), point.copy()
                grown[p] = both[p] = point[p] * _FACTOR
                both[f] = stand_in.against
                asked.append((one.name, names[p]))
                rows += [grown, both]
    if not asked:
        return []
    left = problem.split(problem.residuals(np.array(rows))).data
    alone, together = np.linalg.norm(left[1:] - left[0], axis=1).reshape(-1, 2).T
    # less than a millionth of the change by the parameter alone is rounding
    return [pair for pair, a, b in zip(asked, alone, together, strict=True) if b < 1e-6 * a]


class Direction(NamedTuple):
    """An alias between the free unknowns of a problem.

    Attributes
    ----------
    pivot : int, place of its unknown
    same : (d,) array, the change of the others that changes answers as one of the pivot does
    held : bool, whether the pivot stays while the others are fitted
    """

    pivot: int
    same: np.ndarray
    held: bool

    @property
    def others(self) -> set[int]:
        """Places of the unknowns that change in place of the pivot."""
        return set(np.flatnonzero(self.same).tolist())

    @property
    def blind(self) -> np.ndarray:
        """(d,) the direction in which answers stay, its largest component one."""
        found = -self.same
        found[self.pivot] += 1.0
        return np.asarray(found / np.abs(found).max())


def directions(problem: Problem, point: np.ndarray, aliases: Aliases | None) -> list[Direction]:
    """The aliases at a point (d,); of those whose unknowns are not all free nothing is known."""
    names = list(problem.names)
    # an alias is of logarithms of parameters, which may be free as values
    by_values = [one.role == "nominal" and not one.logarithmic for one in problem.unknowns]
    scales = np.where(by_values & (point > 0.0), point, 1.0)
    widths = problem.chart.widths / scales
    found = []
    for one in () if aliases is None else aliases(problem.values(point)):
        if one.pivot not in names:
            continue
        same = np.zeros(len(names))
        complete = True
        for name, change in one.same.items():
            places = [n for n, own in enumerate(names) if own.partition("@")[0] == name]
            complete &= bool(places)
            same[places] = change * (point[places] if one.multiplies else 1.0)
        pivot = names.index(one.pivot)
        if complete:
            found.append(Direction(pivot, same / widths * widths[pivot], one.held))
    return found


def held_by(problem: Problem, point: np.ndarray, aliases: Aliases | None) -> set[str]:
    """Names of the unknowns that aliases hold where they are while the others are fitted."""
    return held_pivots(problem, directions(problem, point, aliases))


def held_pivots(problem: Problem, known: Sequence[Direction]) -> set[str]:
    """Names of the pivots that stay while the others are fitted."""
    return {problem.names[one.pivot] for one in known if one.held}
