"""Local descents: Levenberg-Marquardt from known starts, and SciPy's method from random ones."""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.levenberg_marquardt import LONGEST_DIFFERENCE, LevenbergMarquardt
from ematwin.estimation.multistart import DEFAULT_BUDGET
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Report, Tally, by_slopes

ITERATIONS = 12


@dataclass(frozen=True)
class LocalDescent:
    """Levenberg-Marquardt from where the kind of actuator suggests.

    For problems with one minimum, where samples all over the box would add nothing. Every start is
    refined to convergence; the best end is the answer.

    Parameters
    ----------
    starts : (M, d) array of points, or None for the starts of the problem
    iterations : int
    """

    starts: np.ndarray | None = None
    iterations: int = ITERATIONS
    name: str = "levenberg-marquardt"
    smallest_budget: int = 1
    planned: int = DEFAULT_BUDGET

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Descend; after an interruption with the best found until then."""
        tally = Tally(problem, self.planned if budget is None else budget, report)
        chart = problem.chart

        def work() -> None:
            starts = problem.starts if self.starts is None else np.atleast_2d(self.starts)
            points = chart.project(chart.from_values(starts[: tally.budget]))
            descent = LevenbergMarquardt.start(points, tally.residuals, damping=1e-3)
            for iteration in range(self.iterations + 1):
                if iteration:
                    descent.iterate(tally.residuals, chart.lower, chart.upper, chart.project)
                end = descent.best(1)
                tally.offer(end.points[0], float(end.costs[0]), told=iteration > 0)
            tally.stopped = "converged"

        return by_slopes(self.name, tally, seed, work)


@dataclass(frozen=True)
class ScipyLeastSquares:
    """`scipy.optimize.least_squares` from random starts, to compare the default method with.

    Branch, Coleman and Li (1999), SIAM J. Sci. Comput. 21, 1-23 ("trf", SciPy's own tolerances).
    From each start, uniform in the ranges of the unknowns, it descends until SciPy stops or 50
    Jacobians are spent, until the budget is spent. A Jacobian is one batch of forward differences
    of the length that the default method takes.
    """

    name: str = "scipy-trf"
    smallest_budget: int = 32  # one Jacobian of up to 31 unknowns
    planned: int = DEFAULT_BUDGET

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Descend from start after start; after an interruption with the best until then.

        Raises
        ------
        InputError
            If the budget does not pay for one Jacobian.
        """
        from scipy.optimize import least_squares

        tally = Tally(problem, self.planned if budget is None else budget, report)
        size, chart = len(problem.names), problem.chart
        if tally.budget <= size:
            raise InputError(
                f"{self.name} needs a budget of at least {size + 1} evaluations, received "
                f"{tally.budget}."
            )
        middle = 0.5 * (chart.lower + chart.upper)
        known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

        def slopes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """A point (d,), its residuals (K,) and Jacobian (K, d), both from one batch."""
            nonlocal known
            if known is None or not np.array_equal(z, known[0]):
                # away from the nearer bound
                step = np.where(z > middle, -LONGEST_DIFFERENCE, LONGEST_DIFFERENCE)
                found = tally.residuals(np.concatenate([z[None], z + np.diag(step)]))
                cost = float(found[0] @ found[0])
                tally.offer(z, cost if np.isfinite(cost) else np.inf)
                # where the twin diverged it is far from the recording in every sample
                found = np.where(np.isfinite(found), found, 1e6)
                known = z.copy(), found[0], ((found[1:] - found[0]) / step[:, None]).T
            return known

        def work() -> None:
            rng = np.random.default_rng(seed)
            while True:
                least_squares(
                    lambda z: slopes(z)[1],
                    chart.from_values(chart.from_unit(rng.random((1, size))))[0],
                    lambda z: slopes(z)[2],
                    (chart.lower, chart.upper),
                    max_nfev=50,  # of one descent of SciPy
                )

        return by_slopes(self.name, tally, seed, work)
