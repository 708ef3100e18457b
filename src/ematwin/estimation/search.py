"""Search: how the least cost of a problem is found; one protocol for every method.

A method is an object that is passed: `Multistart`, `LocalDescent`, or `Population` around any
optimiser. Names are for the command line and for files (`named`, `methods`). Budget, clock and
Ctrl-C are the same for all: a search ends at its budget, reports as it goes, and gives the best so
far when it is interrupted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.problem import Problem
from ematwin.optimizers.base import ITERATIONS, POPULATION, Algorithm, Optimizer

Progress = Callable[[int, float, int], None]
Report = Callable[[int, float], None]
"""Called with evaluations and best cost after each batch; may raise to end the search."""


@dataclass(frozen=True)
class Found:
    """Result of a search."""

    point: np.ndarray  # (d,), values of the free unknowns
    cost: float  # over the whole recordings
    evaluations: int
    history: np.ndarray  # (B, 2), evaluations and best cost so far
    stopped: str  # why it ended
    method: str  # its name
    seed: int
    problem: Problem | None = None  # that judged the point, where it differs from the given one
    others: tuple[np.ndarray, ...] = ()  # points (d,) of other minima, refined to convergence


class BudgetSpentError(Exception):
    """The next batch would exceed the budget; caught by `SlopeSearch`."""


@dataclass
class Tally:
    """Simulations of a search that follows slopes, its best point, and the way there.

    ``budget`` is the most simulations; ``restarted`` the problem that judged the best point where
    not the whole record did, though the cost is of the whole record. All else is as of `Found`.
    """

    problem: Problem
    budget: int
    report: Report | None = None
    best: np.ndarray = field(init=False)
    cost: float = float("inf")
    evaluations: int = 0
    history: list[tuple[int, float]] = field(default_factory=list)
    stopped: str = "interrupted"
    restarted: Problem | None = None
    others: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.best = self.problem.start

    def spend(self, count: int) -> None:
        """Count simulations before they are made; `BudgetSpentError` beyond the budget."""
        if self.evaluations + count > self.budget:
            raise BudgetSpentError
        self.evaluations += count

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Residuals (B, K) of the problem at coordinates (B, d), counted."""
        return self.residuals_of(self.problem, z)

    def residuals_of(self, problem: Problem, z: np.ndarray) -> np.ndarray:
        """The same of the problem in another form, such as a smoothed one."""
        self.spend(len(z))
        return problem.residuals(problem.chart.to_values(z))

    def offer(self, z: np.ndarray, cost: float) -> None:
        """Take a point (d,) where it is the best, and report."""
        if cost < self.cost:
            self.cost = cost
            self.best = self.problem.chart.to_values(z[None])[0]
        self.history.append((self.evaluations, self.cost))
        if self.report is not None:
            self.report(self.evaluations, self.cost)


class Search(Protocol):
    """A search method."""

    @property
    def name(self) -> str:
        """As it is called in results."""

    @property
    def planned(self) -> int:
        """Evaluations that it takes at most if no budget is given."""

    @property
    def smallest_budget(self) -> int:
        """The least budget that it can work with."""

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Find the point of least cost."""


class SlopeSearch(ABC):
    """A search that follows slopes: `run` keeps budget and Ctrl-C, `descend` searches."""

    planned = POPULATION * ITERATIONS  # an upper limit: most records need a tenth of it
    smallest_budget = 1
    name: Any

    @abstractmethod
    def descend(self, tally: Tally, seed: int) -> None:
        """Search until done; offer points to the tally, and say there why it ended."""

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Search; after an interruption with the best found until then.

        `InputError` if the budget is too small, `RecordError` if the twin diverged everywhere.
        """
        tally = Tally(problem, self.planned if budget is None else budget, report)
        if tally.budget < 1:
            raise InputError(f"The budget must be at least 1 evaluation, received {tally.budget}.")
        try:
            self.descend(tally, seed)
        except BudgetSpentError:
            tally.stopped = "budget"
        except KeyboardInterrupt:
            tally.stopped = "interrupted"
            if not np.isfinite(tally.cost):
                raise
        if not np.isfinite(tally.cost):
            raise RecordError(
                f"The twin diverged for each of {tally.evaluations} candidates. Check the "
                "parameters of the actuator and the first position and speed of the record."
            )
        return Found(
            tally.best, tally.cost, tally.evaluations, np.array(tally.history, dtype=float),
            tally.stopped, self.name, seed, tally.restarted, tuple(tally.others),
        )  # fmt: skip


@dataclass(frozen=True)
class Population:
    """An optimiser that asks and is told, with its one loop."""

    algorithm: str | Optimizer | Any  # a name, an optimiser, or a factory of one
    population: int = POPULATION
    iterations: int = ITERATIONS  # times the population it is the budget if none is given
    checkpoint: Path | None = None  # file of its state; an interrupted search goes on from it
    smallest_budget: int = 1

    @property
    def name(self) -> str:
        """Of the algorithm."""
        return self.algorithm if isinstance(self.algorithm, str) else type(self.algorithm).__name__

    @property
    def planned(self) -> int:
        """Population times iterations."""
        return self.population * self.iterations

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Minimise the costs within the bounds."""
        from ematwin.optimizers.loop import minimize

        result = minimize(
            _Costs(problem),
            problem.lower,
            problem.upper,
            self.algorithm,
            self.population,
            self.iterations,
            seed,
            budget=budget,
            checkpoint=self.checkpoint,
            callback=lambda now: report(now.evaluations, now.cost),
        )
        history = np.column_stack([result.history.evaluations, result.history.cost])
        return Found(
            problem.from_box(result.x[None])[0], result.cost, result.evaluations, history,
            result.stopped, result.algorithm, result.seed,
        )  # fmt: skip


@dataclass(frozen=True)
class _Costs:
    """The costs of a problem over its box, as `minimize` asks for them."""

    problem: Problem

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return self.problem.costs(self.problem.from_box(points))

    def costs_within(self, points: np.ndarray, limits: np.ndarray) -> np.ndarray:
        return self.problem.costs(self.problem.from_box(points), limits)


OWN = (
    Algorithm(
        "multistart",
        "Sobol samples, then Levenberg-Marquardt (default for the brushless actuator)",
        "this project, docs/results.md",
        "ematwin",
        lambda: import_module("ematwin.estimation.multistart").Multistart,
        departures="none",
        tuned_on="mixtures of faults with seeds of their own, of which some stand in tables of "
        "docs/results.md",
    ),
    Algorithm(
        "levenberg-marquardt",
        "Levenberg-Marquardt from the starts that the kind of actuator suggests",
        "Levenberg (1944), Marquardt (1963)",
        "ematwin",
        lambda: import_module("ematwin.estimation.local").LocalDescent,
        aliases=("lm", "descent"),
        departures="forward differences in batches; bounds by projection (Bertsekas 1982)",
    ),
    Algorithm(
        "scipy-trf",
        "Trust-region least squares of SciPy from random starts",
        "scipy.optimize.least_squares; Branch, Coleman and Li (1999)",
        "scipy",
        lambda: import_module("ematwin.estimation.local").ScipyLeastSquares,
        departures="forward differences as long as the default method's; restarts",
        tuned_on="nothing here: the library's own settings",
    ),
)
"""The methods that follow slopes; their factories make a `Search`."""


def methods() -> tuple[Algorithm, ...]:
    """All methods that can be named, the default first."""
    from ematwin.optimizers.registry import algorithms

    return (*OWN, *algorithms())


def expanded(names: Iterable[str]) -> tuple[str, ...]:
    """Names of methods, each once, with presets such as ``paper`` expanded."""
    from ematwin.optimizers.registry import PRESETS

    found = [one for name in names for one in PRESETS.get(name.strip().lower(), (name,))]
    return tuple(dict.fromkeys(method(name).name for name in found))


def method(text: str) -> Algorithm:
    """The method that a name or alias means.

    `InputError` if there is none, with the closest; `MissingExtraError` without its library.
    """
    wanted = text.strip().lower().replace("_", "-")
    for one in OWN:
        if wanted in (one.name, *one.aliases):
            return one
    from ematwin.optimizers.registry import find

    found = find(text)
    found.factory()
    return found


def named(
    algorithm: str | Search | Optimizer | Any,
    *,
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    checkpoint: str | Path | None = None,
) -> Search:
    """The search that a name, a search, an optimiser or a factory of one means.

    `InputError` if there is none of that name, or it keeps no checkpoint.
    """
    if hasattr(algorithm, "run") and not isinstance(algorithm, Optimizer):
        return cast(Search, algorithm)
    if isinstance(algorithm, str) and (one := method(algorithm)) in OWN:
        if checkpoint is not None:
            raise InputError(
                f"The method {one.name} takes about a second and keeps no checkpoint; leave it "
                "out, or choose a population method such as de."
            )
        return cast(Any, one.factory())()
    path = None if checkpoint is None else Path(checkpoint)
    return Population(algorithm, population, iterations, path)


def find(
    problem: Problem,
    search: Search,
    *,
    budget: int | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> Found:
    """Run a search on a problem: the one way, for `identify` and for studies alike.

    ``progress`` is called with evaluations, best cost and budget after each batch; it may raise to
    end the search.
    """
    if not (budget is None or isinstance(budget, int | np.integer)):
        raise InputError(f"budget must be a whole number of simulations, received {budget!r}.")
    total = search.planned if budget is None else budget
    with noting_interrupts() as interrupts:

        def report(evaluations: int, cost: float) -> None:
            interrupts.check()
            if progress is not None:
                progress(evaluations, cost, total)

        found = search.run(problem, budget=budget, seed=seed, report=report)
        interrupts.pressed = False
    return found
