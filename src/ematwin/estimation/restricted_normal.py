"""A normal distribution of all unknowns near a minimum, restricted to sets of faults.

Faults that are not in a set are healthy, the others lie within their bounds, and parameters, load
and sensors follow them.
"""

import math

import numpy as np

from ematwin.estimation.constants import ANYTHING, BEFOREHAND
from ematwin.estimation.intervals import conditional
from ematwin.models.chart import Chart
from ematwin.numerics.linear_algebra import bounded_squares, eigen

_JITTER = 1e-9  # of variances, so that what goes together to the last digit can be factorised
_TRIED = 4000  # draws


class RestrictedNormal:
    """A normal distribution of the unknowns (d,) of a chart, in its coordinates.

    Mean (d,) and covariance (d, d) are as if all faults were there and had no bounds; the density
    at ``at`` (d,) is the unit of `log_volume`. ``faults`` are coordinates of each fault that may be
    absent, ``undetermined`` of those with a standard error of more than `ANYTHING`.
    """

    def __init__(
        self, chart: Chart, mean: np.ndarray, covariance: np.ndarray, at: np.ndarray
    ) -> None:
        self._chart, self._mean, self._at = chart, mean, at
        self._covariance = covariance + np.diag(_JITTER * np.diag(covariance))
        self._healthy = chart.from_values(np.array([[one.healthy for one in chart.unknowns]]))[0]
        paired = dict(chart.pairs)
        for pair in chart.pairs:
            self._healthy[list(pair)] = 0.0
        faults = {
            one.name: [n, paired[n]] if n in paired else [n]
            for n, one in enumerate(chart.unknowns)
            if one.role == "fault" and one.direction_of is None
        }
        errors = np.sqrt(np.diag(covariance))
        self.faults = {name: own for name, own in faults.items() if errors[own].max() <= ANYTHING}
        self.undetermined = {name: own for name, own in faults.items() if name not in self.faults}
        self._anything = [n for own in self.undetermined.values() for n in own]
        self._own = np.zeros(len(mean), dtype=bool)  # what may be absent; all else follows
        self._own[[n for places in self.faults.values() for n in places]] = True
        _, self._follows, self._rest = conditional(self._covariance, self._own)

    @property
    def distances(self) -> dict[str, float]:
        """By fault, standard errors from healthy with all faults free."""
        found = {}
        for name, places in self.faults.items():
            away = self._mean[places] - self._healthy[places]
            square = away @ np.linalg.solve(self._covariance[np.ix_(places, places)], away)
            found[name] = math.sqrt(float(square))
        return found

    def log_volume(self) -> float:
        """Logarithm of the integral of the density that is one at its point, without bounds.

        Faults that may be anything are uniform over their range, whose width is one.
        """
        kept = np.ones(len(self._mean), dtype=bool)
        kept[self._anything] = False
        size = np.sqrt(np.diag(self._covariance))[kept]
        values, vectors = eigen(self._covariance[np.ix_(kept, kept)] / np.outer(size, size))
        values = np.maximum(values, _JITTER)
        away = vectors.T @ ((self._at - self._mean)[kept] / size)
        volume = float(np.log(size).sum() + 0.5 * np.log(2.0 * np.pi * values).sum())
        return volume + 0.5 * float(away @ (away / values))

    def evidence(self, names: frozenset[str], least: float = -math.inf) -> float:
        """Logarithm of the probability of a set, but for a constant, or somewhat more.

        Of what lies within its bounds the best point counts, and not its share. No bounds count
        where it is less than ``least`` without them.
        """
        places, mean, left, log = self._given(names)
        if log < least:
            return log
        _, pull = self._within_bounds(places, mean, left)
        return log - 0.5 * float(pull @ pull)

    def best(self, names: frozenset[str]) -> np.ndarray:
        """Values (d,) of the densest point of a set.

        That is ``at`` where the others are healthy there; what may be anything is as there.
        """
        z, absent = self._at.copy(), self._absent(names)
        if not np.array_equal(z[absent], self._healthy[absent]):
            places, mean, left, _ = self._given(names)
            root, pull = self._within_bounds(places, mean, left)
            z[absent], z[places] = self._healthy[absent], mean + root @ pull
            z[~self._own] = self._following(z)
            z[self._anything] = self._at[self._anything]
            z = self._chart.project(z[None])[0]
        return np.asarray(self._chart.to_values(z[None])[0])

    def drawn(self, names: frozenset[str], rng: np.random.Generator) -> tuple[float, np.ndarray]:
        """Logarithm of the probability of a set, but for a constant, and draws z (N, d) of it.

        Draws are around the best point within the bounds, and count by how probable they are. A
        magnitude with a direction is uniform in its range, so that the density of its components
        is divided by the length of the circle.
        """
        chart = self._chart
        places, mean, left, log = self._given(names)
        root, pull = self._within_bounds(places, mean, left)
        normal = rng.standard_normal((_TRIED if places else 1, len(places)))
        at = mean + (normal + pull) @ root.T
        logs = -normal @ pull
        inside = ((at >= chart.lower[places]) & (at <= chart.upper[places])).all(axis=1)
        for pair in chart.pairs:
            if pair[0] in places:
                size = np.hypot(*(at[:, places.index(n)] for n in pair))
                inside &= size <= 1.0
                logs -= np.log(np.maximum(2.0 * np.pi * size, 1e-9))
        inside[np.argmax(logs)] |= not inside.any()  # a corner that no draw hits
        logs[~inside] = -np.inf
        most = float(logs.max())
        shares = np.exp(logs - most)
        picked = rng.choice(len(at), _TRIED // 2, p=shares / shares.sum())
        z = np.tile(self._healthy, (len(picked), 1))
        z[:, places] = at[picked]
        z[:, self._own] = chart.project(z)[:, self._own]
        others = rng.standard_normal((len(z), len(self._rest))) @ self._rest.T
        z[:, ~self._own] = self._following(z) + others
        for n in self._anything:
            z[:, n] = rng.uniform(chart.lower[n], chart.upper[n], len(z))
        log -= 0.5 * float(pull @ pull)
        return log + most + math.log(float(shares.mean())), chart.project(z)

    def _absent(self, names: frozenset[str]) -> list[int]:
        """Coordinates of the faults that are not in a set."""
        return [n for name, own in self.faults.items() if name not in names for n in own]

    def _following(self, z: np.ndarray) -> np.ndarray:
        """Means of all else where faults that may be absent are as in z (d,) or (N, d)."""
        away = z[..., self._own] - self._mean[self._own]
        return np.asarray(self._mean[~self._own] + away @ self._follows.T)

    def _given(self, names: frozenset[str]) -> tuple[list[int], np.ndarray, np.ndarray, float]:
        """Places, mean and covariance of a set where the others are healthy.

        And the logarithm of their density there, times the prior of the set.
        """
        covariance, log = self._covariance, len(names) * math.log(BEFOREHAND / (1.0 - BEFOREHAND))
        places = [n for name, own in self.faults.items() if name in names for n in own]
        absent = self._absent(names)
        mean, left = self._mean[places], covariance[np.ix_(places, places)]
        if absent:
            other = np.linalg.cholesky(covariance[np.ix_(absent, absent)])
            gap = self._healthy[absent] - self._mean[absent]
            both = np.linalg.solve(other, np.c_[gap, covariance[np.ix_(absent, places)]])
            away, across = both[:, 0], both[:, 1:]
            mean, left = mean + across.T @ away, left - across.T @ across
            log -= 0.5 * float(away @ away) + float(np.log(np.diag(other)).sum())
            log -= 0.5 * len(absent) * math.log(2.0 * math.pi)
        return places, mean, left, log

    def _within_bounds(
        self, places: list[int], mean: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Root of a covariance; from the mean to the best point within bounds, in its columns."""
        values, vectors = eigen(covariance)
        sizes, pull = np.sqrt(np.maximum(values, 1e-18)), np.zeros(len(places))
        lower, upper = self._chart.lower[places], self._chart.upper[places]
        inside = np.clip(mean, lower, upper)
        if not np.array_equal(inside, mean):
            scale = (vectors / sizes).T
            target = scale @ (mean - inside)
            pull = scale @ bounded_squares(scale, target, lower - inside, upper - inside) - target
        return vectors * sizes, pull
