"""The search loop: the only one, for every method and every objective.

It owns the objective, the budget, the clock, the history, the checkpoint and the user's Ctrl-C,
unknown to methods. A checkpoint holds the whole state of a search in one file. It is a
pickle, and a pickle can run any code when it is read: read only your own.
"""

import math
import pickle
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ematwin.errors import EmatwinError, FileError, InputError, whole_number
from ematwin.files import written_whole
from ematwin.optimizers.base import (
    ITERATIONS,
    POPULATION,
    Box,
    FloatArray,
    Optimizer,
    OptimizerFactory,
)
from ematwin.optimizers.registry import resolve
from ematwin.optimizers.result import History, MinimizeResult, Progress

Objective = Callable[[FloatArray], ArrayLike]
"""(N, d) points to (N,) costs; or, with ``vectorized=False``, a (d,) point to its cost.

Lower is better; NaN or infinite means "as bad as can be".
"""


@runtime_checkable
class LimitedObjective(Protocol):
    """An objective that can stop evaluating a point once its cost is known to be too high."""

    def __call__(self, points: FloatArray) -> ArrayLike:
        """(N, d) points to (N,) costs."""
        ...  # pragma: no cover

    def costs_within(self, points: FloatArray, limits: FloatArray) -> ArrayLike:
        """The same costs; those above a limit (N,) may be given as infinite."""
        ...  # pragma: no cover


Evaluate = Callable[[FloatArray, bool, FloatArray | None], FloatArray]
"""Points of a batch, whether it is the first of the search, and limits (N,), to costs."""

_ONE_POINT = (
    "It receives a whole batch, one row per point; for an objective of one point give "
    "vectorized=False."
)
_WHOLE_BATCH = (
    "It receives one point at a time; for an objective of a whole batch leave out vectorized=False."
)

_CHECKPOINT = "ematwin search checkpoint 4"  # its format; 1 was that of 0.2


@dataclass
class _Search:
    """The state of a search between two batches, as a checkpoint holds it."""

    optimizer: Optimizer
    x: FloatArray
    cost: float = math.inf
    evaluations: int = 0
    improved_at: int = 0
    seconds: float = 0.0
    history: list[tuple[int, float]] = field(default_factory=list)

    def ended(self, budget: int, target: float | None, stagnation: int | None) -> str | None:
        """The reason to stop, beside the callback's; None if there is none."""
        if target is not None and self.cost <= target:
            return "target"
        if stagnation is not None and self.evaluations - self.improved_at >= stagnation:
            return "stagnation"
        return "budget" if self.evaluations >= budget else self.optimizer.stop()

    def spend_batch(self, evaluate: Evaluate, budget: int) -> None:
        """Ask for a batch, or for the rest of the budget, evaluate it, and tell its costs."""
        started = time.perf_counter()
        points = self.optimizer.ask()[: budget - self.evaluations]
        limits = self.optimizer.limits()
        if limits is not None:
            # a cost below the best so far always matters: to the history, if not to the method
            limits = np.maximum(limits, self.cost)[: len(points)]
        costs = evaluate(points, self.evaluations == 0, limits)
        ranked = np.where(np.isfinite(costs), costs, np.inf)
        best = int(np.argmin(ranked))
        # The books are closed before the optimiser learns, so that an interrupt during tell()
        # loses nothing that was found.
        self.evaluations += len(points)
        if ranked[best] < self.cost:
            self.x, self.cost = points[best].copy(), float(ranked[best])
            self.improved_at = self.evaluations
        self.history.append((self.evaluations, self.cost))
        self.optimizer.tell(points, costs)
        self.seconds += time.perf_counter() - started


def minimize(
    objective: Objective,
    lower: ArrayLike,
    upper: ArrayLike,
    algorithm: str | Optimizer | OptimizerFactory = "gwo",
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    seed: int = 1,
    *,
    vectorized: bool | None = None,
    budget: int | None = None,
    target: float | None = None,
    stagnation: int | None = None,
    callback: Callable[[Progress], object] | None = None,
    checkpoint: str | PathLike[str] | None = None,
    checkpoint_every: int = 10,
) -> MinimizeResult:
    """Find the point of a box with the least cost.

    Parameters
    ----------
    objective : callable, a (d,) point to its cost, or (N, d) points to (N,) costs; NaN and
        infinity count as worst. A `LimitedObjective` is told which costs
        do not matter (`Optimizer.limits`); the result is the same
    lower, upper : (d,) array
    algorithm : a name of ``ematwin algorithms``; a class or function
        ``(box, *, population, iterations, seed)``, such as
        ``partial(ParticleSwarm, topology=Ring(2))``; or an optimiser not yet asked, whose own
        population, iterations and seed then hold
    population, iterations, seed : int
    vectorized : bool or None, whether the objective takes a whole batch, one row per point; None
        finds out with the first batch
    budget : int or None, evaluations to spend, exactly: the last batch is cut short if need be, and
        methods with a schedule spread it over the budget; None: ``population * iterations``
    target : float or None, stop once the cost is at most this
    stagnation : int or None, stop once so many evaluations in a row have not lowered the cost
    callback : callable or None, receives a `Progress` after each batch; returning True stops the
        search
    checkpoint : path or None, file written during the search; if it is there already, the search
        goes on from it, and gives the same result as one that was never interrupted
    checkpoint_every : int, batches between two writings

    Returns
    -------
    MinimizeResult, also after Ctrl-C: the best found so far, ``stopped == "interrupted"``

    Raises
    ------
    InputError
        If a bound, a number, a name or the objective's answer cannot be used, or no cost was
        finite.
    MissingExtraError
        If the algorithm is another library's, which is not installed.
    FileError
        If the checkpoint cannot be read or written.

    Notes
    -----
    An objective of one point that is called with a batch gives itself away by an error or by the
    shape of its answer, except where a batch has as many points as there are variables: the first
    batch is then evaluated in two pieces. An objective of a batch sees each point once, in order;
    one of a point may be called with the first batch, and then with each of its points.
    """
    box = Box(np.asarray(lower), np.asarray(upper))
    evaluate = _evaluator(objective, vectorized)
    if isinstance(algorithm, Optimizer):
        population, iterations, seed = algorithm.population, algorithm.iterations, algorithm.seed
    population = whole_number(population, "population", 1)
    iterations = whole_number(iterations, "iterations", 1)
    seed = whole_number(seed, "seed", 0)
    if budget is None:
        budget = population * iterations
    budget = whole_number(budget, "budget", 1)
    if not isinstance(algorithm, Optimizer):
        iterations = -(-budget // population)
    checkpoint_every = whole_number(checkpoint_every, "checkpoint_every", 1)
    if target is not None and (not isinstance(target, int | float) or math.isnan(target)):
        raise InputError(f"The target must be a cost to reach, received {target!r}.")
    if stagnation is not None:
        whole_number(stagnation, "stagnation", 1)

    name, optimizer = resolve(
        algorithm, box, population=population, iterations=iterations, seed=seed
    )
    identity = {
        "algorithm": name, "lower bounds": box.lower.tolist(), "upper bounds": box.upper.tolist(),
        "population": population, "iterations": iterations, "seed": seed, "budget": budget,
    }  # fmt: skip
    path = None if checkpoint is None else Path(checkpoint)
    search = _restored(path, identity, optimizer) or _Search(
        optimizer, np.full(box.dimension, np.nan)
    )

    stopped, batches = search.ended(budget, target, stagnation), 0
    try:
        while stopped is None:
            search.spend_batch(evaluate, budget)
            batches += 1
            stopped = search.ended(budget, target, stagnation)
            if path is not None and (stopped is not None or batches % checkpoint_every == 0):
                content = pickle.dumps((_CHECKPOINT, identity, search), pickle.HIGHEST_PROTOCOL)
                with written_whole(path, durable=True, private=True) as draft:
                    draft.write_bytes(content)
            now = search.evaluations, search.cost, search.improved_at, search.seconds, budget
            if callback is not None and callback(Progress(*now)) is True:
                stopped = stopped or "callback"
    except KeyboardInterrupt:
        if search.evaluations == 0:
            raise
        stopped = "interrupted"
    finally:
        search.optimizer.close()
    if not math.isfinite(search.cost):
        raise InputError(
            f"The objective gave no finite cost in {search.evaluations} evaluations. "
            "Check its value at a point known to be good."
        )
    evaluations, costs = zip(*search.history, strict=True)
    return MinimizeResult(
        search.x, search.cost, search.evaluations,
        History(np.array(evaluations), np.array(costs)), stopped, search.seconds, name, seed,
    )  # fmt: skip


def _restored(path: Path | None, identity: dict[str, Any], fresh: Optimizer) -> _Search | None:
    """Read the state of a search from its checkpoint, None if there is none yet."""
    if path is None:
        return None
    if not fresh.picklable:
        raise InputError(
            f"The algorithm {identity['algorithm']} keeps its state in another library and cannot "
            "be written to a checkpoint. Leave the checkpoint out, or choose another algorithm."
        )
    try:
        form, saved, state = pickle.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FileError(f"The checkpoint {path} cannot be read: {error}.") from error
    except Exception as error:
        raise FileError(
            f"The file {path} is not a checkpoint of ematwin, or is damaged."
        ) from error
    if form != _CHECKPOINT:
        raise FileError(
            f"The checkpoint {path} was written by another version of ematwin: {form!r}. "
            "Name another file, or delete this one."
        )
    for key, value in identity.items():
        if saved.get(key) != value:
            raise InputError(
                f"The checkpoint {path} belongs to another search: its {key} is "
                f"{saved.get(key)!r}, but {value!r} was asked for. "
                "Name another file, or delete this one."
            )
    fresh.close()
    return state


def _evaluator(objective: Objective, vectorized: bool | None) -> Evaluate:
    """What evaluates a batch; ``vectorized`` as of `minimize`."""

    def one_by_one(points: FloatArray, first: bool) -> FloatArray:
        return np.array([_costs(objective, point, first).item() for point in points])

    def together(points: FloatArray, first: bool, limits: FloatArray | None) -> FloatArray:
        if limits is not None and not first and isinstance(objective, LimitedObjective):
            return _costs(partial(objective.costs_within, limits=limits), points, False)
        # An objective of one point takes rows for variables and gives one number a column. Where
        # there are as many rows as columns this looks right: a piece of the batch does not.
        square = first and len(points) == points.shape[1] > 1
        pieces = [points[:-1], points[-1:]] if square else [points]
        return np.concatenate([_costs(objective, piece, first) for piece in pieces])

    def evaluate(points: FloatArray, first: bool, limits: FloatArray | None) -> FloatArray:
        nonlocal vectorized
        if vectorized is None:  # a batch if it can take the first one, else point by point
            try:
                costs = together(points, True, None)
                vectorized = True
            except (IndexError, TypeError, ValueError) as error:  # as one of one point gives
                try:
                    costs = one_by_one(points, False)
                except EmatwinError:  # it takes neither: what a batch gave tells more
                    raise error from None
                vectorized = False
            return costs
        return together(points, first, limits) if vectorized else one_by_one(points, first)

    return evaluate


def _costs(objective: Objective, points: FloatArray, first: bool) -> FloatArray:
    """Costs (N,) of a batch (N, d), or of size 1 of a point (d,), checked."""
    single = points.ndim == 1
    advice = _WHOLE_BATCH if single else _ONE_POINT
    try:
        answer = objective(points.copy())
    except (IndexError, TypeError, ValueError) as error:
        if isinstance(error, EmatwinError) or not first:
            raise
        if isinstance(error, IndexError) and not single and len(points) < points.shape[1]:
            raise InputError(
                f"The objective failed at {len(points)} points of {points.shape[1]} variables: "
                f"{error}. {advice}"
            ) from error
        error.add_note(advice)  # this mistake, perhaps; an error of its own stays what it is
        raise
    try:
        costs = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"The objective must give numbers, received {type(answer).__name__}. {advice}"
        ) from error
    if costs.size != 1 if single else costs.shape != (len(points),):
        wanted = "cost: for a point" if single else "cost per point: for points"
        raise InputError(
            f"The objective must give one {wanted} of shape {points.shape} it gave shape "
            f"{costs.shape}. {advice}"
        )
    return costs
