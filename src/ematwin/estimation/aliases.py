"""Directions in which a kind knows that its answer does not change, in coordinates of a chart.

Turns that are missing from all phases alike are one, a torque constant that falls with them is the
other: `Model.aliases` names a pivot and the same change in other unknowns. The column of the pivot
in a Jacobian is made of theirs, and while they are fitted most pivots are held, so that no descent
strays where priors alone decide.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Alias

Aliases = Callable[[Mapping[str, float]], Sequence[Alias]]


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
