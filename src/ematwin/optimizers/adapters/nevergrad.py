"""Optimisers of nevergrad, with their defaults, through its ask and tell.

nevergrad asks for one point at a time; a batch is as many as the population, which is also what
nevergrad is told as its number of workers. Its "NGOpt" is left out: release 1.0.12 fails with
numpy 2.4 inside its surrogate model.
"""

from typing import Any

import numpy as np

from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer


class Nevergrad(PopulationOptimizer):
    """An optimiser of nevergrad, by its ``name`` in nevergrad's registry."""

    def __init__(self, box: Box, *, name: str = "TwoPointsDE", **settings: int) -> None:
        import nevergrad

        super().__init__(box, **settings)
        self.name = name
        # The unit cube: nevergrad then draws first points over all of it, whatever the box.
        space = nevergrad.p.Array(shape=(box.dimension,), lower=0.0, upper=1.0)
        space.random_state = np.random.RandomState(self.seed % 2**32)
        self._optimizer = nevergrad.optimizers.registry[name](
            parametrization=space,
            budget=self.population * self.iterations,
            num_workers=self.population,
        )
        self._candidates: list[Any] = []

    def _start(self) -> FloatArray:
        self._candidates = [self._optimizer.ask() for _ in range(self.population)]
        unit = np.array([candidate.value for candidate in self._candidates], dtype=np.float64)
        return self.box.clip(self.box.lower + unit * self.box.span)

    _move = _start

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        for candidate, cost in zip(self._candidates, costs.tolist(), strict=True):
            # nevergrad replaces costs above 5e20, with a warning for each
            self._optimizer.tell(candidate, min(cost, 1e20))
        self._candidates = []
