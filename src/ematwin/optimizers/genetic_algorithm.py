"""Genetic algorithm, with the encoding as a value: real numbers or strings of bits.

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

from ematwin.errors import InputError
from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer, whole_number
from ematwin.optimizers.genetic_operators import (
    Polynomial,
    Roulette,
    SimulatedBinary,
    Tournament,
    probability,
)


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
        whole_number(self.bits, "number of bits a variable", 1)
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
        selection: Tournament | Roulette = Tournament(),  # noqa: B008
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
