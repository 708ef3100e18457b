"""Algorithms of pymoo, with their own defaults, through its own ask and tell.

pymoo drops duplicates, so that a batch can be smaller than the population. Its genetic algorithm
holds local functions that cannot be pickled, so none of them is said to be.
"""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any, ClassVar

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

_MODULE = "pymoo.algorithms.soo.nonconvex"
_WORST = 1e300  # pymoo takes differences of costs


class Pymoo(Optimizer):
    """An algorithm of pymoo.

    Parameters
    ----------
    box : Box
    population, iterations, seed : int
    name : str, of the class; its module has the same name in lower case
    """

    picklable: ClassVar[bool] = False
    constant_batch: ClassVar[bool] = False
    minimum_population: ClassVar[int] = 5

    def __init__(
        self,
        box: Box,
        *,
        population: int = 50,
        iterations: int = 200,
        seed: int = 1,
        name: str = "GA",
    ) -> None:
        self.box = box
        self.population = whole_number(population, "population", self.minimum_population)
        self.iterations = whole_number(iterations, "number of iterations", 1)
        self.seed = whole_number(seed, "seed", 0)
        self.name = name
        self._starts = 0
        self._pending: FloatArray | None = None
        self._infills: Any = None
        self._begin()

    def _begin(self) -> None:
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        make = getattr(importlib.import_module(f"{_MODULE}.{self.name.lower()}"), self.name)
        problem = Problem(
            n_var=self.box.dimension, n_obj=1, xl=self.box.lower.copy(), xu=self.box.upper.copy()
        )
        self._algorithm = make(pop_size=self.population)
        seed = int(np.random.SeedSequence([self.seed, self._starts]).generate_state(1)[0] >> 1)
        self._algorithm.setup(problem, termination=NoTermination(), seed=seed, verbose=False)
        self._starts += 1

    def ask(self) -> FloatArray:
        """Give pymoo's next batch; where it has no new point left, that of a new start."""
        if self._pending is None:
            self._infills = self._algorithm.ask()
            if self._infills is None or len(self._infills) == 0:
                self._begin()
                self._infills = self._algorithm.ask()
            points = np.asarray(self._infills.get("X"), dtype=np.float64)
            self._pending = self.box.clip(points.reshape(len(self._infills), -1))
        return self._pending.copy()

    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Hand the costs to pymoo."""
        if self._pending is None:
            raise InputError("tell() without a batch to answer: call ask() first.")
        values = np.minimum(checked_costs(self._pending, points, costs), _WORST)

        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        Evaluator().eval(StaticProblem(self._algorithm.problem, F=values[:, None]), self._infills)
        self._algorithm.tell(infills=self._infills)
        self._pending = self._infills = None


def _load(name: str) -> OptimizerFactory:
    return partial(Pymoo, name=name)


def _algorithm(name: str, title: str) -> Algorithm:
    return Algorithm(
        f"pymoo-{name.lower()}",
        f"{title} of pymoo",
        f"{_MODULE}.{name.lower()}.{name}",
        "pymoo",
        partial(_load, name),
        requires="pymoo",
        departures="restarts where it has no new point left",
        tuned_on="nothing here: the library's own settings",
    )


ALGORITHMS = (
    _algorithm("GA", "Genetic algorithm"),
    _algorithm("DE", "Differential evolution"),
    _algorithm("PSO", "Particle swarm"),
)
