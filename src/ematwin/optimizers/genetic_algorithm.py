"""Genetic algorithm, with encoding, selection, crossover and mutation as values.

Holland (1973), Genetic Algorithms and the Optimal Allocation of Trials, SIAM J. Comput. 2(2),
88-105: parents are chosen by their fitness, pairs exchange parts of their strings, single places
mutate.

`HOLLAND` is that form: bits, parents in proportion to fitness, one-point crossover, children in
their parents' places. Holland gives no numbers; crossover of 0.6 of the pairs and mutation of 0.001
of the bits are from De Jong (1975), An Analysis of the Behavior of a Class of Genetic Adaptive
Systems, thesis, University of Michigan, plan R1, as Goldberg (1989) reports them.

The defaults depart from it:

Departure: Holland chooses parents in proportion to a positive fitness to be maximised; a cost to be
minimised has no such scale, so parents win tournaments instead (Goldberg and Deb 1991).
Departure: Holland's children replace their parents. Here the best of parents and children survive
(mu + lambda), as the ESREL paper words it: "the best individuals of the previous one".
Departure: real encoding is later than Holland. Its crossover and mutation are those that Deb made
to act on numbers as crossover and mutation act on bits: Deb and Agrawal (1995), Deb and Goyal
(1996).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ematwin.errors import InputError, whole_number
from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer, probability


@dataclass(frozen=True)
class Roulette:
    """Selection in proportion to fitness: Holland's, with independent turns of a wheel.

    A cost becomes a fitness as in Goldberg (1989), Genetic Algorithms, p. 76: how far it lies below
    the worst cost of the generation. A cost that is not finite has no fitness.
    """

    def select(self, rng: np.random.Generator, costs: FloatArray, count: int) -> np.ndarray:
        """(count,) indices; all alike where no individual is fitter than another."""
        known = np.isfinite(costs)
        fitness = np.where(known, np.max(costs, where=known, initial=-np.inf) - costs, 0.0)
        wheel = np.cumsum(fitness if np.any(fitness > 0.0) else np.ones(len(costs)))
        places = np.searchsorted(wheel, rng.random(count) * wheel[-1], side="right")
        return np.minimum(places, len(costs) - 1)


@dataclass(frozen=True)
class Tournament:
    """Selection: the best of ``size`` individuals drawn at random (Goldberg and Deb 1991)."""

    size: int = 4

    def __post_init__(self) -> None:
        whole_number(self.size, "The size of a tournament", 1)

    def select(self, rng: np.random.Generator, costs: FloatArray, count: int) -> np.ndarray:
        """(count,) indices of the winners."""
        rounds = -(-count * self.size // len(costs))
        # Everyone is drawn equally often, so that no good individual is missed by chance.
        orders = np.concatenate([rng.permutation(len(costs)) for _ in range(rounds)])
        drawn = orders[: count * self.size].reshape(count, self.size)
        return drawn[np.arange(count), np.argmin(costs[drawn], axis=1)]


@dataclass(frozen=True)
class SimulatedBinary:
    """Crossover of real numbers that spreads children as one-point crossover of bits does.

    Deb and Agrawal (1995), Complex Systems 9, 115-148; bounded form as in Deb's later programs.
    A pair is crossed as a whole, one spread for all variables, so that its children lie on the
    line through the parents (Muehlenbein and Schlierkamp-Voosen 1993, Evol. Comput. 1, 25-49, "line
    recombination"); or variable by variable, with parents changing places in each. The first
    follows directions that are not parallel to an axis, the second mixes good variables.
    """

    eta: float = 1.0  # not negative; larger keeps children nearer to their parents
    probability: float = 0.9  # share of pairs that are crossed
    whole: float = 0.8  # share of crossed pairs that are crossed as a whole

    def __post_init__(self) -> None:
        if not self.eta >= 0.0:
            raise InputError(f"The eta of a crossover must not be negative, received {self.eta}.")
        probability(self.probability, "share of pairs crossed")
        probability(self.whole, "share of pairs crossed as a whole")

    def cross(
        self, rng: np.random.Generator, box: Box, first: FloatArray, second: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Make two children of each pair."""
        pairs = (len(first), 1)
        whole = rng.random(pairs) < self.whole
        low, high = np.minimum(first, second), np.maximum(first, second)
        crossed = (rng.random(pairs) < self.probability) & (high - low > 1e-14 * box.span)
        gap = np.where(crossed, high - low, 1.0)
        u = np.where(whole, rng.random(pairs), rng.random(first.shape))
        lower = (low + high - self._spread(u, (low - box.lower) / gap) * gap) / 2.0
        upper = (low + high + self._spread(u, (box.upper - high) / gap) * gap) / 2.0
        swapped = np.where(whole, first > second, rng.random(first.shape) < 0.5)
        one = np.where(swapped, upper, lower)
        other = np.where(swapped, lower, upper)
        return (box.clip(np.where(crossed, one, first)), box.clip(np.where(crossed, other, second)))

    def _spread(self, u: FloatArray, room: FloatArray) -> FloatArray:
        """Spread factor, limited so that the child stays within ``room`` gaps of its parent."""
        power = 1.0 / (self.eta + 1.0)
        alpha = 2.0 - (1.0 + 2.0 * room) ** -(self.eta + 1.0)
        scaled = u * alpha
        base = np.where(scaled <= 1.0, scaled, 1.0 / np.maximum(2.0 - scaled, 1e-300))
        return base**power


@dataclass(frozen=True)
class Polynomial:
    """Mutation of real numbers by a bounded polynomial distribution.

    Deb and Goyal (1996), Computer Science and Informatics 26(4), 30-45.
    """

    eta: float = 20.0  # larger makes smaller steps

    def mutate(self, rng: np.random.Generator, box: Box, points: FloatArray) -> FloatArray:
        """Points with one variable of each moved, on average."""
        rows, columns = np.nonzero(rng.random(points.shape) < 1.0 / box.dimension)
        u = rng.random(rows.size)
        x, span = points[rows, columns], box.span[columns]
        down = u < 0.5
        room = np.where(down, x - box.lower[columns], box.upper[columns] - x) / span
        power = self.eta + 1.0
        base = np.where(down, 2.0 * u, 2.0 * (1.0 - u))
        step = 1.0 - (base + (1.0 - base) * (1.0 - room) ** power) ** (1.0 / power)
        moved = points.copy()
        moved[rows, columns] = x + np.where(down, -step, step) * span
        return box.clip(moved)


@dataclass(frozen=True)
class Real:
    """A string is the point itself, one number a place."""

    crossover: SimulatedBinary = field(default_factory=SimulatedBinary)
    mutation: Polynomial = field(default_factory=Polynomial)

    def sample(self, rng: np.random.Generator, box: Box, count: int) -> np.ndarray:
        """(count, d) uniform points."""
        return box.sample(rng, count)

    def breed(
        self, rng: np.random.Generator, box: Box, first: np.ndarray, second: np.ndarray
    ) -> np.ndarray:
        """Cross, then mutate."""
        children = np.concatenate(self.crossover.cross(rng, box, first, second))
        return self.mutation.mutate(rng, box, children)

    def decode(self, strings: np.ndarray, box: Box) -> FloatArray:
        """Give the strings themselves."""
        return strings


@dataclass(frozen=True)
class Binary:
    """A string is ``bits`` bits a variable, in Gray code by default."""

    # 1 to 52: the box becomes a grid of 2**bits points a variable, both bounds on it
    bits: int = 16
    # Gray code: neighbouring grid points differ in one bit; in plain code, in up to all
    gray: bool = True
    crossed: float = 0.9  # share of pairs that exchange all bits after a random place
    # share of bits that mutation flips; None: one bit of each individual on average
    flipped: float | None = None

    def __post_init__(self) -> None:
        whole_number(self.bits, "The number of bits a variable", 1)
        if self.bits > 52:
            raise InputError(f"A variable can have at most 52 bits, received {self.bits}.")
        probability(self.crossed, "share of pairs crossed")

    def sample(self, rng: np.random.Generator, box: Box, count: int) -> np.ndarray:
        """(count, d * bits) random bits."""
        return rng.random((count, box.dimension * self.bits)) < 0.5

    def breed(
        self, rng: np.random.Generator, box: Box, first: np.ndarray, second: np.ndarray
    ) -> np.ndarray:
        """Exchange bits, then flip some."""
        pairs, bits = first.shape
        exchanged = np.arange(bits) >= rng.integers(1, max(bits, 2), size=(pairs, 1))
        exchanged = exchanged & (rng.random((pairs, 1)) < self.crossed)
        children = np.concatenate(
            [np.where(exchanged, second, first), np.where(exchanged, first, second)]
        )
        share = 1.0 / bits if self.flipped is None else self.flipped
        flips: np.ndarray = rng.random(children.shape) < share
        return children ^ flips

    def decode(self, strings: np.ndarray, box: Box) -> FloatArray:
        """(N, d) points: the codes 0 to 2**bits - 1 span the box evenly."""
        codes = strings.reshape(len(strings), box.dimension, self.bits)
        if self.gray:
            codes = np.bitwise_xor.accumulate(codes, axis=2)
        weights = 2.0 ** np.arange(self.bits - 1, -1, -1)
        return box.clip(box.lower + (codes @ weights) / (2.0**self.bits - 1.0) * box.span)


HOLLAND: dict[str, Any] = {
    "encoding": Binary(gray=False, crossed=0.6, flipped=0.001),
    "selection": Roulette(),
    "elitist": False,
}
"""Arguments of the first form: Holland (1973), rates of De Jong (1975)."""


class GeneticAlgorithm(PopulationOptimizer):
    """Genetic algorithm.

    ``iterations`` changes nothing: the method has no schedule.

    Parameters
    ----------
    encoding : ``Real()`` (default) or ``Binary()``: how a point is written as a string
    selection : ``Tournament()`` (default) or ``Roulette()``
    elitist : bool, the best of parents and children survive (mu + lambda); else all children do
    """

    minimum_population = 2

    def __init__(
        self,
        box: Box,
        *,
        encoding: Real | Binary = Real(),
        selection: Tournament | Roulette = Tournament(),
        elitist: bool = True,
        **settings: int,
    ) -> None:
        super().__init__(box, **settings)
        self.encoding, self.selection, self.elitist = encoding, selection, elitist
        self.parents: np.ndarray = np.empty((0, box.dimension))
        self.costs = np.empty(0)
        self._children: np.ndarray = np.empty((0, box.dimension))

    def _start(self) -> FloatArray:
        self._children = self.encoding.sample(self.rng, self.box, self.population)
        return self.encoding.decode(self._children, self.box)

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        if self.iteration == 0 or not self.elitist:
            self.parents, self.costs = self._children, costs
            return
        pool = np.concatenate([self.parents, self._children])
        pool_costs = np.concatenate([self.costs, costs])
        survivors = np.argsort(pool_costs, kind="stable")[: len(costs)]  # parents first if equal
        self.parents, self.costs = pool[survivors], pool_costs[survivors]

    def _move(self) -> FloatArray:
        pairs = -(-self.population // 2)
        chosen = self.selection.select(self.rng, self.costs, 2 * pairs)
        first, second = self.parents[chosen[:pairs]], self.parents[chosen[pairs:]]
        children = self.encoding.breed(self.rng, self.box, first, second)
        self._children = children[: self.population]
        return self.encoding.decode(self._children, self.box)
