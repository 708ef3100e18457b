"""Where a search box lies relative to the healthy actuator.

In the plain box of the brushless actuator six of the eight healthy values lie at the origin, in a
corner. Methods that are drawn to the origin, or that clip at the bounds, find them by that alone.
The remapped box is the same set of vectors turned round: each component is shifted along its range,
and what leaves one end enters at the other. In shares u of the range,

    u = (x - shift) mod 1,    x = (u + shift) mod 1.

The map is one to one and keeps lengths, so that random search cannot tell the boxes apart, and the
cost of a vector is unchanged. A healthy magnitude at the lower bound (u = 0) lies inside, at
x = shift, with u near 1 just below it: no continuous one-to-one map of an interval can bring its
end inside. Methods meet a cliff there where the plain box has a wall. For a direction the shift is
a rotation, without any cliff.
"""

import math
from collections.abc import Sequence

import numpy as np

from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Unknown

# where the first eight healthy values come to lie: not in a corner, nor in the centre, nor on a
# diagonal
_FIRST = (0.31, 0.64, 0.42, 0.73, 0.27, 0.58, 0.69, 0.37)


def places(dimension: int) -> np.ndarray:
    """Where healthy values lie in the remapped box, (d,) array of shares of their ranges.

    Any after the eighth, the n-th, is the fractional part g of n golden ratios, brought into 0.25
    to 0.45 (g < 0.5) or 0.55 to 0.75.
    """
    golden = np.arange(len(_FIRST) + 1, dimension + 1) * 0.5 * (math.sqrt(5.0) - 1.0) % 1.0
    further = 0.25 + 0.4 * golden + 0.1 * (golden >= 0.5)
    return np.append(_FIRST, further)[:dimension]


def shifts(unknowns: Sequence[Unknown]) -> np.ndarray:
    """Shift of each component (d,) that brings its healthy value to its place."""
    healthy = [(one.healthy - one.lower) / one.width for one in unknowns]
    return np.round(np.mod(places(len(healthy)) - healthy, 1.0), 12)


class RemappedProblem(Problem):
    """A problem, without unknowns that each recording has for itself, in the remapped box.

    Methods of the box see it turned round. Methods that follow slopes know no box and use the
    variables of the problem; but they start in the middle of the remapped box, not at healthy.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.comparisons, problem.unknowns, held=problem.held)
        self._shift = shifts(self.unknowns)
        middle = 0.5 * (self.lower + self.upper)
        self.start = self.from_box(middle[None])[0]
        self.starts = self.start[None]

    def from_box(self, points: np.ndarray) -> np.ndarray:
        """Vectors (N, d) from points (N, d) of the remapped box."""
        return self._turned(points, -self._shift)

    def to_box(self, vectors: np.ndarray) -> np.ndarray:
        """Points (N, d) of the remapped box from vectors (N, d)."""
        return self._turned(vectors, self._shift)

    def _turned(self, points: np.ndarray, by: np.ndarray) -> np.ndarray:
        lower, upper = self.lower, self.upper
        share = np.mod((points - lower) / (upper - lower) + by, 1.0)
        return np.clip(lower + share * (upper - lower), lower, upper)
