"""Algorithms of pymoo, with their defaults, through its ask and tell.

pymoo drops duplicates, so that a batch can be smaller than the population. Its genetic algorithm
holds local functions that cannot be pickled, so none of them is said to be.
"""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ematwin.optimizers.adapters import adapted
from ematwin.optimizers.base import Algorithm, Box, FloatArray, PopulationOptimizer

_MODULE = "pymoo.algorithms.soo.nonconvex"


class Pymoo(PopulationOptimizer):
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

    def __init__(self, box: Box, *, name: str = "GA", **settings: int) -> None:
        super().__init__(box, **settings)
        self.name = name
        self._starts = 0
        self._infills: Any = None

    def _start(self) -> FloatArray:
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
        return self._move()

    def _move(self) -> FloatArray:
        self._infills = self._algorithm.ask()
        if self._infills is None or len(self._infills) == 0:  # it has no new point left
            return self._start()
        points = np.asarray(self._infills.get("X"), dtype=np.float64)
        return self.box.clip(points.reshape(len(self._infills), -1))

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        finite = np.minimum(costs, 1e300)[:, None]  # pymoo takes differences of costs
        Evaluator().eval(StaticProblem(self._algorithm.problem, F=finite), self._infills)
        self._algorithm.tell(infills=self._infills)


def _algorithm(name: str, title: str) -> Algorithm:
    return adapted(
        f"pymoo-{name.lower()}",
        f"{title} of pymoo",
        f"{_MODULE}.{name.lower()}.{name}",
        "pymoo",
        lambda: partial(Pymoo, name=name),
        "restarts where it has no new point left",
    )


ALGORITHMS = (
    _algorithm("GA", "Genetic algorithm"),
    _algorithm("DE", "Differential evolution"),
    _algorithm("PSO", "Particle swarm"),
)
