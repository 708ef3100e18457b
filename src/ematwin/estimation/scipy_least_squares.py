"""SciPy's trust-region least squares from many starts, to compare the default method with.

Branch, Coleman and Li (1999), SIAM J. Sci. Comput. 21, 1-23, as `scipy.optimize.least_squares` has
it ("trf", SciPy's own tolerances). Starts are uniform in the unknowns' ranges; from each one it
descends until SciPy stops or 50 Jacobians are spent, and then from the next, until the budget is
spent. A Jacobian is one batch of forward differences of the length that the default method takes.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.estimation.levenberg_marquardt import LONGEST_DIFFERENCE
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Report

_JACOBIANS = 50  # of one descent


class _BudgetSpentError(Exception):
    """The next batch would exceed the budget; caught within this module."""


class _Slopes:
    """Residuals (K,) and Jacobian (K, d) at a point of the chart, both from one batch."""

    def __init__(self, problem: Problem, limit: int, report: Report) -> None:
        self._problem, self._limit, self._report = problem, limit, report
        self._at = np.full(len(problem.names), np.nan)
        self.spent = 0
        self.cost = np.inf
        self.best = np.full(len(problem.names), np.nan)
        self.history: list[tuple[int, float]] = []

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(K,)."""
        self._go(z)
        return self._residuals

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """(K, d)."""
        self._go(z)
        return self._jacobian

    def _go(self, z: np.ndarray) -> None:
        if np.array_equal(z, self._at):
            return
        chart = self._problem.chart
        if self.spent + len(z) + 1 > self._limit:
            raise _BudgetSpentError
        # away from the nearer bound
        step = np.where(
            z > 0.5 * (chart.lower + chart.upper), -LONGEST_DIFFERENCE, LONGEST_DIFFERENCE
        )
        found = self._problem.residuals(
            chart.to_values(np.concatenate([z[None], z + np.diag(step)]))
        )
        # a twin that diverged is far from the recording in every sample
        found = np.where(np.isfinite(found), found, 1e6)
        self._residuals, self._jacobian = found[0], ((found[1:] - found[0]) / step[:, None]).T
        self._at = z.copy()
        self.spent += len(z) + 1
        cost = float(found[0] @ found[0])
        if cost < self.cost:
            self.cost, self.best = cost, z.copy()
        self.history.append((self.spent, self.cost))
        self._report(self.spent, self.cost)


@dataclass(frozen=True)
class ScipyLeastSquares:
    """`scipy.optimize.least_squares` from many starts, as a search that can be passed."""

    name: str = "scipy-trf"

    @property
    def planned(self) -> int:
        """The budget of the population methods."""
        return 10_000

    @property
    def smallest_budget(self) -> int:
        """One Jacobian of up to 31 unknowns."""
        return 32

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Descend from start after start; after an interruption with the best until then.

        Raises
        ------
        InputError
            If the budget does not pay for one Jacobian.
        RecordError
            If the twin diverged everywhere.
        """
        from scipy.optimize import least_squares

        limit = self.planned if budget is None else budget
        if limit <= len(problem.names):
            raise InputError(
                f"{self.name} needs a budget of at least {len(problem.names) + 1} evaluations, "
                f"received {limit}."
            )
        rng, chart = np.random.default_rng(seed), problem.chart
        slopes = _Slopes(problem, limit, report)
        stopped = "budget"
        try:
            while True:
                start = chart.from_values(chart.from_unit(rng.random((1, len(problem.names)))))[0]
                least_squares(
                    slopes.residuals,
                    start,
                    slopes.jacobian,
                    (chart.lower, chart.upper),
                    max_nfev=_JACOBIANS,
                )
        except _BudgetSpentError:
            pass
        except KeyboardInterrupt:
            if not slopes.history:
                raise
            stopped = "interrupted"
        if not np.isfinite(slopes.cost) or slopes.cost >= 1e12:
            raise RecordError(
                f"The twin diverged for each of {slopes.spent} candidates. Check the parameters of "
                "the actuator."
            )
        return Found(
            chart.to_values(slopes.best[None])[0], slopes.cost, slopes.spent,
            np.array(slopes.history, dtype=float), stopped, self.name, seed,
        )  # fmt: skip
