"""The promise that every optimiser keeps: ask for a batch, tell its costs.

An optimiser knows a box, a population, the length of its schedule and a seed; it knows no
objective, no budget and no clock. Those belong to the loop (`ematwin.optimizers.loop`), so that
one loop serves every method, on one core or on many.
"""

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ematwin.errors import InputError, MissingExtraError, whole_number

POPULATION = 50
ITERATIONS = 200
"""The settings of the comparison this package follows: ESREL 2020, section 7."""

EXTRA = "bench"  # of the libraries that adapters drive

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Box:
    """The search space: every variable between a lower and an upper bound.

    Parameters
    ----------
    lower, upper : (d,) array, finite, ``lower < upper`` in every variable, any unit

    Raises
    ------
    InputError
        If a bound is missing, not finite, or not below its partner.

    Notes
    -----
    Optimisers work in the user's own coordinates, because several of them are not indifferent to
    where zero lies.
    """

    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        lower = _bound(self.lower, "lower")
        upper = _bound(self.upper, "upper")
        if lower.shape != upper.shape:
            raise InputError(
                f"The bounds differ in length: lower has {lower.size} values, upper has "
                f"{upper.size}. Give one pair per variable."
            )
        bad = np.flatnonzero(~(lower < upper))
        if bad.size:
            k = int(bad[0])
            raise InputError(
                f"Each lower bound must be below its upper bound: variable {k} has "
                f"{lower[k]:g} to {upper[k]:g}. Hold a fixed variable outside the search instead."
            )
        if not np.all(upper / 2 - lower / 2 <= np.finfo(np.float64).max / 2):
            raise InputError("The box is too wide: upper - lower overflows. Rescale the variables.")
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    @property
    def dimension(self) -> int:
        """Number of variables, d."""
        return int(self.lower.size)

    @property
    def span(self) -> FloatArray:
        """(d,) array, upper - lower."""
        return self.upper - self.lower

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """(count, d) points, uniform in the box."""
        return self.clip(self.lower + rng.random((count, self.dimension)) * self.span)

    def clip(self, points: FloatArray) -> FloatArray:
        """Points moved onto the nearest bound, variable by variable."""
        return np.minimum(np.maximum(points, self.lower), self.upper)

    def contains(self, points: FloatArray) -> bool:
        """True if every point lies within the bounds, bounds included."""
        return bool(np.all((points >= self.lower) & (points <= self.upper)))


def _bound(values: ArrayLike, name: str) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"The {name} bounds must be numbers, received {values!r}.") from error
    if array.ndim != 1 or array.size == 0:
        raise InputError(
            f"The {name} bounds must be a list of d numbers, received shape {array.shape}."
        )
    if not np.all(np.isfinite(array)):
        raise InputError(
            f"The {name} bounds must be finite, received {array.tolist()}. "
            "These methods draw their first points uniformly between the bounds."
        )
    array.setflags(write=False)
    return array


class Optimizer(ABC):
    """Ask for a batch of points, tell their costs, until the caller has had enough.

    A class of it is called with ``(box, *, population, iterations, seed)`` and keeps these.
    `PopulationOptimizer` does so, and the bookkeeping of batches.

    Attributes
    ----------
    box : Box
    population : int, rows of every batch
    iterations : int, length of the schedule: the batch number at which a method that narrows its
        search step by step has narrowed it fully; asked on, it holds the end of the schedule
    seed : int

    Notes
    -----
    The promise, which `ematwin.testing.optimizer_contract` checks:

    - ``ask()`` gives a new (N, d) float64 array inside the box, N the same every time if
      ``constant_batch``. Asked twice without a tell between, it gives the same batch again.
    - ``tell(points, costs)`` takes the batch, or its leading rows where a budget ran out: the
      rows left out count as worst. Costs that are NaN or infinite, of either sign, count as worst.
    - The same seed, box, population, iterations and costs give the same batches, bit for bit.
    - Pickled between any two calls and restored, it goes on identically (if ``picklable``).
    """

    picklable: ClassVar[bool] = True
    constant_batch: ClassVar[bool] = True
    minimum_population: ClassVar[int] = 1

    box: Box
    population: int
    iterations: int
    seed: int

    @abstractmethod
    def ask(self) -> FloatArray:
        """Give the points (N, d) whose costs are wanted next; the caller may change them."""

    @abstractmethod
    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Learn the costs (m,) of the batch last asked for, or of its first m rows (m, d).

        `InputError` if there is no batch to answer, or the shapes do not fit it.
        """

    def limits(self) -> FloatArray | None:
        """Give the costs (N,) above which points of the batch last asked for count as worst.

        Infinite where every cost counts; None (default) if the method uses all costs. The loop may
        stop evaluating such a point and tell an infinite cost. A method gives limits only if its
        later batches stay the same, bit for bit.
        """
        return None

    def stop(self) -> str | None:
        """Give a reason to stop that only the method itself can know, else None.

        Budget, target and stagnation are the loop's. The six methods of this package never stop
        of themselves.
        """
        return None

    def close(self) -> None:  # noqa: B027
        """Release what outlives a batch: threads, processes. Most methods hold nothing."""


OptimizerFactory = Callable[..., Optimizer]
"""What can be named: a class of Optimizer, or ``(box, *, population, iterations, seed)``."""


@dataclass(frozen=True)
class Algorithm:
    """An algorithm that can be named."""

    name: str
    title: str
    source: str  # the paper or library that it follows
    origin: str  # "ematwin", the library of an adapter, or the package of an entry point
    load: Callable[[], OptimizerFactory]  # imports no other library
    requires: str | None = None  # package to import; None if it comes with ematwin
    aliases: tuple[str, ...] = ()
    departures: str = "not checked"  # where it leaves its source; "none"
    tuned_on: str = "not known"  # what its settings were chosen on, where not by its source

    @property
    def installed(self) -> bool:
        """Whether the library it needs can be found; nothing is imported."""
        return self.requires is None or importlib.util.find_spec(self.requires) is not None

    def factory(self) -> OptimizerFactory:
        """Give what makes the optimiser; `MissingExtraError` without the library it needs."""
        if not self.installed:
            raise MissingExtraError(str(self.requires), EXTRA, f"The algorithm {self.name!r}")
        return self.load()


class PopulationOptimizer(Optimizer):
    """The bookkeeping that every method of this package shares.

    A method gives ``_learn`` (take in costs), ``_move`` (next batch) and, where it is not uniform
    in the box, ``_start`` (first batch). It finds ``box``, ``population``, ``iterations``,
    ``seed``, ``iteration`` (batches told), ``points`` (N, d) of the batch told last, and ``rng``,
    the source of all chance, in place. Methods that need no more than these have no ``__init__`` of
    their own. ``_learn`` receives costs in which everything that is not finite has become +inf, for
    the whole batch, so that no method needs to know of NaN or of a batch cut short.
    """

    def __init__(
        self, box: Box, *, population: int = POPULATION, iterations: int = ITERATIONS, seed: int = 1
    ) -> None:
        self.box = box
        self.population = whole_number(population, "population", self.minimum_population)
        self.iterations = whole_number(iterations, "iterations", 1)
        self.seed = whole_number(seed, "seed", 0)
        self.iteration = 0
        self.rng = np.random.default_rng(self.seed)
        self.points = np.empty((0, box.dimension))
        self._pending: FloatArray | None = None

    def ask(self) -> FloatArray:
        """Give the batch that waits for its costs, or move on to the next one."""
        if self._pending is None:
            self._pending = self._start() if self.iteration == 0 else self._move()
        return self._pending.copy()

    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Take in the costs of the batch, or of its leading rows."""
        if self._pending is None:
            raise InputError("tell() without a batch to answer: call ask() first.")
        asked, given = self._pending, np.asarray(points, dtype=np.float64)
        values, rows = np.asarray(costs, dtype=np.float64), len(given)
        if given.size == 0 or given.ndim != 2 or not np.array_equal(given, asked[:rows]):
            raise InputError(
                f"tell() takes the batch of shape {asked.shape} or its first rows, unchanged and "
                f"in order, received other points, of shape {given.shape}."
            )
        if values.shape != (rows,):
            raise InputError(
                f"tell() takes one cost per point: {rows} points came with costs of "
                f"shape {values.shape}."
            )
        known = np.full(len(asked), np.inf)
        known[:rows] = np.where(np.isfinite(values), values, np.inf)
        self.points = asked
        self._learn(asked, known)
        self._pending = None
        self.iteration += 1

    def _start(self) -> FloatArray:
        return self.box.sample(self.rng, self.population)

    @abstractmethod
    def _learn(self, points: FloatArray, costs: FloatArray) -> None: ...

    @abstractmethod
    def _move(self) -> FloatArray: ...


class RandomSearch(PopulationOptimizer):
    """Points drawn uniformly in the box, the least that a method must beat; it learns nothing.

    Brooks (1958), A Discussion of Random Methods for Seeking Maxima, Oper. Res. 6, 244-251.
    """

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        """Do nothing: the next batch depends on no cost."""

    def limits(self) -> FloatArray:
        """No cost counts; the loop itself keeps the best."""
        return np.full(self.population, -np.inf)

    def _move(self) -> FloatArray:
        return self._start()


def positive(value: float, name: str) -> float:
    """Check that a value is a positive number."""
    if not 0.0 < value < np.inf:
        raise InputError(f"The {name} must be a positive number, received {value!r}.")
    return float(value)


def probability(value: float, name: str) -> float:
    """Check a probability."""
    if not 0.0 <= value <= 1.0:
        raise InputError(f"The {name} must lie in [0, 1], received {value}.")
    return float(value)


def falling(start: float, step: int, iterations: int, power: float) -> float:
    """Give start (1 - (step / iterations)^power): evenly falling to zero where the power is 1."""
    # with a power of 1 in the programs' own order of operations, so that no digit differs
    gone = step if power == 1.0 else iterations * (step / iterations) ** power
    return start - gone * (start / iterations)
