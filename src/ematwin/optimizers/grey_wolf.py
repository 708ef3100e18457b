"""Grey wolf optimiser.

Mirjalili, Mirjalili and Lewis (2014), Grey Wolf Optimizer, Adv. Eng. Softw. 69, 46-61,
equations (3.1) to (3.7), and the first author's program, "GWO source codes version 1.0".

Three leaders, alpha, beta and delta, are the best points ever seen; a falls from 2 to 0:

    A = 2 a r1 - a,   C = 2 r2,   X_k = L_k - A_k |C_k L_k - X|   (k = alpha, beta, delta)
    X <- (X_alpha + X_beta + X_delta) / 3

with fresh r1, r2 for every wolf, leader and variable.

Departure: none. As in the program, and unlike the paper's text: a wolf that takes a leader's place
does not push the old leader down a rank; a leader not yet found stands at the coordinates' zero;
positions outside the box are clipped before they are evaluated. ``start`` and ``power`` other than
2 and 1 are departures: a = start (1 - (t / T)^power), as in Mittal, Singh and Sohi (2016), Modified
Grey Wolf Optimizer, Appl. Comput. Intell. Soft Comput. 2016, 7950348, where the power is 2.
"""

import numpy as np

from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer, falling, positive


class GreyWolf(PopulationOptimizer):
    """Grey wolf optimiser.

    Parameters
    ----------
    start : float, of a; 2 in the paper
    power : float, of the share of the iterations by which a falls to 0; 1 in the paper
    """

    def __init__(
        self, box: Box, *, start: float = 2.0, power: float = 1.0, **settings: int
    ) -> None:
        super().__init__(box, **settings)
        self.start = positive(start, "start of a")
        self.power = positive(power, "power by which a falls")
        self.leaders = np.zeros((3, box.dimension))
        self.leader_costs = np.full(3, np.inf)

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        """Run the program's wolf-by-wolf comparison, with running minima in place of the loop.

        Alpha after wolf i is the least cost so far. Beta may only be a wolf that is worse than
        alpha at that moment, delta only one that is worse than both.
        """
        eligible = np.ones(len(costs), dtype=bool)
        for rank in range(3):
            offered = np.where(eligible, costs, np.inf)
            best = int(np.argmin(offered))
            running = np.minimum(np.minimum.accumulate(offered), self.leader_costs[rank])
            if offered[best] < self.leader_costs[rank]:
                self.leader_costs[rank] = offered[best]
                self.leaders[rank] = points[best]
            eligible &= costs > running

    def limits(self) -> FloatArray:
        """A wolf that is worse than all three leaders leads nobody."""
        return np.full(self.population, self.leader_costs.max())

    def _move(self) -> FloatArray:
        # The batch just told is number iteration - 1, counted from zero as in the program.
        step = min(self.iteration - 1, self.iterations)
        a = falling(self.start, step, self.iterations, self.power)
        r1, r2 = self.rng.random((2, 3, *self.points.shape))
        leaders = self.leaders[:, None, :]
        A = 2.0 * a * r1 - a
        distance = np.abs(2.0 * r2 * leaders - self.points)
        return self.box.clip((leaders - A * distance).sum(axis=0) / 3.0)
