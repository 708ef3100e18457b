"""Directions in which a kind knows that its answer does not change, in coordinates of a chart.

Turns that are missing from all phases alike are one, a torque constant that falls with them is the
other: `Model.aliases` names a pivot and the same change in other unknowns. The column of the pivot
in a Jacobian is made of theirs, and while they are fitted most pivots are held, so that no descent
strays where priors alone decide.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Alias

Aliases = Callable[[Mapping[str, float]], Sequence[Alias]]
_FACTOR = 1.02  # by which a fault and a parameter are changed against one another
_SAME = 1e-6  # of the change by the fault alone: rounding


def aliases_of(
    model: Model, actuator: ParameterSet, problem: Problem, point: np.ndarray
) -> Aliases:
    """The aliases of a kind, or where it names none, products of a fault and a parameter.

    ``problem`` has all unknowns free; the twin is asked at a point (d,) of it.
    """
    if type(model).aliases is not Model.aliases:
        return partial(model.aliases, actuator)
    products = _products(problem, point)

    def aliases(values: Mapping[str, float]) -> list[Alias]:
        known = {one.name: one for one in problem.unknowns}
        return [
            Alias(place, {name: power if known[name].logarithmic else power * values[name]}, False)
            for name, place, power in products
        ]

    return aliases


def _products(problem: Problem, point: np.ndarray) -> list[tuple[str, str, float]]:
    """Faults of which only the product with a parameter, or their ratio, has an effect.

    Name, place, and the power of the parameter that the fault is changed by: answers stay the same
    but for rounding where both are changed against one another.
    """
    names = list(problem.names)
    faults = [n for n, one in enumerate(problem.unknowns) if one.role == "fault" and point[n] > 0.0]
    places = [n for n, one in enumerate(problem.unknowns) if one.role == "nominal"]
    pairs = [(f, p, power) for f in faults for p in places for power in (1.0, -1.0)]
    if not pairs:
        return []
    # towards the inside of the fault's range
    sign = np.where(_FACTOR * point <= problem.upper, 1.0, -1.0)
    rows = np.tile(point, (1 + len(faults) + len(pairs), 1))
    for n, f in enumerate(faults, 1):
        rows[n, f] *= _FACTOR ** sign[f]
    for n, (f, p, power) in enumerate(pairs, 1 + len(faults)):
        rows[n, f] *= _FACTOR ** sign[f]
        rows[n, p] *= _FACTOR ** (-sign[f] * power)
    left = problem.split(problem.residuals(rows)).data
    changes = np.linalg.norm(left[1:] - left[0], axis=1)
    alone = dict(zip(faults, changes, strict=False))
    together = changes[len(faults) :]
    return [
        (names[f], names[p], power)
        for (f, p, power), change in zip(pairs, together, strict=True)
        if change < _SAME * alone[f]
    ]


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
    def blind(self) -> np.ndarray:
        """(d,) the direction in which answers stay, its largest component one."""
        found = -self.same
        found[self.pivot] += 1.0
        return np.asarray(found / np.abs(found).max())


def directions(problem: Problem, point: np.ndarray, aliases: Aliases | None) -> list[Direction]:
    """The aliases at a point (d,); of those whose unknowns are not all free nothing is known."""
    names, widths = list(problem.names), problem.chart.widths
    found = []
    for one in () if aliases is None else aliases(problem.values(point)):
        if one.pivot not in names:
            continue
        same = np.zeros(len(names))
        complete = True
        for name, change in one.same.items():
            places = [n for n, own in enumerate(names) if own.partition("@")[0] == name]
            complete &= bool(places)
            same[places] = change
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
