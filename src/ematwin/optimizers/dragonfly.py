"""Dragonfly algorithm.

Mirjalili (2016), Dragonfly algorithm: a new meta-heuristic optimization technique, Neural Comput.
Appl. 27, 1053-1073, equations (3.1) to (3.10), and the author's program, "DA source codes version
1.0". With n neighbours X_j, steps V_j, food (best point seen) and enemy (worst point seen):

    S = -sum (X_j - X),  A = mean V_j,  C = mean X_j - X,  F = food - X,  E = enemy + X
    V <- s S + a A + c C + f F + e E + w V,   X <- X + V           (food within the radius)
    V <- w V + r1 A + r2 C + r3 S,            X <- X + V           (food farther, n > 1)
    X <- X + Levy X,  V <- 0                                       (food farther, n <= 1)

Departure: none from the program, whose behaviour the paper's text does not tell in full:

- distances are by component: a neighbour is within the radius in every variable, and differs in
  every variable (so two dragonflies on the same bound are no neighbours);
- the radius grows from a quarter of the box to 2.25 times it; w falls from 0.9 to 0.4;
- F or E is zero where food or enemy is outside the radius; steps are limited to a tenth of the box;
- s, a, c, f are drawn once an iteration; r1, r2, r3 for every dragonfly and variable;
- one neighbour alone counts as none: then S = C = 0 and A = V;
- the first steps are drawn like positions, from the box itself and not around zero;
- only a point strictly inside the box becomes the enemy; food and enemy not yet found stand at the
  coordinates' zero; positions are clipped right after the move;
- dragonflies move one after another, each seeing where those before it have gone already.

The last point is why a compiled loop moves them (`flight`): moved all at once, a shifted sphere
(8 variables, 50 x 200) ends seven times higher (median of 300 runs). ``inertia``, ``fading`` and
``step_limit`` other than the defaults are departures of one's own.
"""

import math

import numpy as np

from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer, positive

_BETA = 1.5
_SIGMA = (
    math.gamma(1 + _BETA)
    * math.sin(math.pi * _BETA / 2)
    / (math.gamma((1 + _BETA) / 2) * _BETA * 2 ** ((_BETA - 1) / 2))
) ** (1 / _BETA)


class Dragonfly(PopulationOptimizer):
    """Dragonfly algorithm.

    Parameters
    ----------
    inertia : (first, last) factor w of the old step; 0.9 to 0.4 in the program
    fading : float, share of the iterations after which neighbours and enemy count no more; 0.5
    step_limit : float, spans of the box in one iteration; 0.1
    """

    def __init__(
        self,
        box: Box,
        *,
        inertia: tuple[float, float] = (0.9, 0.4),
        fading: float = 0.5,
        step_limit: float = 0.1,
        **settings: int,
    ) -> None:
        super().__init__(box, **settings)
        self.inertia = inertia
        self.fading = positive(fading, "share of the iterations in which neighbours count")
        self.step_limit = positive(step_limit, "step limit")
        self.food = np.zeros(box.dimension)
        self.food_cost = np.inf
        self.enemy = np.zeros(box.dimension)
        self.enemy_cost = -np.inf
        self._steps = np.empty((0, box.dimension))

    def _start(self) -> FloatArray:
        flies = self.box.sample(self.rng, self.population)
        self._steps = self.box.sample(self.rng, self.population)
        return flies

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        best = int(np.argmin(costs))
        if costs[best] < self.food_cost:
            self.food_cost = float(costs[best])
            self.food = points[best].copy()
        inside = np.all((points > self.box.lower) & (points < self.box.upper), axis=1)
        offered = np.where(inside, costs, -np.inf)
        worst = int(np.argmax(offered))
        if offered[worst] > self.enemy_cost:
            self.enemy_cost = float(offered[worst])
            self.enemy = points[worst].copy()

    def _move(self) -> FloatArray:
        span = self.box.span
        step = min(self.iteration, self.iterations)  # counted from one, as in the program
        radius = span / 4 + span * (step / self.iterations) * 2
        first, last = self.inertia
        w = first - step * ((first - last) / self.iterations)
        fading = max(0.0, 0.1 - step * (0.1 / (self.iterations * self.fading)))
        s, a, c = 2 * self.rng.random(3) * fading
        f = 2 * self.rng.random()
        e = fading

        X, V = self.points, self._steps
        reaches_food = np.all(np.abs(X - self.food) <= radius, axis=1)
        meets_enemy = np.all(np.abs(X - self.enemy) <= radius, axis=1)
        drift = w * V + reaches_food[:, None] * (f * (self.food - X))
        drift += (reaches_food & meets_enemy)[:, None] * (e * (self.enemy + X))
        from ematwin.optimizers.flight import fly  # compiled: loads numba

        far = ~reaches_food
        weights = np.empty((3, *X.shape))
        weights[:] = np.array([s, a, c])[:, None, None]
        weights[:, far] = self.rng.random((3, int(far.sum()), X.shape[1]))
        levy = self._levy() if far.any() else np.zeros(X.shape)
        flies, steps, sums = X.copy(), V.copy(), np.empty((2, X.shape[1]))
        lower, upper, limit = self.box.lower, self.box.upper, span * self.step_limit
        fly(flies, steps, drift, weights, reaches_food, levy, radius, lower, upper, limit, sums)
        self._steps = steps
        return flies

    def _levy(self) -> FloatArray:
        """(N, d) Levy flights, equations (3.9) and (3.10)."""
        u, v = self.rng.standard_normal((2, self.population, self.box.dimension))
        return 0.01 * _SIGMA * u / np.abs(v) ** (1 / _BETA)
