"""Whale optimisation algorithm.

Mirjalili and Lewis (2016), The Whale Optimization Algorithm, Adv. Eng. Softw. 95, 51-67,
equations (2.1) to (2.8), and the first author's program, "WOA source codes demo 1.0".

The leader X* is the best point ever seen; a falls from 2 to 0 and a2 from -1 to -2. Each whale
draws A = 2 a r1 - a, C = 2 r2, l = (a2 - 1) r + 1 and p, each once for all its variables:

    p >= 1/2:              X <- |X* - X| exp(b l) cos(2 pi l) + X*,   b = 1       (bubble net)
    p < 1/2 and |A| < 1:   X <- X* - A |C X* - X|                                 (encircling)
    p < 1/2 and |A| >= 1:  X <- X_r - A |C X_r - X|                               (search)

Departure: none. As in the program, and unlike the paper's text: the whale r is drawn anew for
every variable; whales move one after another, so that a whale drawn from among those before it has
moved already (and may be outside the box); l is uniform in [a2, 1]; a leader not yet found stands
at the coordinates' zero; positions are clipped before they are evaluated. ``start`` and ``power``
other than 2 and 1 are departures: a = start (1 - (t / T)^power), as for the grey wolf.
"""

import numpy as np

from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer, falling, positive


class Whale(PopulationOptimizer):
    """Whale optimisation algorithm.

    Parameters
    ----------
    spiral : float, the constant b of the logarithmic spiral; 1 in the paper
    start : float, of a; 2 in the paper
    power : float, of the share of the iterations by which a falls to 0; 1 in the paper
    """

    def __init__(
        self,
        box: Box,
        *,
        spiral: float = 1.0,
        start: float = 2.0,
        power: float = 1.0,
        **settings: int,
    ) -> None:
        super().__init__(box, **settings)
        self.spiral = float(spiral)
        self.start = positive(start, "start of a")
        self.power = positive(power, "power by which a falls")
        self.leader = np.zeros(box.dimension)
        self.leader_cost = np.inf

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        best = int(np.argmin(costs))
        if costs[best] < self.leader_cost:
            self.leader_cost = float(costs[best])
            self.leader = points[best].copy()

    def limits(self) -> FloatArray:
        """Only a whale that is better than the leader counts."""
        return np.full(self.population, self.leader_cost)

    def _move(self) -> FloatArray:
        step = min(self.iteration - 1, self.iterations)
        a = falling(self.start, step, self.iterations, self.power)
        a2 = -1.0 - step / self.iterations
        r1, r2, r3, p = self.rng.random((4, self.population, 1))
        A = 2.0 * a * r1 - a
        C = 2.0 * r2
        l = (a2 - 1.0) * r3 + 1.0

        whales, leader = self.points, self.leader
        bubble_net = np.abs(leader - whales) * np.exp(self.spiral * l) * np.cos(2.0 * np.pi * l)
        encircling = A * np.abs(C * leader - whales)
        moved = leader + np.where(p < 0.5, -encircling, bubble_net)
        searching = np.flatnonzero((p < 0.5) & (np.abs(A) >= 1.0))
        if searching.size:
            self._search(moved, searching, A[searching], C[searching])
        return self.box.clip(moved)

    def _search(self, moved: FloatArray, rows: np.ndarray, A: FloatArray, C: FloatArray) -> None:
        """Move the searching whales as if they went one after another.

        A whale needs only whales before it, so repeating the step for all at once settles the
        first one, then all that depend on settled ones, until nothing changes: a few rounds, and
        the same numbers as the loop over whales.
        """
        drawn = self.rng.integers(self.population, size=(rows.size, self.box.dimension))
        columns = np.arange(self.box.dimension)
        before = drawn < rows[:, None]
        unmoved = self.points[drawn, columns]
        own = self.points[rows]
        while True:
            other = np.where(before, moved[drawn, columns], unmoved)
            target = other - A * np.abs(C * other - own)
            if np.array_equal(target, moved[rows]):
                return
            moved[rows] = target
