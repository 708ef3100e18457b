"""Differential evolution, with the strategy as a value.

Storn and Price (1997), Differential Evolution - A Simple and Efficient Heuristic for Global
Optimization over Continuous Spaces, J. Global Optim. 11, 341-359; strategies by their names there.

    v = x_r1 + F (x_r2 - x_r3),   r1, r2, r3 different and none of them i          (rand/1)
    u_j = v_j where r_j <= CR or j = j_rand, else x_j                               (bin)
    x <- u where f(u) <= f(x)

The strategy is best/1 by default (the base vector is the best of all), F = 0.5, and each trial
takes CR = 0.1 or 0.9: the two values that the paper names as first choices, for functions whose
variables can be told apart and for those whose cannot.

Departure: the paper keeps one CR for a run; `Either` draws one of the two for each trial.
All trials of a generation are made from the generation before it (synchronous), as in the paper.

Departure: the paper has no bounds. A component that leaves the box comes back to a random place
between that bound and the base vector, as in the authors' later program (Price, Storn and Lampinen
2005, "bounce-back"), so that bounds attract no more than the costs there deserve.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer

Strategy = Callable[
    [np.random.Generator, FloatArray, int, FloatArray], tuple[FloatArray, FloatArray]
]
"""Mutants (N, d) and their base vectors of parents (N, d), the place of the best, and F (N, 1)."""


def others(rng: np.random.Generator, count: int, picks: int) -> np.ndarray:
    """(picks, N) indices: in each column different from each other and from the column's own.

    The r-th pick is drawn among those left and shifted past the ones taken, smallest first.
    """
    taken = np.arange(count)[None, :]
    for r in range(picks):
        pick = rng.integers(count - 1 - r, size=count)
        for low in np.sort(taken, axis=0):
            pick += pick >= low
        taken = np.vstack([taken, pick])
    return taken[1:]


def rand_1(
    rng: np.random.Generator, parents: FloatArray, best: int, F: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """DE/rand/1: one difference added to a random vector."""
    r1, r2, r3 = others(rng, len(parents), 3)
    bases = parents[r1]
    return bases + F * (parents[r2] - parents[r3]), bases


def best_1(
    rng: np.random.Generator, parents: FloatArray, best: int, F: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """DE/best/1: one difference added to the best vector."""
    r1, r2 = others(rng, len(parents), 2)
    bases = np.broadcast_to(parents[best], parents.shape)
    return bases + F * (parents[r1] - parents[r2]), bases


def bounced_back(
    rng: np.random.Generator, box: Box, vectors: FloatArray, bases: FloatArray
) -> FloatArray:
    """(N, d) mutants; a component outside goes to a random place between bound and base vector."""
    bound = box.clip(vectors)
    back = bound + rng.random(bound.shape) * (bases - bound)
    return box.clip(np.where(bound == vectors, bound, back))


@dataclass(frozen=True)
class Dither:
    """A weight F drawn uniformly between two values.

    Storn's advice for functions that are not smooth: Das, Konar and Chakraborty (2005), GECCO,
    draw it for every vector.
    """

    low: float = 0.5
    high: float = 1.0


@dataclass(frozen=True)
class Either:
    """A crossover rate that is drawn for each trial: ``often``, or ``rarely`` with that share.

    With CR = 0.1 alone Rosenbrock's function is not solved, with 0.9 alone Rastrigin's minima are
    not left; the mixture does both (``docs/optimizers.md``).
    """

    often: float = 0.1
    rarely: float = 0.9
    share: float = 0.2


class DifferentialEvolution(PopulationOptimizer):
    """Differential evolution with binomial crossover.

    ``iterations`` changes nothing: the method has no schedule.

    Parameters
    ----------
    strategy : `best_1`, `rand_1`, or a function as these
    F : float or Dither, weight of the differences, in (0, 2]
    CR : float or Either, share of components taken from the mutant, in [0, 1]
    """

    minimum_population = 5  # four others are the most that a published strategy takes

    def __init__(
        self,
        box: Box,
        *,
        strategy: Strategy = best_1,
        F: float | Dither = 0.5,
        CR: float | Either = Either(),
        **settings: int,
    ) -> None:
        super().__init__(box, **settings)
        if not isinstance(F, Dither) and not 0.0 < F <= 2.0:
            raise InputError(f"F must lie in (0, 2], received {F}. The paper starts with 0.5.")
        rates = (CR.often, CR.rarely, CR.share) if isinstance(CR, Either) else (CR,)
        if not all(0.0 <= rate <= 1.0 for rate in rates):
            raise InputError(f"CR must lie in [0, 1], received {CR}.")
        self.strategy = strategy
        self.F = F
        self.CR = CR
        self.parents = np.empty((0, box.dimension))
        self.costs = np.full(self.population, np.inf)

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        if self.iteration == 0:
            self.parents, self.costs = points, costs
            return
        # A trial without a finite cost replaces nothing, not even a parent without one.
        accepted = (costs <= self.costs) & np.isfinite(costs)
        self.parents = np.where(accepted[:, None], points, self.parents)
        self.costs = np.where(accepted, costs, self.costs)

    def limits(self) -> FloatArray:
        """A trial that is worse than its parent is forgotten."""
        return self.costs.copy()

    def _move(self) -> FloatArray:
        rng, parents = self.rng, self.parents
        best = int(np.argmin(self.costs))
        vectors, bases = self.strategy(rng, parents, best, self._drawn(self.F))
        vectors = bounced_back(rng, self.box, vectors, bases)
        crossed = rng.random(parents.shape) <= self._drawn(self.CR)
        sure = rng.integers(parents.shape[1], size=len(parents))
        crossed[np.arange(len(parents)), sure] = True
        return np.where(crossed, vectors, parents)

    def _drawn(self, value: float | Dither | Either) -> FloatArray:
        """(N, 1) array, F or CR of each trial."""
        shape = (self.population, 1)
        if isinstance(value, Dither):
            return self.rng.uniform(value.low, value.high, size=shape)
        if isinstance(value, Either):
            return np.where(self.rng.random(shape) < value.share, value.rarely, value.often)
        return np.full(shape, value)
