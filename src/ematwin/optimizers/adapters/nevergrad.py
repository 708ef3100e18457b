"""Optimisers of nevergrad, with their own defaults, through its own ask and tell.

nevergrad asks for one point at a time; a batch is as many as the population, which is also what
nevergrad is told as its number of workers. Its "NGOpt" is left out: release 1.0.12 fails with
numpy 2.4 inside its surrogate model.
"""

from __future__ import annotations

from functools import partial
from typing import Any

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

_WORST = 1e20  # nevergrad replaces costs above 5e20, with a warning for each


class Nevergrad(Optimizer):
    """An optimiser of nevergrad.

    Parameters
    ----------
    box : Box
    population, iterations, seed : int
    name : str, as in nevergrad's registry
    """

    def __init__(
        self,
        box: Box,
        *,
        population: int = 50,
        iterations: int = 200,
        seed: int = 1,
        name: str = "TwoPointsDE",
    ) -> None:
        import nevergrad

        self.box = box
        self.population = whole_number(population, "population", self.minimum_population)
        self.iterations = whole_number(iterations, "number of iterations", 1)
        self.seed = whole_number(seed, "seed", 0)
        self.name = name
        # The unit cube: nevergrad then draws first points over all of it, whatever the box.
        space = nevergrad.p.Array(shape=(box.dimension,), lower=0.0, upper=1.0)
        space.random_state = np.random.RandomState(self.seed % 2**32)
        self._optimizer = nevergrad.optimizers.registry[name](
            parametrization=space,
            budget=self.population * self.iterations,
            num_workers=self.population,
        )
        self._pending: FloatArray | None = None
        self._candidates: list[Any] = []

    def ask(self) -> FloatArray:
        """Give as many of nevergrad's points as the population."""
        if self._pending is None:
            self._candidates = [self._optimizer.ask() for _ in range(self.population)]
            values = [candidate.value for candidate in self._candidates]
            unit = np.array(values, dtype=np.float64)
            self._pending = self.box.clip(self.box.lower + unit * self.box.span)
        return self._pending.copy()

    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Hand the costs to nevergrad."""
        if self._pending is None:
            raise InputError("tell() without a batch to answer: call ask() first.")
        values = np.minimum(checked_costs(self._pending, points, costs), _WORST)
        for candidate, value in zip(self._candidates, values.tolist(), strict=True):
            self._optimizer.tell(candidate, value)
        self._pending, self._candidates = None, []


def _load(name: str) -> OptimizerFactory:
    return partial(Nevergrad, name=name)


def _algorithm(name: str, registered: str, title: str) -> Algorithm:
    return Algorithm(
        f"nevergrad-{name}",
        f"{title} of nevergrad",
        f"nevergrad.optimizers.registry[{registered!r}]",
        "nevergrad",
        partial(_load, registered),
        requires="nevergrad",
        departures="none",
        tuned_on="nothing here: the library's own settings",
    )


ALGORITHMS = (
    _algorithm("de", "TwoPointsDE", "Differential evolution"),
    _algorithm("pso", "PSO", "Particle swarm"),
    _algorithm("oneplusone", "OnePlusOne", "(1+1) evolution strategy"),
)
