"""Algorithms of pygmo, with their own defaults.

Most of pygmo's algorithms evaluate one point at a time, so a batch is one point, whose simulation
takes 13 times as long as in a batch of fifty; its generational swarm takes whole generations
(`pygmo.bfe`), and so does its adapter. Where an algorithm ends of itself (its tolerances are set to
zero where it has any) it goes on from its population, and from a new one when it finds nothing left
to do.
"""

from typing import Any, Self

import numpy as np

from ematwin.optimizers.adapters.worker import Evaluate, ThreadedOptimizer
from ematwin.optimizers.base import Box, FloatArray

_WORST = 1e300  # pygmo's arithmetic on costs must stay finite


class _Problem:
    """A user-defined problem of pygmo; pygmo copies it, the copies share the channel."""

    def __init__(self, box: Box, evaluate: Evaluate) -> None:
        self._box = box
        self._evaluate = evaluate

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def fitness(self, x: FloatArray) -> list[float]:
        return [min(float(self._evaluate(np.asarray(x)[None, :])[0]), _WORST)]

    def batch_fitness(self, points: FloatArray) -> FloatArray:
        rows = np.asarray(points).reshape(-1, self._box.dimension)
        return np.minimum(self._evaluate(rows), _WORST)

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return self._box.lower.tolist(), self._box.upper.tolist()


class Pygmo(ThreadedOptimizer):
    """An algorithm of pygmo, named as in pygmo; ``batched`` if it takes whole generations."""

    minimum_population = 7

    def __init__(
        self, box: Box, *, name: str = "de", batched: bool = False,
        options: dict[str, Any] | None = None, **settings: int,
    ) -> None:  # fmt: skip
        super().__init__(box, **settings)
        self.name = name
        self.batched = batched
        self.options = options or {}

    def _search(self, evaluate: Evaluate) -> None:
        import pygmo

        problem = pygmo.problem(_Problem(self.box, evaluate))
        make = getattr(pygmo, self.name)
        seed = self.seed % 2**31
        while True:
            together = pygmo.bfe(pygmo.member_bfe()) if self.batched else None
            population = pygmo.population(problem, self.population, b=together, seed=seed)
            generations = max(3, self.iterations - 1)
            chosen = make(gen=generations, seed=seed, **self.options)
            if together is not None:
                chosen.set_bfe(together)
            algorithm = pygmo.algorithm(chosen)
            spent = -1
            while population.problem.get_fevals() != spent:
                spent = population.problem.get_fevals()
                population = algorithm.evolve(population)
            seed = (seed + 1) % 2**31
