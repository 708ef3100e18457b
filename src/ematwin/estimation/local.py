"""Local descents: Levenberg-Marquardt from known starts, and SciPy's method from random ones."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.levenberg_marquardt import LONGEST_DIFFERENCE, LevenbergMarquardt
from ematwin.estimation.search import SlopeSearch, Tally


@dataclass(frozen=True)
class LocalDescent(SlopeSearch):
    """Levenberg-Marquardt from where the kind of actuator suggests.

    For problems with one minimum, where samples all over the box would add nothing. Every start is
    refined to convergence; the best end is the answer.

    Parameters
    ----------
    starts : (M, d) array of points, or None for the starts of the problem
    iterations : int
    """

    starts: np.ndarray | None = None
    iterations: int = 12
    name: str = "levenberg-marquardt"

    def descend(self, tally: Tally, seed: int) -> None:
        """All starts side by side."""
        problem, chart = tally.problem, tally.problem.chart
        starts = problem.starts if self.starts is None else np.atleast_2d(self.starts)
        points = chart.project(chart.from_values(starts[: tally.budget]))
        descent = LevenbergMarquardt.start(points, tally.residuals, damping=1e-3)
        for iteration in range(self.iterations + 1):
            if iteration:
                descent.iterate(tally.residuals, chart.lower, chart.upper, chart.project)
            end = descent.best(1)
            tally.offer(end.points[0], float(end.costs[0]))
        tally.stopped = "converged"


class ScipyLeastSquares(SlopeSearch):
    """`scipy.optimize.least_squares` from random starts, to compare the default method with.

    Branch, Coleman and Li (1999), SIAM J. Sci. Comput. 21, 1-23 ("trf", SciPy's own tolerances).
    From each start, uniform in the ranges of the unknowns, it descends until SciPy stops or 50
    Jacobians are spent, until the budget is spent. A Jacobian is one batch of forward differences
    of the length that the default method takes.
    """

    name = "scipy-trf"
    smallest_budget = 32  # one Jacobian of up to 31 unknowns

    def descend(self, tally: Tally, seed: int) -> None:
        """From start after start; `InputError` if the budget does not pay for one Jacobian."""
        from scipy.optimize import least_squares

        size, chart = len(tally.problem.names), tally.problem.chart
        if tally.budget <= size:
            raise InputError(
                f"{self.name} needs a budget of at least {size + 1} evaluations, received "
                f"{tally.budget}."
            )
        middle = 0.5 * (chart.lower + chart.upper)

        @lru_cache(maxsize=1)  # SciPy asks for residuals and Jacobian of a point one by one
        def slopes(point: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
            """Residuals (K,) and Jacobian (K, d), both from one batch."""
            z = np.array(point)
            # away from the nearer bound
            step = np.where(z > middle, -LONGEST_DIFFERENCE, LONGEST_DIFFERENCE)
            found = tally.residuals(np.concatenate([z[None], z + np.diag(step)]))
            cost = float(found[0] @ found[0])
            tally.offer(z, cost if np.isfinite(cost) else np.inf)
            # where the twin diverged it is far from the recording in every sample
            found = np.where(np.isfinite(found), found, 1e6)
            return found[0], ((found[1:] - found[0]) / step[:, None]).T

        rng = np.random.default_rng(seed)
        while True:  # until the budget is spent
            least_squares(
                lambda z: slopes(tuple(z))[0],
                chart.from_values(chart.from_unit(rng.random((1, size))))[0],
                lambda z: slopes(tuple(z))[1],
                (chart.lower, chart.upper),
                max_nfev=50,  # of one descent of SciPy
            )
