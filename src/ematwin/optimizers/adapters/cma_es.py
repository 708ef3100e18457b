"""CMA-ES of the package ``cma``, with its own defaults, through its own ask and tell.

The first mean is drawn uniformly in the box and the first step is 0.3 of the box in every variable.
Where the package declares itself converged it starts afresh from another mean, so that the budget
is spent.
"""

from __future__ import annotations

import warnings
from typing import ClassVar

import numpy as np

from ematwin.errors import InputError
from ematwin.optimizers.base import (
    Box,
    FloatArray,
    Optimizer,
    OptimizerFactory,
    checked_costs,
    whole_number,
)
from ematwin.optimizers.catalogue import Algorithm

_STEP = 0.3
_WORST = 1e300  # cma takes differences of costs


def _quiet() -> warnings.catch_warnings:
    """Hold back the package's remarks on its own numerics shortly before it converges."""
    return warnings.catch_warnings(action="ignore", category=UserWarning)


class _Normal:
    """Standard normal numbers from our generator: the package would use numpy's global one."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def __call__(self, *shape: int) -> FloatArray:
        return self._rng.standard_normal(shape)


class CmaEs(Optimizer):
    """CMA-ES of the package ``cma``; the population is its popsize.

    Parameters
    ----------
    box : Box
    population, iterations, seed : int
    """

    minimum_population: ClassVar[int] = 4

    def __init__(
        self, box: Box, *, population: int = 50, iterations: int = 200, seed: int = 1
    ) -> None:
        self.box = box
        self.population = whole_number(population, "population", self.minimum_population)
        self.iterations = whole_number(iterations, "number of iterations", 1)
        self.seed = whole_number(seed, "seed", 0)
        self._rng = np.random.default_rng(self.seed)
        self._pending: FloatArray | None = None
        self._begin()

    def _begin(self) -> None:
        import cma

        options = {
            "bounds": [self.box.lower.tolist(), self.box.upper.tolist()],
            "CMA_stds": self.box.span.tolist(),
            "popsize": self.population,
            "seed": np.nan,
            "randn": _Normal(self._rng),
            "verbose": -9,
        }
        first = self.box.sample(self._rng, 1)[0]
        self._strategy = cma.CMAEvolutionStrategy(first, _STEP, options)

    def ask(self) -> FloatArray:
        """Give the strategy's next sample."""
        if self._pending is None:
            if self._strategy.stop():
                self._begin()
            with _quiet():
                self._solutions = self._strategy.ask()
            self._pending = self.box.clip(np.array(self._solutions, dtype=np.float64))
        return self._pending.copy()

    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Hand the costs to the strategy."""
        if self._pending is None:
            raise InputError("tell() without a batch to answer: call ask() first.")
        values = np.minimum(checked_costs(self._pending, points, costs), _WORST)
        with _quiet():
            self._strategy.tell(self._solutions, values.tolist())
        self._pending = None


def _load() -> OptimizerFactory:
    return CmaEs


ALGORITHMS = (
    Algorithm(
        "cma",
        "CMA-ES of the package cma",
        "Hansen and Ostermeier (2001), Evol. Comput. 9(2), 159-195; pycma",
        "cma",
        _load,
        requires="cma",
        departures="first mean and step as this package draws them; restarts",
        tuned_on="nothing here: the library's own settings",
        aliases=("cma-es", "cmaes"),
    ),
)
