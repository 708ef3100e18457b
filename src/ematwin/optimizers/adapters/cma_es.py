"""CMA-ES of the package ``cma``, with the package's defaults, through its ask and tell.

The first mean is drawn uniformly in the box and the first step is 0.3 of the box in every variable.
Where the package declares itself converged it starts afresh from another mean, so that the budget
is spent.
"""

import warnings

import numpy as np

from ematwin.optimizers.base import FloatArray, PopulationOptimizer


class CmaEs(PopulationOptimizer):
    """CMA-ES of the package ``cma``; the population is its popsize."""

    minimum_population = 4

    def _start(self) -> FloatArray:
        import cma

        options = {
            "bounds": [self.box.lower.tolist(), self.box.upper.tolist()],
            "CMA_stds": self.box.span.tolist(),
            "popsize": self.population,
            "seed": np.nan,
            "randn": self._normal,
            "verbose": -9,
        }
        first = self.box.sample(self.rng, 1)[0]
        self._strategy = cma.CMAEvolutionStrategy(first, 0.3, options)
        return self._sampled()

    def _move(self) -> FloatArray:
        return self._start() if self._strategy.stop() else self._sampled()

    def _normal(self, *shape: int) -> FloatArray:
        """Standard normal numbers; the package would draw them from numpy's global generator."""
        return self.rng.standard_normal(shape)

    def _sampled(self) -> FloatArray:
        # the package warns shortly before it converges
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            self._solutions = self._strategy.ask()
        return self.box.clip(np.array(self._solutions, dtype=np.float64))

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            # cma takes differences of costs
            self._strategy.tell(self._solutions, np.minimum(costs, 1e300).tolist())
