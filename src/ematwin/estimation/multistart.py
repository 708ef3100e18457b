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
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import AS_GOOD, EXPLAINED
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import BudgetSpentError, Found, Report, Tally, by_slopes
from ematwin.numerics.sobol import Sobol
from ematwin.optimizers.base import ITERATIONS, POPULATION

SAMPLES = 256
THINNING = ((10, 2), (5, 2), (3, 3))  # descents and their iterations, smooth misfit
POLISH = ((2, 4), (1, 12))  # the same with the full bandwidth
CLEARLY_BETTER = 3.0  # ratio of misfits by stretches; 3.6 to 160 where a search was misled
AGREEMENT = 0.02  # largest difference of two ends that agree, in any coordinate
ALIKE = 1.02  # ratio of costs of two ends that fit alike: no search to come is likely to fit better
SMALLEST_BUDGET = 64
HOPEFUL = 2.0  # times a good fit by stretches, beyond which no other search by them finds one
DEFAULT_BUDGET = POPULATION * ITERATIONS  # an upper limit: most records need a tenth of it

End = tuple[float, np.ndarray]  # cost and point of a finished descent


def good_fit(problem: Problem) -> float:
    """The relative misfit below which a fit needs no second opinion."""
    return max(EXPLAINED, AS_GOOD * problem.expected_misfit)


@dataclass(frozen=True)
class Multistart:
    """The default method, as a search that can be passed."""

    name: str = "multistart"
    planned: int = DEFAULT_BUDGET
    smallest_budget: int = SMALLEST_BUDGET

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Search; after an interruption with the best found until then."""
        limit = self.planned if budget is None else budget
        search = MultistartDescent(problem, budget=limit, seed=seed, report=report)
        return by_slopes(self.name, search.state, seed, search.run)


class MultistartDescent:
    """Search for the point that explains the recordings of a problem best.

    Parameters
    ----------
    problem : Problem, with the full bandwidth
    budget : int, simulations at most
    seed : int
    report : called with evaluations and best cost after each stage
    worth : float, relative misfit beyond which another search is not worth it

    Attributes
    ----------
    state : Tally, valid at any time, also after an interruption
    """

    def __init__(
        self,
        problem: Problem,
        *,
        budget: int = DEFAULT_BUDGET,
        seed: int = 1,
        report: Report | None = None,
        worth: float = np.inf,
    ) -> None:
        if budget < SMALLEST_BUDGET:
            raise InputError(
                f"The default method needs a budget of at least {SMALLEST_BUDGET} evaluations, "
                f"received {budget}. Raise it, or choose another algorithm."
            )
        self._problem = problem
        self._smooth = problem.smoothed()
        self._chart = problem.chart
        self._rng = np.random.default_rng(seed)
        self.worth = worth
        self._in_vain = 0  # searches since the best end
        self._noted: list[tuple[int, np.ndarray]] = []  # evaluations, and a point yet to be rated
        self.state = Tally(problem, budget, report, problem.start)

    def run(self) -> Tally:
        """Search until the fit is good, two ends agree, or the budget is spent."""
        sobol = Sobol(len(self._problem.names), rng=self._rng)
        ends: list[End] = []
        try:
            while not self._settled(ends):
                if len(ends) == 1 and self._search_restarted(ends):
                    continue
                best = min((cost for cost, _ in ends), default=np.inf)
                ends.append(self._one_search(sobol))
                self._in_vain = self._in_vain + 1 if ends[-1][0] >= best else 0
        except BudgetSpentError:
            self._rate_noted()
            self.state.stopped = "budget"
        except KeyboardInterrupt:
            self._rate_noted(told=False)  # whoever is told would raise it again
            raise
        return self.state

    def searches(self, most: int) -> Iterator[End]:
        """Whole searches one after another, each from new samples, while the budget lasts."""
        sobol = Sobol(len(self._problem.names), rng=self._rng)
        for _ in range(most):
            try:
                yield self._one_search(sobol)
            except BudgetSpentError:
                self._rate_noted()
                return

    def _settled(self, ends: list[End]) -> bool:
        """Whether the search may end, and why."""
        ends.sort(key=lambda end: end[0])
        if self.state.restarted is not None:
            self.state.stopped = "good fit of stretches"
        elif ends and self._problem.relative_misfit(ends[0][0]) < good_fit(self._problem):
            self.state.stopped = "good fit"
        elif len(ends) > 1 and np.abs(ends[0][1] - ends[1][1]).max() < AGREEMENT:
            self.state.stopped = "two searches agree"
        elif len(ends) > 1 and ends[1][0] < ALIKE * ends[0][0]:
            self.state.stopped = "two searches fit alike"
            self.state.others.append(self._chart.to_values(ends[1][1][None])[0])
        elif self._in_vain >= 2 or (  # searches in a row that fit no better than one before
            ends and self._problem.relative_misfit(ends[0][0]) > self.worth
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

        search = MultistartDescent(
            restarted, budget=budget, seed=int(self._rng.integers(2**31)), report=count,
            worth=HOPEFUL * good_fit(restarted),
        )  # fmt: skip
        found = search.run()
        state.evaluations = before + found.evaluations
        if not np.isfinite(found.cost):
            return False

        def residuals(z: np.ndarray) -> np.ndarray:
            self.state.spend(len(z))
            return restarted.residuals(self._chart.to_values(z))

        answer = self._chart.to_values(self._polished(found.best, residuals).points)[0]
        self.state.spend(2)
        old, new = restarted.costs(np.stack([state.best, answer]))
        if restarted.relative_misfit(new) < good_fit(restarted) and old > CLEARLY_BETTER**2 * new:
            self.state.spend(1)
            state.best, state.restarted = answer, restarted
            state.cost = float(whole.costs(answer[None])[0])
            return True
        fine = self._polished(answer, self.state.residuals)
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
        costs = self._costs(samples)
        self._note(samples[np.argmin(costs)])
        descent = LevenbergMarquardt.start(
            self._starts(samples, costs, THINNING[0][0]), self._smooth_residuals, damping=0.1
        )
        for count, iterations in THINNING:
            descent = descent.best(count)
            for _ in range(iterations):
                self._iterate(descent, self._smooth_residuals)
            self._note(descent.best(1).points[0])
        self._rate_noted()
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
        n = min(SAMPLES, 1 << ((self.state.budget // 2).bit_length() - 1))
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

    def _costs(self, z: np.ndarray) -> np.ndarray:
        self.state.spend(len(z))
        return self._smooth.costs(self._chart.to_values(z))

    def _smooth_residuals(self, z: np.ndarray) -> np.ndarray:
        self.state.spend(len(z))
        return self._smooth.residuals(self._chart.to_values(z))

    def _note(self, z: np.ndarray) -> None:
        """Have a point of the smooth stage rated by the full bandwidth: the history has one scale.

        Later, all of them together (`_rate_noted`): one candidate takes as long as many.
        """
        self.state.spend(1)
        self._noted.append((self.state.evaluations, z))

    def _rate_noted(self, told: bool = True) -> None:
        """Rate the points that were noted, in their order; ``told``: and report each."""
        noted, self._noted = self._noted, []
        if noted:
            costs = self._problem.costs(self._chart.to_values(np.stack([z for _, z in noted])))
            for (evaluations, z), cost in zip(noted, costs.tolist(), strict=True):
                self.state.offer(z, cost, evaluations, told)

    def _keep(self, descent: LevenbergMarquardt) -> None:
        end = descent.best(1)
        self.state.offer(end.points[0], float(end.costs[0]))
