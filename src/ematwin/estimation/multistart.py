"""The default method: Sobol sampling, then Levenberg-Marquardt descents thinned out on the way.

Coarse to fine. A problem may have a smoothed version, whose misfit has wide basins: sampling and
the first descents use that. Where the misfit has separate minima along an unknown
(`Unknown.valleys`), descents start from the best samples of each range of it; directions are
sampled all round. Every second iteration or so the worse half is dropped. The survivors go on with
the full bandwidth.

Where the fit is poor, the twin may have stalled where the actuator still moved, and the misfit of
the whole record leads nowhere. If its states were recorded, the same search is then made by
multiple shooting (`Problem.restarted`). An end that explains the stretches far better than the
first one did is the answer; any other goes on with the whole record. Where that does not settle it,
all is done again from new samples, until two ends agree, or fit alike and poorly, or no more is
gained, or the budget is spent.

Sobol (1967), scrambled (`ematwin.numerics.sobol`); successive halving as in Jamieson and
Talwalkar (2016).
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import AS_GOOD, EXPLAINED
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import BudgetSpentError, SlopeSearch, Tally
from ematwin.numerics.sobol import Sobol

THINNING = ((10, 2), (5, 2), (3, 3))  # descents and their iterations, smooth misfit
POLISH = ((2, 4), (1, 12))  # the same with the full bandwidth
CLEARLY_BETTER = 3.0  # ratio of misfits by stretches; 3.6 to 160 where a search was misled
SMALLEST_BUDGET = 64
HOPEFUL = 2.0  # times a good fit by stretches, beyond which no other search by them finds one

End = tuple[float, np.ndarray]  # cost and point of a finished descent


def good_fit(problem: Problem) -> float:
    """The relative misfit below which a fit needs no second opinion."""
    return max(EXPLAINED, AS_GOOD * problem.expected_misfit)


class Multistart(SlopeSearch):
    """The default method, as a search that can be passed."""

    name = "multistart"
    smallest_budget = SMALLEST_BUDGET

    def descend(self, tally: Tally, seed: int) -> None:
        """See `MultistartDescent`."""
        MultistartDescent(tally, seed).run()


class MultistartDescent:
    """Search for the point that explains the recordings of a problem best.

    The tally is valid at any time, also after an interruption. Beyond a relative misfit ``worth``
    another search is not worth it.
    """

    def __init__(self, state: Tally, seed: int = 1, worth: float = np.inf) -> None:
        if state.budget < SMALLEST_BUDGET:
            raise InputError(
                f"The default method needs a budget of at least {SMALLEST_BUDGET} evaluations, "
                f"received {state.budget}. Raise it, or choose another algorithm."
            )
        self.state, self._problem, self._worth = state, state.problem, worth
        self._smooth = state.problem.smoothed()
        self._chart = state.problem.chart
        self._rng = np.random.default_rng(seed)
        self._in_vain = 0  # searches since the best end

    def run(self) -> None:
        """Search until the fit is good or two ends agree; `BudgetSpentError` beyond the budget."""
        sobol = Sobol(len(self._problem.names), rng=self._rng)
        ends: list[End] = []
        while not self._settled(ends):
            if len(ends) == 1 and self._search_restarted(ends):
                continue
            best = min((cost for cost, _ in ends), default=np.inf)
            ends.append(self._one_search(sobol))
            self._in_vain = self._in_vain + 1 if ends[-1][0] >= best else 0

    def searches(self, most: int) -> Iterator[End]:
        """Whole searches one after another, each from new samples, while the budget lasts."""
        sobol = Sobol(len(self._problem.names), rng=self._rng)
        with suppress(BudgetSpentError):
            for _ in range(most):
                yield self._one_search(sobol)

    def _settled(self, ends: list[End]) -> bool:
        """Whether the search may end, and why."""
        ends.sort(key=lambda end: end[0])
        if self.state.restarted is not None:
            self.state.stopped = "good fit of stretches"
        elif ends and self._problem.relative_misfit(ends[0][0]) < good_fit(self._problem):
            self.state.stopped = "good fit"
        elif len(ends) > 1 and np.abs(ends[0][1] - ends[1][1]).max() < 0.02:  # in any coordinate
            self.state.stopped = "two searches agree"
        elif len(ends) > 1 and ends[1][0] < 1.02 * ends[0][0]:  # none to come will fit better
            self.state.stopped = "two searches fit alike"
            self.state.others.append(self._chart.to_values(ends[1][1][None])[0])
        elif self._in_vain >= 2 or (  # searches in a row that fit no better than one before
            ends and self._problem.relative_misfit(ends[0][0]) > self._worth
        ):
            self.state.stopped = "no search fits better"
        else:
            return False
        return True

    def _search_restarted(self, ends: list[End]) -> bool:
        """Search by stretches; the answer, or one more end. False if the record has no states."""
        whole, state = self._problem, self.state
        budget = min(2000, state.budget - state.evaluations)  # an upper limit: mostly 900
        restarted = whole.restarted()
        if restarted is None:
            return False
        if budget < SMALLEST_BUDGET:
            raise BudgetSpentError
        before = state.evaluations

        def count(evaluations: int, cost: float) -> None:
            state.evaluations = before + evaluations
            if state.report is not None:
                state.report(state.evaluations, state.cost)

        found = Tally(restarted, budget, count)
        seed = int(self._rng.integers(2**31))
        with suppress(BudgetSpentError):
            MultistartDescent(found, seed, worth=HOPEFUL * good_fit(restarted)).run()
        state.evaluations = before + found.evaluations
        if not np.isfinite(found.cost):
            return False

        end = self._polished(found.best, partial(state.residuals_of, restarted))
        answer = self._chart.to_values(end.points)[0]
        state.spend(2)
        old, new = restarted.costs(np.stack([state.best, answer]))
        if restarted.relative_misfit(new) < good_fit(restarted) and old > CLEARLY_BETTER**2 * new:
            state.spend(1)
            state.best, state.restarted = answer, restarted
            state.cost = float(whole.costs(answer[None])[0])
            return True
        fine = self._polished(answer, state.residuals)
        self._keep(fine)
        ends.append((float(fine.costs[0]), fine.points[0]))
        return True

    def _polished(
        self, x: np.ndarray, residuals: Callable[[np.ndarray], np.ndarray]
    ) -> LevenbergMarquardt:
        """The end of a last descent from a point (d,)."""
        fine = LevenbergMarquardt.start(self._chart.from_values(x[None]), residuals)
        for _ in range(POLISH[-1][1]):
            self._iterate(fine, residuals)
        return fine

    def _one_search(self, sobol: object) -> End:
        samples = self._samples(sobol)
        self.state.spend(len(samples))
        costs = self._smooth.costs(self._chart.to_values(samples))
        self._rate(samples[np.argmin(costs)])
        smooth_residuals = partial(self.state.residuals_of, self._smooth)
        descent = LevenbergMarquardt.start(
            self._starts(samples, costs, THINNING[0][0]), smooth_residuals, damping=0.1
        )
        for count, iterations in THINNING:
            descent = descent.best(count)
            for _ in range(iterations):
                self._iterate(descent, smooth_residuals)
            self._rate(descent.best(1).points[0])
        points = descent.best(POLISH[0][0]).points
        fine = LevenbergMarquardt.start(points, self.state.residuals)
        for count, iterations in POLISH:
            if count < len(fine.points):
                left = fine.best(len(fine.points)).points[count:]
                self.state.others += list(self._chart.to_values(left))
            fine = fine.best(count)
            for _ in range(iterations):
                self._iterate(fine, self.state.residuals)
                self._keep(fine)
        end = fine.best(1)
        return float(end.costs[0]), self._chart.project(end.points)[0]

    def _samples(self, sobol: object) -> np.ndarray:
        """Points (n, d) of ``z``; the problem's own start first, directions all round."""
        # a power of two, for the balance of the sequence; less where the budget is small
        n = min(256, 1 << ((self.state.budget // 2).bit_length() - 1))
        x = self._chart.from_unit(sobol.random(n))  # type: ignore[attr-defined]
        if self.state.evaluations == 0:
            x[0] = self._problem.start
        return self._chart.from_values(x)

    def _starts(self, samples: np.ndarray, costs: np.ndarray, count: int) -> np.ndarray:
        """The best samples, not too close to one another, from each range of separate minima."""
        ranges, total = np.zeros(len(samples), dtype=int), 1
        for n, unknown in enumerate(self._problem.unknowns):
            if unknown.valleys > 1:
                own = np.minimum(samples[:, n] * unknown.valleys, unknown.valleys - 1).astype(int)
                ranges, total = ranges * unknown.valleys + own, total * unknown.valleys
        quota = -(-count // total)
        chosen: list[int] = []
        for n in np.argsort(costs, kind="stable"):
            near = any(np.abs(samples[n] - samples[c]).max() < 0.15 for c in chosen)
            full = sum(ranges[c] == ranges[n] for c in chosen) >= quota
            if not (near or full):
                chosen.append(int(n))
            if len(chosen) == count:
                break
        return samples[chosen]

    def _iterate(
        self, descent: LevenbergMarquardt, residuals: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        descent.iterate(residuals, self._chart.lower, self._chart.upper, self._chart.project)

    def _rate(self, z: np.ndarray) -> None:
        """Offer a point of the smooth stage by the full bandwidth: the history has one scale."""
        self.state.spend(1)
        self.state.offer(z, float(self._problem.costs(self._chart.to_values(z[None]))[0]))

    def _keep(self, descent: LevenbergMarquardt) -> None:
        end = descent.best(1)
        self.state.offer(end.points[0], float(end.costs[0]))
