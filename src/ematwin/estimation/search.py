"""Search: how the least cost of a problem is found; one protocol for every method.

A method is an object that is passed: `Multistart`, `LocalDescent`, or `Population` around any
optimiser. Names are for the command line and for files (`named`, `methods`). Budget, clock and
Ctrl-C are the same for all: a search ends at its budget, reports as it goes, and gives the best so
far when it is interrupted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
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
    """Result of a search.

    Attributes
    ----------
    point : (d,) array, values of the free unknowns
    cost : float, over the whole recordings
    evaluations : int
    history : (B, 2) array, evaluations and best cost so far
    stopped : why it ended
    method : name
    seed : int
    problem : the problem that judged the point, where it differs from the given problem
    others : points (d,) of other local minima, refined to convergence
    """

    point: np.ndarray
    cost: float
    evaluations: int
    history: np.ndarray
    stopped: str
    method: str
    seed: int
    problem: Problem | None = None
    others: tuple[np.ndarray, ...] = ()


class BudgetSpentError(Exception):
    """The next batch would exceed the budget; caught by `by_slopes`."""


@dataclass
class Tally:
    """Simulations of a search that follows slopes, its best point, and the way there.

    Attributes
    ----------
    problem : Problem
    budget : int, simulations at most
    report : called after each stage
    best, cost, evaluations, stopped, others : as of `Found`
    history : evaluations and best cost so far
    restarted : the problem that judged the best point where not the whole record did; the cost is
        of the whole record nevertheless
    """

    problem: Problem
    budget: int
    report: Report | None = None
    best: np.ndarray = field(default_factory=lambda: np.zeros(0))
    cost: float = float("inf")
    evaluations: int = 0
    history: list[tuple[int, float]] = field(default_factory=list)
    stopped: str = "interrupted"
    restarted: Problem | None = None
    others: list[np.ndarray] = field(default_factory=list)

    def spend(self, count: int) -> None:
        """Count simulations before they are made.

        Raises
        ------
        BudgetSpentError
            If they would exceed the budget.
        """
        if self.evaluations + count > self.budget:
            raise BudgetSpentError
        self.evaluations += count

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Residuals (B, K) of the problem at coordinates (B, d), counted."""
        self.spend(len(z))
        return self.problem.residuals(self.problem.chart.to_values(z))

    def offer(
        self, z: np.ndarray, cost: float, evaluations: int | None = None, told: bool = True
    ) -> None:
        """Take a point (d,) where it is the best; ``evaluations`` are those until it was seen."""
        if cost < self.cost:
            self.cost = cost
            self.best = self.problem.chart.to_values(z[None])[0]
        spent = self.evaluations if evaluations is None else evaluations
        self.history.append((spent, self.cost))
        if told and self.report is not None:
            self.report(self.evaluations, self.cost)


def by_slopes(name: str, tally: Tally, seed: int, work: Callable[[], object]) -> Found:
    """Result of a search that follows slopes, also after its budget is spent or it is interrupted.

    Raises
    ------
    InputError
        If the budget is less than one simulation.
    RecordError
        If the twin diverged everywhere.
    """
    if tally.budget < 1:
        raise InputError(f"The budget must be at least 1 evaluation, received {tally.budget}.")
    try:
        work()
    except BudgetSpentError:
        tally.stopped = "budget"
    except KeyboardInterrupt:
        tally.stopped = "interrupted"
        if not np.isfinite(tally.cost):
            raise
    if not np.isfinite(tally.cost):
        raise RecordError(
            f"The twin diverged for each of {tally.evaluations} candidates. Check the parameters "
            "of the actuator and the first position and speed of the record."
        )
    return Found(
        tally.best, tally.cost, tally.evaluations, np.array(tally.history, dtype=float),
        tally.stopped, name, seed, tally.restarted, tuple(tally.others),
    )  # fmt: skip


class Search(Protocol):
    """A search method.

    Attributes
    ----------
    name : str
    planned : int, evaluations that it takes at most if no budget is given
    smallest_budget : int
    """

    @property
    def name(self) -> str:
        """As it is called in results."""
        ...

    @property
    def planned(self) -> int:
        """Evaluations at most without a budget."""
        ...

    @property
    def smallest_budget(self) -> int:
        """The least budget that it can work with."""
        ...

    def run(self, problem: Problem, *, budget: int | None, seed: int, report: Report) -> Found:
        """Find the point of least cost."""
        ...


@dataclass(frozen=True)
class Population:
    """An optimiser that asks and is told, with its one loop.

    Parameters
    ----------
    algorithm : name of ``ematwin algorithms``, an optimiser, or a factory of one
    population, iterations : their product is the budget if none is given
    checkpoint : file of its state; an interrupted search goes on from it
    """

    algorithm: str | Optimizer | Any
    population: int = POPULATION
    iterations: int = ITERATIONS
    checkpoint: Path | None = None
    smallest_budget: int = 1

    @property
    def name(self) -> str:
        """Of the algorithm."""
        if isinstance(self.algorithm, str):
            return self.algorithm
        return type(self.algorithm).__name__

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


def _own(module: str, method: str) -> Any:
    """A class of search methods, imported where it is asked for."""
    return getattr(import_module(f"ematwin.estimation.{module}"), method)


OWN = (
    Algorithm(
        "multistart",
        "Sobol samples, then Levenberg-Marquardt (default for the brushless actuator)",
        "this project, docs/results.md",
        "ematwin",
        partial(_own, "multistart", "Multistart"),
        departures="none",
        tuned_on="mixtures of faults with seeds of their own, of which some stand in tables of "
        "docs/results.md",
    ),
    Algorithm(
        "levenberg-marquardt",
        "Levenberg-Marquardt from the starts that the kind of actuator suggests",
        "Levenberg (1944), Marquardt (1963)",
        "ematwin",
        partial(_own, "local", "LocalDescent"),
        aliases=("lm", "descent"),
        departures="forward differences in batches; bounds by projection (Bertsekas 1982)",
    ),
    Algorithm(
        "scipy-trf",
        "Trust-region least squares of SciPy from random starts",
        "scipy.optimize.least_squares; Branch, Coleman and Li (1999)",
        "scipy",
        partial(_own, "local", "ScipyLeastSquares"),
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
    return tuple(dict.fromkeys(method_name(name) for name in found))


def method_name(text: str) -> str:
    """The name that a name or alias means.

    Raises
    ------
    InputError
        If there is no such method; the message suggests the closest.
    MissingExtraError
        If its library is not installed.
    """
    wanted = text.strip().lower().replace("_", "-")
    for one in OWN:
        if wanted in (one.name, *one.aliases):
            return one.name
    from ematwin.optimizers.registry import find

    found = find(text)
    found.factory()
    return found.name


def named(
    algorithm: str | Search | Optimizer | Any,
    *,
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    checkpoint: str | Path | None = None,
) -> Search:
    """The search that a name, a search, an optimiser or a factory of one means.

    Raises
    ------
    InputError
        If there is none of that name, or it keeps no checkpoint.
    """
    if hasattr(algorithm, "run") and not isinstance(algorithm, Optimizer):
        return cast(Search, algorithm)
    name = method_name(algorithm) if isinstance(algorithm, str) else ""
    for one in OWN:
        if one.name != name:
            continue
        if checkpoint is not None:
            raise InputError(
                f"The method {name} takes about a second and keeps no checkpoint; leave it out, "
                "or choose a population method such as de."
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
