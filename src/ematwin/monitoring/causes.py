"""The posterior of causes: health, a fault by name, or a change without one.

Estimates of a recording, in healthy standard deviations, scatter within a run, between runs and
between occasions. A cause shifts them. A named fault shifts them along its direction, by an unknown
size, and at most as much in other directions. A change without a name shifts one quantity, or any.
Directions come from physics (the quantity that a fault raises) and from recordings with a known
fault. An actuator is healthy with a prior probability of one half. The other causes share the rest
evenly, and so do the orders of magnitude of their sizes.

The scatter of healthy recordings is itself an estimate, so that densities are Student's t with as
many degrees of freedom as there were recordings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ematwin.estimation.constants import BEFOREHAND

# standard deviation of the size of a fault: of a taught one in sizes of the recordings with it, of
# others in healthy standard deviations
_TAUGHT, _SIZES = np.ones(1), np.geomspace(1.0, 100.0, 9)
_APART = np.array([0.0, 0.1, 0.3, 1.0])  # shift in other directions, over that along one
# standard deviation between occasions, of each fault and of the level of each channel, in healthy
# ones: an assumption, since healthy recordings of one occasion cannot show it
DRIFT = 1.0


class Direction(NamedTuple):
    """Where a cause shifts the estimates."""

    fault: str  # its name, or `UNNAMED`
    coefficients: np.ndarray  # (3, F) or (1, F), shift of the scores over the covariate
    taught: bool = False  # whether recordings with this fault showed it
    # (F,) array of bool, scores that it may also shift each by itself, by about the size
    around: np.ndarray | None = None


class Posterior(NamedTuple):
    """Probabilities of the causes."""

    probabilities: Mapping[str, float]  # by fault, and of a change without a name (`UNNAMED`)
    healthy: float  # probability that nothing has changed
    distance: float  # from the healthy mean, over what healthy ones have on average
    likeness: frozenset[str]  # faults that fit the taught direction better than the physical one


@dataclass(frozen=True)
class Scatter:
    """How scores of healthy recordings scatter."""

    between: np.ndarray  # (F, F), covariance of the means of a run
    within: np.ndarray  # (F, F), of recordings of a run around its mean
    motions: float  # recordings of a run, of which ``between`` is the mean
    freedom: int  # number of recordings that it was learnt from

    @classmethod
    def of(cls, scores: np.ndarray, groups: np.ndarray, drifts: np.ndarray) -> "Scatter":
        """From scores (N, F) of healthy recordings, each run judged by the others.

        Parameters
        ----------
        groups : (N,) array, number of the run (and condition) of each recording
        drifts : (D, F) array, shifts by a standard deviation between occasions
        """
        members = [scores[groups == g] for g in np.unique(groups)]
        means = np.stack([own.mean(0) for own in members])
        apart = len(scores) - len(members)
        inner = np.concatenate([own - own.mean(0) for own in members])
        within = np.zeros((scores.shape[1],) * 2)
        if apart:
            within = _shrunk(inner * np.sqrt(len(scores) / apart))
        between = _shrunk(means) + drifts.T @ drifts
        return cls(between, within, len(scores) / len(members), len(scores))

    def of_motions(self, count: int) -> np.ndarray:
        """Covariance (F, F) of a mean of recordings."""
        more = max(1.0 / count - 1.0 / self.motions, 0.0)
        return self.between + more * self.within


class Causes:
    """What may have happened to an actuator.

    Parameters
    ----------
    scatter : of healthy recordings
    directions : of the faults that can be named, and of other changes
    """

    def __init__(self, scatter: Scatter, directions: Sequence[Direction]) -> None:
        self._scatter, self._directions = scatter, directions
        self._spread = cache(self._spread_of)

    def posterior(self, scores: np.ndarray, terms: np.ndarray) -> Posterior:
        """Probabilities of the causes.

        Parameters
        ----------
        scores : (N, F) array, of recordings that are judged together, by their mean
        terms : (N, 3) or (N, 1) array, `basis` at their covariates
        """
        count, x, term = len(scores), scores.mean(0), terms.mean(0)
        variance, axes = self._spread(count)
        square = float(((x @ axes) ** 2 / variance).sum())
        healthy = float(self._logs(square, np.log(variance).sum())) + np.log(BEFOREHAND)
        found: dict[str, list[tuple[float, bool]]] = {}
        for n, one in enumerate(self._directions):
            shift, ways = term @ one.coefficients, found.setdefault(one.fault, [])
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

    def _spread_of(
        self, count: int, size: float = 0.0, direction: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Variances (F,) and axes (F, F) of healthy ones, and of a shift around a direction."""
        around = self._directions[direction].around if size else None
        shifted = 0.0 if around is None else np.diag(size**2 * around)
        variance, axes = np.linalg.eigh(self._scatter.of_motions(count) + shifted)
        return variance, axes

    def _around(self, x: np.ndarray, shift: np.ndarray, direction: int, count: int) -> float:
        """Logarithm of the mean density over sizes of a shift (F,), and of scores around it."""
        each = []
        for size in _SIZES.tolist():
            variance, axes = self._spread(count, size, direction)
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
        freedom, count = self._scatter.freedom, len(self._scatter.between)
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
