"""Algorithms of pymoo, with their defaults, through its ask and tell.

pymoo drops duplicates, so that a batch can be smaller than the population. Its genetic algorithm
holds local functions that cannot be pickled, so none of them is said to be.
"""

import importlib
from typing import Any

import numpy as np

from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer

MODULE = "pymoo.algorithms.soo.nonconvex"


class Pymoo(PopulationOptimizer):
    """An algorithm of pymoo, by the ``name`` of its class; its module has that in lower case."""

    picklable = False
    constant_batch = False
    minimum_population = 5

    def __init__(self, box: Box, *, name: str = "GA", **settings: int) -> None:
        super().__init__(box, **settings)
        self.name = name
        self._starts = 0
        self._infills: Any = None

    def _start(self) -> FloatArray:
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        make = getattr(importlib.import_module(f"{MODULE}.{self.name.lower()}"), self.name)
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
