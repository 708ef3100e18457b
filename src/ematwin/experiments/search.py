"""Search for a command: over the numbers of a scenario, within limits of the motion.

The cost of a command is the caller's: `design` asks for small errors, `discriminate` for
explanations that lie far apart. Differential evolution begins with the given command, so that the
best is never worse.
"""

import math
import time
from collections.abc import Callable, Mapping

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.interrupt import InterruptNoted, noting_interrupts
from ematwin.experiments.experiment import UNANSWERED, Experiment, RefusedError
from ematwin.experiments.space import DesignSpace
from ematwin.models.scenario import Scenario
from ematwin.optimizers.base import Box, FloatArray
from ematwin.optimizers.differential_evolution import DifferentialEvolution, Dither
from ematwin.optimizers.loop import minimize
from ematwin.optimizers.result import Progress as SearchProgress
from ematwin.optimizers.result import Stop
from ematwin.recordings.recording import Recording

BUDGET, POPULATION = 500, 12
SECONDS = 60.0  # that a search without a budget takes at most
_SCATTER = 0.15  # of the first commands about the given one, share of the box
_NEAR = 0.3  # share of the first commands that lie near the given one
_APART = 0.05  # share of the box by which commands differ
_IMPOSSIBLE = 1e6  # cost of a command that cannot be judged; more, the further beyond its limits

Progress = Callable[[int, float, int], object]
"""Takes the number of commands so far, the best value, and the budget."""


class CommandSearch:
    """A search over a design space, and the best commands that it has seen.

    Parameters
    ----------
    experiment : whose healthy actuator has to keep the limits
    given : the command from which the search begins
    limits : of the demands, by name, SI
    cost_of : of a command, of the healthy recording of it by the fast model, and of a cost above
        which it does not matter; an error of `UNANSWERED` where there is none

    Attributes
    ----------
    evaluations : commands that were judged
    stopped : why the search ended
    """

    def __init__(
        self,
        experiment: Experiment,
        given: Scenario,
        limits: Mapping[str, float],
        cost_of: Callable[[Scenario, Recording, float], float],
    ) -> None:
        self._experiment, self._limits, self._cost_of = experiment, limits, cost_of
        self._space = DesignSpace(experiment.model, given, limits)
        self.evaluations, self.stopped = 0, ""
        self._nearest: Mapping[str, float] = {}  # demands of the command next to its limits
        self._seen: list[tuple[float, np.ndarray]] = []
        self._least = self._ends = math.inf
        self._interrupts = InterruptNoted()

    def run(
        self, budget: int | None, seed: int, progress: Progress | None, usual: int = BUDGET
    ) -> None:
        """Judge ``budget`` commands, or fewer after Ctrl-C.

        Without a budget ``usual`` ones are judged, or as many as `SECONDS` allow.
        """
        if budget is None:
            budget, self._ends = usual, time.perf_counter() + SECONDS

        def tell(state: SearchProgress) -> bool:
            if progress is not None:
                progress(self.evaluations, state.cost, budget)
            return time.perf_counter() > self._ends

        dimension = len(self._space.numbers)
        box = Box(np.zeros(dimension), np.ones(dimension))
        optimizer = _From(self._space.start, box, population=min(POPULATION, budget), seed=seed)
        with noting_interrupts() as self._interrupts:
            try:
                self.stopped = minimize(
                    self, box.lower, box.upper, optimizer, budget=budget, callback=tell
                ).stopped
            except KeyboardInterrupt:  # before there was anything to keep
                self.stopped = "interrupted"
            self._interrupts.pressed = False
        if self.stopped == Stop.CALLBACK:
            self.stopped = "time"

    def __call__(self, points: FloatArray) -> FloatArray:
        """Costs (N,) of points (N, d) of the box."""
        return self.costs_within(points, np.full(len(points), np.inf))

    def costs_within(self, points: FloatArray, limits: FloatArray) -> FloatArray:
        """Costs (N,); of those above a limit (N,) no more than that is known."""
        return np.array([self._cost(p, limit) for p, limit in zip(points, limits, strict=True)])

    def _cost(self, point: np.ndarray, limit: float) -> float:
        self._interrupts.check()
        if self.evaluations and time.perf_counter() > self._ends:
            return _IMPOSSIBLE  # the rest of a batch
        self.evaluations += 1
        command = self._space.scenario(point)
        try:
            healthy = self._experiment.move(command, self._limits)
            cost = self._cost_of(command, healthy, limit)
        except RefusedError as error:
            if 0.0 < error.excess < self._least:
                self._nearest, self._least = error.demands, error.excess
            return _IMPOSSIBLE * (1.0 + error.excess)
        except UNANSWERED:
            return _IMPOSSIBLE
        if not math.isfinite(cost):
            return _IMPOSSIBLE
        self._seen.append((cost, point.copy()))
        return cost

    def best(self, count: int) -> list[Scenario]:
        """The best commands that differ, the best first; none if none keeps the limits."""
        found: list[np.ndarray] = []
        for _, point in sorted(self._seen, key=lambda pair: pair[0]):
            if all(np.abs(point - other).max() > _APART for other in found):
                found.append(point)
            if len(found) == count:
                break
        return [self._space.scenario(point) for point in found]

    def refusal(self, asked: Mapping[str, float]) -> InputError:
        """The error that says that no command keeps the limits."""
        told = ", ".join(f"{name} {value:g}" for name, value in asked.items())
        near = ", ".join(f"{name} {size:.3g}" for name, size in self._nearest.items())
        return InputError(
            f"No command of {self._experiment.actuator.name} keeps the limits "
            f"({told or 'those of the given command'}) and moves enough to identify faults"
            + (f"; the nearest demands {near}" if near else "")
            + ". Raise the limits, leave some out, or begin from another scenario."
        )


class _From(DifferentialEvolution):
    """Differential evolution that begins with points about a given one."""

    def __init__(self, start: np.ndarray, box: Box, *, population: int, seed: int) -> None:
        least = self.minimum_population
        super().__init__(box, population=max(population, least), seed=seed, F=Dither(0.4, 0.9))
        self._first = start

    def _start(self) -> FloatArray:
        points = super()._start()
        near = max(1, round(_NEAR * len(points)))
        step = _SCATTER * self.rng.standard_normal((near, len(self._first)))
        step[0] = 0.0
        points[:near] = self.box.clip(self._first + step)
        return points
