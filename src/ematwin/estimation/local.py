"""Local descent: Levenberg-Marquardt from where the kind of actuator suggests.

For problems with one minimum, where samples all over the box would add nothing. Every start is
refined to convergence; the best end is the answer.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Report

ITERATIONS = 12
_DAMPING = 1e-3


class _BudgetSpentError(Exception):
    """The next iteration would exceed the budget; caught within this module."""


@dataclass(frozen=True)
class LocalDescent:
    """Levenberg-Marquardt, as a search that can be passed.

    Parameters
    ----------
    starts : (M, d) array of points, or None for the starts of the problem
    iterations : int
    """

    starts: np.ndarray | None = None
    iterations: int = ITERATIONS
    name: str = "levenberg-marquardt"
    smallest_budget: int = 1

    @property
    def planned(self) -> int:
        """An upper limit."""
        return 10_000

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Descend; after an interruption with the best found until then."""
        if budget is not None and budget < 1:
            raise InputError(f"The budget must be at least 1 evaluation, received {budget}.")
        limit = self.planned if budget is None else budget
        starts = problem.starts if self.starts is None else np.atleast_2d(self.starts)
        chart = problem.chart
        spent = 0

        def residuals(z: np.ndarray) -> np.ndarray:
            nonlocal spent
            if spent + len(z) > limit:
                raise _BudgetSpentError
            spent += len(z)
            return problem.residuals(chart.to_values(z))

        stopped = "converged"
        points = chart.project(chart.from_values(starts[:limit]))
        descent = LevenbergMarquardt.start(points, residuals, damping=_DAMPING)
        history = [(spent, float(descent.costs.min()))]
        try:
            for _ in range(self.iterations):
                descent.iterate(residuals, chart.lower, chart.upper, chart.project)
                history.append((spent, float(descent.costs.min())))
                report(*history[-1])
        except _BudgetSpentError:
            stopped = "budget"
        except KeyboardInterrupt:
            stopped = "interrupted"
        end = descent.best(1)
        cost = float(end.costs[0])
        if not np.isfinite(cost):
            raise RecordError(
                f"The twin diverged for each of {spent} candidates. Check the parameters of the "
                "actuator."
            )
        return Found(
            chart.to_values(end.points)[0], cost, spent, np.array(history, dtype=float), stopped,
            self.name, seed,
        )  # fmt: skip
