"""Differential evolution of SciPy: ``scipy.optimize.differential_evolution``.

SciPy's own defaults (best/1/bin, F drawn from 0.5 to 1, CR 0.7) except: the population is the one
asked for, drawn uniformly; its test of convergence and its final polishing are off, so that the
budget is spent; a population that has shrunk to one cost starts afresh. SciPy draws the bounds'
offenders anew.
"""

from __future__ import annotations

import numpy as np

from ematwin.optimizers.adapters.worker import Evaluate, ThreadedOptimizer
from ematwin.optimizers.base import FloatArray


class ScipyDifferentialEvolution(ThreadedOptimizer):
    """``scipy.optimize.differential_evolution``, whole generations at a time."""

    minimum_population = 5

    def _search(self, evaluate: Evaluate) -> None:
        from scipy.optimize import differential_evolution

        rng = np.random.default_rng(self.seed)

        def columns(points: FloatArray) -> FloatArray:
            return evaluate(points.T)

        while True:
            differential_evolution(
                columns,
                np.column_stack([self.box.lower, self.box.upper]),
                init=self.box.sample(rng, self.population),
                maxiter=10**9,
                tol=0.0,
                polish=False,
                vectorized=True,
                updating="deferred",
                rng=rng,
            )
