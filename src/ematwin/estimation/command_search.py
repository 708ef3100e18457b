"""The search for a command: over the numbers of a scenario, within what a motion may demand.

What makes a command good is the caller's: `design` asks for small errors, `discriminate` for
explanations that lie far apart. Differential evolution begins with the given command, so that the
best is never worse.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.interrupt import InterruptNoted, noting_interrupts
from ematwin.models.base import Demand, Model
from ematwin.models.designed import DesignSpace
from ematwin.models.scenario import Scenario
from ematwin.optimizers.base import Box, FloatArray
from ematwin.optimizers.differential_evolution import DifferentialEvolution, Dither
from ematwin.optimizers.loop import minimize
from ematwin.optimizers.stopping import Progress as SearchProgress

BUDGET, POPULATION = 500, 12
BEYOND = "beyond its limits"
_SCATTER = 0.15  # of the first commands about the given one, share of the box
_NEAR = 0.3  # share of the first commands that lie near the given one
_APART = 0.05  # share of the box by which commands differ
_IMPOSSIBLE = 1e6  # cost of a command that cannot be judged; more, the further beyond its limits
_SLACK = 1e-3  # share of a limit: motions that differ by rounding keep it alike

Progress = Callable[[int, float, int], object]
"""Takes commands looked at, the best value so far, and the budget."""


@dataclass(frozen=True)
class Looked:
    """What a look at a command gave.

    Attributes
    ----------
    cost : float, the lower the better; infinite where ``obstacle`` says why there is none
    demands : what the motion demands, by name, SI
    obstacle : str
    """

    cost: float
    demands: Mapping[str, float]
    obstacle: str = ""


class CommandSearch:
    """A search over a design space, and the best commands that it has seen.

    Parameters
    ----------
    space : commands that can be made of a scenario
    limits : what they may demand, by name, SI
    look : a command, and a cost above which it does not matter -> `Looked`

    Attributes
    ----------
    evaluations : commands looked at
    stopped : why the search ended
    nearest : demands of the command that was nearest to keeping the limits; empty if none was asked
    """

    def __init__(
        self,
        space: DesignSpace,
        limits: Mapping[str, float],
        look: Callable[[Scenario, float], Looked],
    ) -> None:
        self.space, self.limits, self._look = space, limits, look
        self.evaluations, self.stopped = 0, ""
        self.nearest: Mapping[str, float] = {}
        self._seen: list[tuple[float, np.ndarray]] = []
        self._least = math.inf
        self._interrupts = InterruptNoted()

    def run(self, budget: int, seed: int, progress: Progress | None) -> None:
        """Look at ``budget`` commands, or at fewer after Ctrl-C."""

        def tell(state: SearchProgress) -> None:
            if progress is not None:
                progress(state.evaluations, state.cost, budget)

        dimension = len(self.space.numbers)
        box = Box(np.zeros(dimension), np.ones(dimension))
        optimizer = _From(self.space.start, box, population=min(POPULATION, budget), seed=seed)
        with noting_interrupts() as self._interrupts:
            try:
                self.stopped = minimize(
                    self, box.lower, box.upper, optimizer, budget=budget, callback=tell
                ).stopped
            except KeyboardInterrupt:  # before there was anything to keep
                self.stopped = "interrupted"
            self._interrupts.pressed = False

    def __call__(self, points: FloatArray) -> FloatArray:
        """Costs (N,) of points (N, d) of the box."""
        return self.costs_within(points, np.full(len(points), np.inf))

    def costs_within(self, points: FloatArray, limits: FloatArray) -> FloatArray:
        """Costs (N,); of those above a limit (N,) no more than that is known."""
        return np.array([self._cost(p, limit) for p, limit in zip(points, limits, strict=True)])

    def _cost(self, point: np.ndarray, limit: float) -> float:
        self._interrupts.check()
        self.evaluations += 1
        one = self._look(self.space.scenario(point), limit)
        if math.isfinite(one.cost):
            self._seen.append((one.cost, point.copy()))
            return one.cost
        over = excess(one.demands, self.limits)
        if one.obstacle == BEYOND and over < self._least:
            self.nearest, self._least = one.demands, over
        return _IMPOSSIBLE * (1.0 + over)

    def best(self, count: int) -> list[Scenario]:
        """The best commands that differ, the best first; none if none keeps the limits."""
        found: list[np.ndarray] = []
        for _, point in sorted(self._seen, key=lambda pair: pair[0]):
            if all(np.abs(point - other).max() > _APART for other in found):
                found.append(point)
            if len(found) == count:
                break
        return [self.space.scenario(point) for point in found]

    def refusal(self, actuator: str, asked: Mapping[str, float]) -> InputError:
        """The error that says that no command keeps the limits."""
        told = ", ".join(f"{name} {value:g}" for name, value in asked.items())
        near = ", ".join(f"{name} {size:.3g}" for name, size in self.nearest.items())
        return InputError(
            f"No command of {actuator} keeps the limits ({told or 'those of the given command'}) "
            "and moves enough to tell faults"
            + (f"; the nearest demands {near}" if near else "")
            + ". Raise the limits, leave some out, or begin from another scenario."
        )


class _From(DifferentialEvolution):
    """Differential evolution of which some of the first points lie about a given one."""

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


def demands_of(model: Model) -> tuple[Demand, ...]:
    """What may be limited for a kind."""
    unit = model.channel(model.command).unit
    return model.demands or (Demand("travel", unit, (model.command,)),)


def limits_of(
    model: Model, default: Mapping[str, float], given: Mapping[str, float]
) -> dict[str, float]:
    """Limits that were given; where none was, what the given command demands.

    Raises
    ------
    InputError
        If a name or a value cannot be used.
    """
    known = [one.name for one in demands_of(model)]
    for name, value in given.items():
        if name not in known:
            raise InputError(
                f"There is no limit {name!r} for the kind {model.kind}; choose of "
                f"{', '.join(known)}."
            )
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"The limit of {name} must be a positive number, received {value}.")
    return {**default, **{name: float(value) for name, value in given.items()}}


def excess(demands: Mapping[str, float], limits: Mapping[str, float]) -> float:
    """By what share demands exceed their limits, added up; 0 where all are kept."""
    return sum(
        demands[name] / limit - 1.0
        for name, limit in limits.items()
        if demands.get(name, 0.0) > limit * (1.0 + _SLACK)
    )


def begun(model: Model, scenario: object, duration: float | None) -> Scenario:
    """The command to begin from, in the duration that is asked for.

    Raises
    ------
    InputError
        If it cannot be used, or the duration is none.
    """
    given = model.load_scenario(scenario)  # type: ignore[arg-type]
    if duration is None:
        return given
    if not (math.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration must be a positive number of s, received {duration}.")
    return given.lasting(duration)
