"""Parts of the genetic algorithm: selection, crossover, mutation, each a value.

Each works on all pairs of parents at once. Parents come as two arrays of the same shape, one row a
pair; children come back the same way.
"""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.optimizers.base import Box, FloatArray, whole_number


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
        whole_number(self.size, "size of a tournament", 1)

    def select(self, rng: np.random.Generator, costs: FloatArray, count: int) -> np.ndarray:
        """(count,) indices of the winners."""
        drawn = np.empty((count, self.size), dtype=np.intp)
        rounds = -(-count * self.size // len(costs))
        # Everyone is drawn equally often, so that no good individual is missed by chance.
        orders = [rng.permutation(len(costs)) for _ in range(rounds)]
        drawn[:] = np.concatenate(orders)[: drawn.size].reshape(drawn.shape)
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


def probability(value: float, name: str) -> float:
    """Check a probability."""
    if not 0.0 <= value <= 1.0:
        raise InputError(f"The {name} must lie in [0, 1], received {value}.")
    return float(value)
