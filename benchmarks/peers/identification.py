"""How soon a recording is identified: ematwin's default search beside other packages' methods.

All are given the same `Problem` on one thread and are stopped when the best point so far is within
Err% < 1 of the injected faults (direction as an angle), at 10,000 evaluations, or when their time
is over. Nobody sees the injected faults but the stop watch.

Methods that follow slopes search the coordinates of `Problem.chart`, as ematwin's does, and get
point and Jacobian of differences from one batch; methods that sample search the unit box in batches
of 32, which fill the lanes. Starts are uniform. ematwin's search alone knows the smoothed problem,
which is part of its method. DFO-LS asks for one point at a time, which takes as long as 32.
"""

import importlib
import logging
import statistics
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from benchmarks.identification import random_faults
from benchmarks.peers.measure import Line, Part, missing, number, progress, versions

from ematwin import simulate
from ematwin.estimation.multistart import Multistart
from ematwin.estimation.problem import Problem
from ematwin.models.bldc.faults import error_percent_wrapped

SEED = 2026
VECTORS = 5
LIMIT = 1.0  # Err%
BUDGET = 10_000
SECONDS = 15.0
BATCH = 32
STEP = 5e-3  # of differences, share of a range: ematwin's own first


class Ended(BaseException):
    """Reached, or budget or time spent; no method catches it."""


class Watch:
    """Counts evaluations and says when the best point so far is right.

    Attributes
    ----------
    evaluations : int
    seconds : float, infinite until the faults were found
    """

    def __init__(self, injected: np.ndarray, patience: float, budget: int) -> None:
        self.injected, self.patience, self.budget = injected, patience, budget
        self.evaluations, self.seconds = 0, float("inf")
        self._best: dict[tuple[Any, ...], float] = {}
        self._started = time.perf_counter()

    def note(self, comparisons: tuple[Any, ...], points: np.ndarray, costs: np.ndarray) -> None:
        """A batch was evaluated; smoothed problems have a best point of their own."""
        self.evaluations += len(points)
        elapsed = time.perf_counter() - self._started
        n = int(np.argmin(costs))
        if costs[n] < self._best.get(comparisons, np.inf):
            self._best[comparisons] = float(costs[n])
            if error_percent_wrapped(points[n], self.injected) < LIMIT:
                self.seconds = elapsed
                raise Ended
        if self.evaluations >= self.budget or elapsed > self.patience:
            raise Ended


class Watched(Problem):
    """A problem that tells its watch what is evaluated; so do its smoothed versions."""

    watch: Watch | None = None

    def costs(self, points: np.ndarray) -> np.ndarray:
        """As of the problem."""
        costs = super().costs(points)
        if self.watch is not None:
            self.watch.note(self.comparisons, points, costs)
        return costs

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """As of the problem."""
        residuals = super().residuals(points)
        if self.watch is not None:
            self.watch.note(self.comparisons, points, np.einsum("bk,bk->b", residuals, residuals))
        return residuals


class Slopes:
    """Residuals (K,) and Jacobian (K, d) at a point (d,) of the chart, from one batch."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self.chart = problem, problem.chart
        self._at = np.full(len(problem.names), np.nan)

    def _go(self, z: np.ndarray) -> None:
        if np.array_equal(z, self._at):
            return
        # away from the nearer bound
        step = np.where(z > 0.5 * (self.chart.lower + self.chart.upper), -STEP, STEP)
        rows = np.concatenate([z[None], z + np.diag(step)])
        found = self._problem.residuals(self.chart.to_values(rows))
        self._residuals, self._jacobian = found[0], ((found[1:] - found[0]) / step[:, None]).T
        self._at = np.array(z)

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(K,)."""
        self._go(z)
        return self._residuals

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """(K, d)."""
        self._go(z)
        return self._jacobian

    def half_squares(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Half the cost, its gradient, and the Hessian of Gauss and Newton."""
        r, j = self.residuals(z), self.jacobian(z)
        return 0.5 * float(r @ r), j.T @ r, j.T @ j


def starts(problem: Problem, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Points of the chart, uniform in values, without end."""
    while True:
        values = problem.chart.from_unit(rng.random((1, len(problem.names))))
        yield problem.chart.from_values(values)[0]


def ematwin_multistart(problem: Problem, seed: int) -> None:
    found = Multistart().run(problem, budget=BUDGET, seed=seed, report=lambda spent, cost: None)
    if found.stopped == "interrupted":  # it answers Ctrl-C with the best so far
        raise KeyboardInterrupt


def scipy_least_squares(problem: Problem, seed: int) -> None:
    from scipy.optimize import least_squares

    slopes, chart = Slopes(problem), problem.chart
    for start in starts(problem, np.random.default_rng(seed)):
        least_squares(
            slopes.residuals, start, slopes.jacobian, (chart.lower, chart.upper), max_nfev=50
        )


def pypesto_with(problem: Problem, seed: int, optimizer: Any, objective: Any) -> None:
    """pyPESTO's own multistart, a hundred starts at a time."""
    import pypesto
    import pypesto.optimize

    logging.getLogger("pypesto").setLevel(logging.CRITICAL)
    rng, chart = np.random.default_rng(seed), problem.chart
    points = starts(problem, rng)
    while True:
        guesses = np.array([next(points) for _ in range(100)])
        task = pypesto.Problem(
            objective, chart.lower, chart.upper, x_guesses=guesses, copy_objective=False
        )
        pypesto.optimize.minimize(
            task, optimizer=optimizer, n_starts=len(guesses), progress_bar=False
        )


def pypesto_scipy(problem: Problem, seed: int) -> None:
    import pypesto
    import pypesto.optimize

    slopes = Slopes(problem)
    objective = pypesto.Objective(res=slopes.residuals, sres=slopes.jacobian)
    optimizer = pypesto.optimize.ScipyOptimizer("ls_trf", options={"max_nfev": 50})
    pypesto_with(problem, seed, optimizer, objective)


def pypesto_fides(problem: Problem, seed: int) -> None:
    import pypesto
    import pypesto.optimize

    objective = pypesto.Objective(fun=Slopes(problem).half_squares, grad=True, hess=True)
    optimizer = pypesto.optimize.FidesOptimizer(options={"maxiter": 50}, verbose=logging.CRITICAL)
    pypesto_with(problem, seed, optimizer, objective)


def dfo_ls(problem: Problem, seed: int) -> None:
    import dfols

    chart = problem.chart

    def residuals(z: np.ndarray) -> np.ndarray:
        return problem.residuals(chart.to_values(z[None]))[0]

    np.random.seed(seed)  # noqa: NPY002  DFO-LS draws from numpy's global generator
    for start in starts(problem, np.random.default_rng(seed)):
        dfols.solve(
            residuals, start, bounds=(chart.lower, chart.upper), rhobeg=0.1, rhoend=1e-4,
            maxfun=300, do_logging=False,
        )  # fmt: skip


def pints_with(problem: Problem, seed: int, name: str) -> None:
    """An optimiser of PINTS by its ask and tell."""
    import pints

    np.random.seed(seed)  # noqa: NPY002  PINTS draws from numpy's global generator
    d = len(problem.names)
    bounds = pints.RectangularBoundaries(np.zeros(d), np.ones(d))
    while True:
        first = np.random.random(d)  # noqa: NPY002
        optimizer = getattr(pints, name)(first, np.full(d, 0.3), bounds)
        optimizer.set_population_size(BATCH)
        for _ in range(BUDGET // BATCH):
            # XNES also asks for points outside; they cost much, as PINTS has it
            points = np.asarray(optimizer.ask())
            inside = np.clip(points, 0.0, 1.0)
            costs = problem.costs(problem.chart.from_unit(inside))
            outside = (points != inside).any(axis=1)
            optimizer.tell(np.where(outside | ~np.isfinite(costs), 1e10, costs))
            if optimizer.stop():
                break


def cma_alone(problem: Problem, seed: int) -> None:
    import cma

    rng, d = np.random.default_rng(seed), len(problem.names)
    while True:
        options = {
            "bounds": [0.0, 1.0], "popsize": BATCH, "verbose": -9,
            "seed": int(rng.integers(1, 2**31)),
        }  # fmt: skip
        strategy = cma.CMAEvolutionStrategy(rng.random(d), 0.3, options)
        while not strategy.stop():
            points = strategy.ask()
            costs = problem.costs(problem.chart.from_unit(np.array(points)))
            strategy.tell(points, np.minimum(costs, 1e10).tolist())


@dataclass(frozen=True)
class Method:
    """A method: its name, what it needs and how it is run, without end, on a problem."""

    name: str
    run: Callable[[Problem, int], None]
    modules: tuple[str, ...] = ()
    install: str = ""


METHODS = (
    Method("ematwin, multistart", ematwin_multistart),
    Method("scipy least_squares, multistart", scipy_least_squares),
    Method("pyPESTO multistart, scipy trf", pypesto_scipy, ("pypesto",), "pypesto"),
    Method("pyPESTO multistart, fides", pypesto_fides, ("pypesto", "fides"), "pypesto fides"),
    Method("DFO-LS, multistart", dfo_ls, ("dfols",), "DFO-LS"),
    Method("PINTS, CMA-ES", partial(pints_with, name="CMAES"), ("pints", "cma"), "pints cma"),
    Method("PINTS, xNES", partial(pints_with, name="XNES"), ("pints",), "pints"),
    Method("cma, restarts", cma_alone, ("cma",), "cma"),
)


def one_run(method: Method, problem: Watched, watch: Watch, seed: int) -> None:
    """Run a method until its watch ends it."""
    problem.watch = watch
    try:
        with warnings.catch_warnings(action="ignore"):
            method.run(problem, seed)
    except Ended:
        pass
    finally:
        problem.watch = None


def run(*, quick: bool, repeats: int) -> Part:
    """Identify each recording by each method; `repeats` beyond the vectors are not made."""
    del repeats  # the spread is over the vectors
    vectors = random_faults(1 if quick else VECTORS, SEED)
    patience, budget = (3.0, 1000) if quick else (SECONDS, BUDGET)
    problems: list[Watched] = []
    for faults in vectors:
        problem = Watched.of(simulate("reference", faults=faults), "servo48", threads=1)
        assert isinstance(problem, Watched)
        problem.costs(np.tile(problem.healthy, (BATCH, 1)))  # compiled before anything is timed
        problem.residuals(np.tile(problem.healthy, (BATCH, 1)))
        problems.append(problem)
    lines: list[Line] = []
    remarks = []
    own: list[float] = []
    for method in METHODS:
        absent = [missing(module, method.install, method.name) for module in method.modules]
        if sentence := next(filter(None, absent), ""):
            remarks.append(sentence)
            continue
        for module in method.modules:
            importlib.import_module(module)
        found = []
        for n, (faults, problem) in enumerate(zip(vectors, problems, strict=True), 1):
            progress(f"identification: {method.name}, recording {n} of {len(vectors)}")
            watch = Watch(faults.vector, patience, budget)
            one_run(method, problem, watch, seed=n)
            found.append(watch)
        times = tuple(watch.seconds for watch in found)
        own = own or list(times)
        ratios = tuple(
            t / mine for t, mine in zip(times, own, strict=True) if np.isfinite([t, mine]).any()
        )
        reached = [watch for watch in found if np.isfinite(watch.seconds)]
        spent = [watch.evaluations if watch in reached else float("inf") for watch in found]
        lines.append(
            Line(
                method.name, times, ratios,
                (number(statistics.median(spent)), f"{len(reached)} of {len(found)}"),
                not method.modules and method is METHODS[0],
            )
        )  # fmt: skip
    remarks += [f"Recording {n}: {faults!r}." for n, faults in enumerate(vectors, 1)]
    return Part(
        "Identifying a recording",
        f"Seconds until the best point so far is within Err% < {LIMIT:g} of the injected faults; "
        f"{len(vectors)} noiseless recordings of the reference model, default scenario, one "
        f"thread, at most {budget} evaluations and {patience:g} s each. Recordings that were not "
        "solved count as infinite.",
        "s",
        "times ematwin",
        ("evaluations, median", "solved"),
        tuple(lines),
        tuple(remarks),
        versions("scipy", "pypesto", "fides", "DFO-LS", "pints", "cma"),
    )
