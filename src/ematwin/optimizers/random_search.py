"""Random search: points drawn uniformly in the box, the least that a method must beat.

Brooks (1958), A Discussion of Random Methods for Seeking Maxima, Oper. Res. 6, 244-251.
Departure: none.
"""

from __future__ import annotations

import numpy as np

from ematwin.optimizers.base import FloatArray, PopulationOptimizer


class RandomSearch(PopulationOptimizer):
    """Uniform random points; it learns nothing."""

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        """Do nothing: the next batch depends on no cost."""

    def limits(self) -> FloatArray:
        """No cost counts; the loop itself keeps the best."""
        return np.full(self.population, -np.inf)

    def _move(self) -> FloatArray:
        return self._start()
