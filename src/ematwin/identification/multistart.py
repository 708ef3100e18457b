"""The default method: Sobol sampling, then Levenberg-Marquardt descents thinned out on the way.

Coarse to fine. Misfits of currents low-passed at 100 Hz are smooth over wide valleys: sampling and
the first descents use those. Descents start from the best samples of three ranges of backlash,
because backlash is where the misfit has separate valleys, and from all directions of the
eccentricity. Every second iteration or so the worse half is dropped. The survivors go on with the
record's full bandwidth.

Where the fit is poor, the twin may have stalled where the actuator still moved, and the misfit of
the whole record leads nowhere. If the record has positions, the same search is then made stretch by
stretch (`ematwin.identification.stretches`). An end that explains the stretches far better than
the first one did is the answer; any other goes on with the whole record. Where that does not settle
it, all is done again from new samples, until two ends agree or the budget is spent.

Sobol (1967), with scipy's scrambling; successive halving as in Jamieson and Talwalkar (2016).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.identification.descent import Descent
from ematwin.identification.objective import Objective
from ematwin.identification.space import FaultSpace
from ematwin.identification.stretches import Stretches, has_states

SMOOTH_CUTOFF = 100.0  # Hz
SAMPLES = 256
THINNING = ((10, 2), (5, 2), (3, 3))  # descents and their iterations, smooth misfit
POLISH = ((2, 4), (1, 12))  # the same with the full bandwidth
BACKLASH_RANGES = 3
GOOD_FIT = 0.015  # relative misfit that needs no second opinion
CLEARLY_BETTER = 3.0  # ratio of misfits by stretches; 3.6 to 160 where a search was misled
AGREEMENT = 0.02  # largest difference of two ends that agree, in any coordinate
SMALLEST_BUDGET = 64
STRETCH_BUDGET = 2000  # an upper limit: mostly 900
DEFAULT_BUDGET = 10_000  # an upper limit: most records need a tenth of it

Report = Callable[[int, float], None]
End = tuple[float, np.ndarray]  # cost and point of a finished descent


@dataclass
class SearchState:
    """What a search knows so far: the best vector, its cost, the price, the way there.

    ``stretches`` is what the best vector was judged by where not by the whole record; its cost is
    of the whole record nevertheless.
    """

    best: np.ndarray
    cost: float
    evaluations: int
    history: list[tuple[int, float]]
    stopped: str = "interrupted"
    stretches: Stretches | None = None


class BudgetSpentError(Exception):
    """The next batch would exceed the budget; caught within this module."""


class MultistartDescent:
    """Search for the fault vector that explains a record best.

    Parameters
    ----------
    objective : Objective, or a record by stretches, with the full bandwidth
    space : FaultSpace
    budget : int, simulations at most
    seed : int
    report : called with evaluations and best cost after each stage

    Attributes
    ----------
    state : SearchState, valid at any time, also after an interruption
    """

    def __init__(
        self,
        objective: Objective | Stretches,
        space: FaultSpace,
        *,
        budget: int = DEFAULT_BUDGET,
        seed: int = 1,
        report: Report | None = None,
    ) -> None:
        if budget < SMALLEST_BUDGET:
            raise InputError(
                f"The default method needs a budget of at least {SMALLEST_BUDGET} evaluations, "
                f"received {budget}. Raise it, or choose another algorithm."
            )
        self._objective = objective
        self._smooth = objective.with_cutoff(min(SMOOTH_CUTOFF, objective.low_pass.cutoff))
        self._space = space
        self._budget = budget
        self._report = report
        self._rng = np.random.default_rng(seed)
        held = space.held.vector
        self.state = SearchState(held, float("inf"), 0, [])

    def run(self) -> SearchState:
        """Search until the fit is good, two ends agree, or the budget is spent."""
        from scipy.stats.qmc import Sobol

        sobol = Sobol(len(self._space.names), rng=self._rng)
        ends: list[End] = []
        try:
            while not self._settled(ends):
                if len(ends) == 1 and self._search_stretches(ends):
                    continue
                ends.append(self._one_search(sobol))
        except BudgetSpentError:
            self.state.stopped = "budget"
        return self.state

    def _settled(self, ends: list[End]) -> bool:
        """Whether the search may end, and why."""
        ends.sort(key=lambda end: end[0])
        if self.state.stretches is not None:
            self.state.stopped = "good fit of stretches"
        elif ends and self._objective.relative_misfit(ends[0][0]) < GOOD_FIT:
            self.state.stopped = "good fit"
        elif len(ends) > 1 and np.abs(ends[0][1] - ends[1][1]).max() < AGREEMENT:
            self.state.stopped = "two searches agree"
        else:
            return False
        return True

    def _search_stretches(self, ends: list[End]) -> bool:
        """Search by stretches; the answer, or one more end. False if the record has no states."""
        whole, state, space = self._objective, self.state, self._space
        budget = min(STRETCH_BUDGET, self._budget - state.evaluations)
        if isinstance(whole, Stretches) or not has_states(whole.record):
            return False
        if budget < SMALLEST_BUDGET:
            raise BudgetSpentError
        stretches = Stretches(whole)
        before = state.evaluations

        def count(evaluations: int, cost: float) -> None:
            state.evaluations = before + evaluations
            if self._report is not None:
                self._report(state.evaluations, state.cost)

        search = MultistartDescent(
            stretches, space, budget=budget, seed=int(self._rng.integers(2**31)), report=count
        )
        found = search.run()
        state.evaluations = before + found.evaluations
        if not np.isfinite(found.cost):
            return False

        def residuals(z: np.ndarray) -> np.ndarray:
            self._spend(len(z))
            return stretches.residuals(space.to_faults(z))

        answer = space.to_faults(self._polished(found.best, residuals).points)[0]
        self._spend(2)
        old, new = stretches(np.stack([state.best, answer]))
        if stretches.relative_misfit(new) < GOOD_FIT and old > CLEARLY_BETTER**2 * new:
            self._spend(1)
            state.best, state.stretches = answer, stretches
            state.cost = float(whole(answer[None])[0])
            return True
        fine = self._polished(answer, self._residuals)
        self._keep(fine)
        ends.append((float(fine.costs[0]), fine.points[0]))
        return True

    def _polished(self, k: np.ndarray, residuals: Callable[[np.ndarray], np.ndarray]) -> Descent:
        """The end of a last descent from a fault vector (8,)."""
        fine = Descent.start(self._space.from_faults(k[None]), residuals, damping=1e-2)
        for _ in range(POLISH[-1][1]):
            self._iterate(fine, residuals)
        return fine

    def _one_search(self, sobol: object) -> End:
        space = self._space
        samples = self._samples(sobol)
        costs = self._costs(samples)
        self._note(samples[np.argmin(costs)])
        descent = Descent.start(
            self._starts(samples, costs, THINNING[0][0]), self._smooth_residuals, damping=0.1
        )
        for count, iterations in THINNING:
            descent = descent.best(count)
            for _ in range(iterations):
                self._iterate(descent, self._smooth_residuals)
            self._note(descent.best(1).points[0])
        points = descent.best(POLISH[0][0]).points
        fine = Descent.start(points, self._residuals, damping=1e-2)
        for count, iterations in POLISH:
            fine = fine.best(count)
            for _ in range(iterations):
                self._iterate(fine, self._residuals)
                self._keep(fine)
        end = fine.best(1)
        return float(end.costs[0]), space.project(end.points)[0]

    def _samples(self, sobol: object) -> np.ndarray:
        """Points (n, d) of ``z``; the held vector first, directions of eccentricity all round."""
        # a power of two, for the balance of the sequence; less where the budget is small
        n = min(SAMPLES, 1 << ((self._budget // 2).bit_length() - 1))
        k = self._space.full(sobol.random(n))  # type: ignore[attr-defined]
        if self.state.evaluations == 0:
            k[0] = self._space.held.vector
        return self._space.from_faults(k)

    def _starts(self, samples: np.ndarray, costs: np.ndarray, count: int) -> np.ndarray:
        """The best samples, not too close to one another, from each range of backlash."""
        names = self._space.names
        if "backlash" in names:
            backlash = samples[:, names.index("backlash")]
            ranges = np.minimum(backlash * BACKLASH_RANGES, BACKLASH_RANGES - 1).astype(int)
            quota = -(-count // BACKLASH_RANGES)
        else:
            ranges, quota = np.zeros(len(samples), dtype=int), count
        chosen: list[int] = []
        for n in np.argsort(costs, kind="stable"):
            near = any(np.abs(samples[n] - samples[c]).max() < 0.15 for c in chosen)
            full = sum(ranges[c] == ranges[n] for c in chosen) >= quota
            if not (near or full):
                chosen.append(int(n))
            if len(chosen) == count:
                break
        return samples[chosen]

    def _iterate(self, descent: Descent, residuals: Callable[[np.ndarray], np.ndarray]) -> None:
        descent.iterate(residuals, self._space.lower, self._space.upper, self._space.project)

    def _spend(self, count: int) -> None:
        if self.state.evaluations + count > self._budget:
            raise BudgetSpentError
        self.state.evaluations += count

    def _costs(self, z: np.ndarray) -> np.ndarray:
        self._spend(len(z))
        return self._smooth(self._space.to_faults(z))

    def _smooth_residuals(self, z: np.ndarray) -> np.ndarray:
        self._spend(len(z))
        return self._smooth.residuals(self._space.to_faults(z))

    def _residuals(self, z: np.ndarray) -> np.ndarray:
        self._spend(len(z))
        return self._objective.residuals(self._space.to_faults(z))

    def _note(self, z: np.ndarray) -> None:
        """Rate a point of the smooth stage with the full bandwidth: the history has one scale."""
        self._spend(1)
        self._offer(z, float(self._objective(self._space.to_faults(z[None]))[0]))

    def _keep(self, descent: Descent) -> None:
        end = descent.best(1)
        self._offer(end.points[0], float(end.costs[0]))

    def _offer(self, z: np.ndarray, cost: float) -> None:
        state = self.state
        if cost < state.cost:
            state.cost = cost
            state.best = self._space.to_faults(z[None])[0]
        state.history.append((state.evaluations, state.cost))
        if self._report is not None:
            self._report(state.evaluations, state.cost)
