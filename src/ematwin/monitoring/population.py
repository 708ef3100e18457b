"""The healthy population, and the probabilities of what may have changed.

Features of healthy recordings may depend on a covariate that is unknown and estimated with each
recording, such as the load; their healthy mean is a parabola in it. Their spread has two parts:
between recordings of one run, and between runs.

The posterior is of causes: health, a fault by name, or a change without one. Features, in healthy
standard deviations (scores), scatter within a run, between runs and between occasions. A cause
shifts them. A named fault shifts them along its direction, by an unknown size, and at most as much
in other directions. A change without a name shifts one quantity, or any. Directions come from
physics (the quantity that a fault raises) and from recordings with a known fault. An actuator is
healthy with a prior probability of one half. The other causes share the rest evenly, and so do the
orders of magnitude of their sizes.

The scatter of healthy recordings is itself an estimate, so that densities are Student's t with as
many degrees of freedom as there were recordings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ematwin.estimation.constants import BEFOREHAND

_RIDGE = 0.05  # of the number of recordings: holds the parabola down where one load was recorded
# standard deviation of the size of a fault: of a taught one in sizes of the recordings with it, of
# others in healthy standard deviations
_TAUGHT, _SIZES = np.ones(1), np.geomspace(1.0, 100.0, 9)
_APART = np.array([0.0, 0.1, 0.3, 1.0])  # shift in other directions, over that along one


@dataclass(frozen=True)
class Parabola:
    """F values as they depend on the covariate; constant for a kind that has none."""

    scale: float  # of the covariate, SI
    coefficients: np.ndarray  # (3, F) array, of 1, u and u^2 - 1 with u the covariate over scale

    @classmethod
    def of(cls, values: np.ndarray, covariate: np.ndarray, scale: float) -> "Parabola":
        """The mean of values (N, F) at covariates (N,); slope and curvature by ridge."""
        terms = _terms(covariate, scale)
        held = np.diag([0.0, 1.0, 1.0]) * _RIDGE * len(terms)
        return cls(scale, np.linalg.solve(terms.T @ terms + held, terms.T @ values))

    def at(self, covariate: np.ndarray | float) -> np.ndarray:
        """(N, F) array at covariates (N,); (F,) at one."""
        return _terms(covariate, self.scale) @ self.coefficients


def _terms(covariate: np.ndarray | float, scale: float) -> np.ndarray:
    u = np.asarray(covariate) / scale
    return np.stack([np.ones_like(u), u, u * u - 1.0], axis=-1)


@dataclass(frozen=True)
class Population:
    """Healthy mean and spread of each of F features."""

    mean: Parabola
    # (F,) arrays, standard deviations between recordings of a run, and between the means of runs
    within: np.ndarray
    between: np.ndarray

    @classmethod
    def of(
        cls,
        features: np.ndarray,
        covariate: np.ndarray,
        groups: np.ndarray,
        scale: float,
        least: np.ndarray | float = 0.0,
    ) -> "Population":
        """The population of N recordings with features (N, F); ``groups`` (N,) number their runs.

        ``least`` (F,) is what counts as spread in any case.
        """
        mean = Parabola.of(features, covariate, scale)
        means, inner = _by_group(features - mean.at(covariate), groups)
        within = np.sqrt((inner**2).sum(0) / max(1, len(features) - len(means)))
        # the scatter of the means of runs holds a share of that within; not taking it off keeps
        # few runs, which may agree by chance, from promising that no run differs
        between = np.sqrt((means**2).sum(0) / max(1, len(means) - 1))
        return cls(mean, np.maximum(within, np.maximum(least, 1e-12)), between)

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (F,) of a recording of another healthy run."""
        return np.hypot(self.within, self.between)

    def scores(self, features: np.ndarray, covariate: np.ndarray) -> np.ndarray:
        """Features (N, F) in standard deviations from the healthy mean at their covariate."""
        return (features - self.mean.at(covariate)) / self.spread


def _by_group(rows: np.ndarray, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (G, F) of each group of rows (N, F), and how far rows (N, F) lie from theirs."""
    _, own = np.unique(groups, return_inverse=True)
    means = np.stack([rows[own == g].mean(0) for g in range(own.max() + 1)])
    return means, rows - means[own]


class Direction(NamedTuple):
    """Where a cause shifts the scores."""

    fault: str  # its name, or `UNNAMED`
    shift: Parabola  # of the F scores
    taught: bool = False  # whether recordings with this fault showed it
    # (F,) array of bool, scores that it may also shift each by itself, by about the size
    around: np.ndarray | None = None


class Posterior(NamedTuple):
    """Probabilities of the causes."""

    probabilities: Mapping[str, float]  # by fault, and of a change without a name (`UNNAMED`)
    healthy: float  # probability that nothing has changed
    distance: float  # from the healthy mean, over what healthy ones have on average
    likeness: frozenset[str]  # faults that fit the taught direction better than the physical one


class Causes:
    """What may have happened to an actuator: faults that can be named, and other changes.

    Parameters
    ----------
    scores : (N, F) array, of healthy recordings, each run by the others
    groups : (N,) array, numbers of their runs
    drifts : (D, F) array, shifts by a standard deviation between occasions
    directions : of the causes
    """

    def __init__(
        self,
        scores: np.ndarray,
        groups: np.ndarray,
        drifts: np.ndarray,
        directions: Sequence[Direction],
    ) -> None:
        means, inner = _by_group(scores, groups)
        freedom = max(1, len(scores) - len(means))
        # covariances (F, F) of the means of runs, and of recordings around the mean of their run
        self._between = _shrunk(means) + drifts.T @ drifts
        self._within = _shrunk(inner * np.sqrt(len(scores) / freedom))
        self._motions = len(scores) / len(means)  # recordings in such a mean
        self._freedom = len(scores)
        self._directions = directions
        self._axes = cache(self._axes_of)

    def posterior(self, scores: np.ndarray, covariate: np.ndarray) -> Posterior:
        """Probabilities of the causes, from the mean of scores (N, F) at covariates (N,)."""
        count, x = len(scores), scores.mean(0)
        variance, axes = self._axes(count)
        square = float(((x @ axes) ** 2 / variance).sum())
        healthy = float(self._logs(square, np.log(variance).sum())) + np.log(BEFOREHAND)
        found: dict[str, list[tuple[float, bool]]] = {}
        for n, one in enumerate(self._directions):
            shift, ways = one.shift.at(covariate).mean(0), found.setdefault(one.fault, [])
            if shift.any():
                sizes = _TAUGHT if one.taught else _SIZES
                ways.append((self._along(x @ axes, shift @ axes, sizes, variance), one.taught))
            if one.around is not None:
                ways.append((self._around(x, shift, n, count), False))
        share = np.log((1.0 - BEFOREHAND) / len(found))
        logs = {fault: _mean([own for own, _ in ways]) + share for fault, ways in found.items()}
        total = np.logaddexp.reduce([healthy, *logs.values()])
        return Posterior(
            {fault: float(np.exp(value - total)) for fault, value in logs.items()},
            float(np.exp(healthy - total)),
            float(np.sqrt(square / x.size)),
            frozenset(fault for fault, ways in found.items() if max(ways)[1]),
        )

    def _axes_of(self, count: int, size: float = 0.0, n: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Variances (F,) and axes (F, F) of a mean of recordings, after a change of a size."""
        more = max(1.0 / count - 1.0 / self._motions, 0.0)
        covariance = self._between + more * self._within
        if (around := self._directions[n].around) is not None:
            covariance = covariance + np.diag(size**2 * around)
        variance, axes = np.linalg.eigh(covariance)
        return variance, axes

    def _around(self, x: np.ndarray, shift: np.ndarray, direction: int, count: int) -> float:
        """Logarithm of the mean density over sizes of a shift (F,), and of scores around it."""
        each = []
        for size in _SIZES.tolist():
            variance, axes = self._axes(count, size, direction)
            square = (((x - size * shift) @ axes) ** 2 / variance).sum()
            each.append(self._logs(square, np.log(variance).sum()))
        return _mean(each)

    def _along(
        self, x: np.ndarray, shift: np.ndarray, sizes: np.ndarray, variance: np.ndarray
    ) -> float:
        """Logarithm of the density of a shift (F,) and of shifts in other directions.

        Its size is half normal, with these standard deviations (K,), each as likely.
        """
        from scipy.special import log_ndtr  # takes longer to import than a motion to judge

        size, apart = sizes[:, None, None], _APART[:, None]
        spread = variance + (size * apart) ** 2 * np.mean(shift**2)
        like, long = ((shift * one / spread).sum(-1) for one in (x, shift))
        wider = 1.0 + size[..., 0] ** 2 * long  # by the rank-one update of Sherman and Morrison
        square = (x**2 / spread).sum(-1) - (size[..., 0] * like) ** 2 / wider
        each = self._logs(square, np.log(spread).sum(-1) + np.log(wider))
        # half of the normal distribution: a fault has no negative size
        each += np.log(2.0) + log_ndtr(size[..., 0] * like / np.sqrt(wider))
        return _mean(each)

    def _logs(self, square: Any, log_determinant: Any) -> Any:
        """Logarithms of the density of Student's t, but for a constant."""
        freedom, count = self._freedom, len(self._between)
        return -0.5 * ((freedom + count) * np.log1p(square / freedom) + log_determinant)


def _mean(logs: Any) -> float:
    """Logarithm of the mean of values by their logarithms."""
    return float(np.logaddexp.reduce(logs, axis=None) - np.log(np.size(logs)))


def _shrunk(rows: np.ndarray) -> np.ndarray:
    """Covariance (F, F) of rows (N, F) around zero, drawn towards equal independent ones.

    Ledoit and Wolf (2004), J. Multivar. Anal. 88, 365-411.
    """
    count, size = rows.shape
    sample = rows.T @ rows / count
    target = np.trace(sample) / size * np.eye(size)
    away = float(((sample - target) ** 2).sum())
    noise = (float(((rows**2).sum(1) ** 2).sum()) / count - float((sample**2).sum())) / count
    share = min(1.0, noise / away) if away > 0.0 else 1.0
    return np.asarray((1.0 - share) * sample + share * target)
