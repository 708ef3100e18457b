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
_NUMBERS = ("covariate", "errors", "features")  # of `Measurements`, as columns of its file
_SAME = 0.05  # standard deviations of a feature: what one recording may differ by if fitted again
# standard deviation of the size of a fault: of a taught one in sizes of the recordings with it, of
# others in healthy standard deviations
_TAUGHT, _SIZES = np.ones(1), np.geomspace(1.0, 100.0, 9)
_APART = np.array([0.0, 0.1, 0.3, 1.0])  # shift in other directions, over that along one
# standard deviation between occasions, of each fault and of the level of each channel, in healthy
# ones: an assumption, since healthy recordings of one occasion cannot show it
DRIFT = 1.0


def plain(values: np.ndarray) -> Any:
    """Numbers for a file."""
    return np.vectorize(lambda x: float(f"{x:.9g}"))(values).tolist()


def basis(covariate: np.ndarray, scale: float | None) -> np.ndarray:
    """(N, 3) array: 1, u, u^2 - 1 with u the covariate in units of ``scale``.

    Without a scale there is no covariate: (N, 1) array of ones.
    """
    if scale is None:
        return np.ones((len(covariate), 1))
    u = np.asarray(covariate) / scale
    return np.column_stack([np.ones_like(u), u, u * u - 1.0])


def fit_mean(covariate: np.ndarray, scale: float | None, values: np.ndarray) -> np.ndarray:
    """Coefficients (3, F) or (1, F) of the mean of values (N, F); slope and curvature by ridge."""
    terms = basis(covariate, scale)
    held = np.diag([0.0, 1.0, 1.0][: terms.shape[1]]) * _RIDGE * len(covariate)
    return np.linalg.solve(terms.T @ terms + held, terms.T @ values)


@dataclass(frozen=True)
class Population:
    """Healthy mean and spread of each of F features."""

    scale: float | None  # of the covariate, SI; None if there is none
    # (3, F) array, of the mean over the covariate; (1, F) without one
    coefficients: np.ndarray
    # (F,) arrays, standard deviations between recordings of a run, and between the means of runs
    within: np.ndarray
    between: np.ndarray

    @classmethod
    def of(
        cls,
        features: np.ndarray,
        covariate: np.ndarray,
        groups: np.ndarray,
        scale: float | None,
        errors: np.ndarray | float = 0.0,
        cut: np.ndarray | bool = False,
    ) -> "Population":
        """The population of N recordings with features (N, F); ``groups`` (N,) number their runs.

        Standard ``errors`` (F,), zero where not known, stand in where each run has a single
        recording, and are the least that counts of features (``cut`` (F,) of bool) whose healthy
        value lies on a bound, which hides a part of their scatter.
        """
        coefficients = fit_mean(covariate, scale, features)
        rest = features - basis(covariate, scale) @ coefficients
        members = [rest[groups == g] for g in np.unique(groups)]
        inner = sum(((m - m.mean(0)) ** 2).sum(0) for m in members)
        freedom = len(rest) - len(members)
        within = np.sqrt(np.maximum(inner / max(1, freedom), 1e-24))
        within = np.where(cut | (freedom == 0), np.maximum(within, errors), within)
        means = np.stack([m.mean(0) for m in members])
        # the scatter of the means of runs holds a share of that within; not taking it off keeps
        # few runs, which may agree by chance, from promising that no run differs
        between = (means**2).sum(0) / max(1, len(members) - 1)
        return cls(scale, coefficients, within, np.sqrt(between))

    def mean(self, covariate: np.ndarray) -> np.ndarray:
        """Healthy mean (N, F) at covariates (N,)."""
        return basis(covariate, self.scale) @ self.coefficients

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (F,) of a recording of another healthy run."""
        return np.hypot(self.within, self.between)

    def scores(self, features: np.ndarray, covariate: np.ndarray) -> np.ndarray:
        """Features (N, F) in standard deviations from the healthy mean at their covariate."""
        return (features - self.mean(covariate)) / self.spread


@dataclass(frozen=True)
class Measurements:
    """Measurements on N recordings."""

    features: np.ndarray  # (N, F)
    errors: np.ndarray  # (N, M), standard errors of the magnitudes, at most their ranges
    covariate: np.ndarray  # (N,), SI; zeros for a kind that has none
    groups: np.ndarray  # (N,), number of the run (and condition) of each recording
    runs: tuple[str, ...]  # name of the run of each recording
    statistics: Mapping[str, np.ndarray]  # (N,) by name, measurements beside the twin

    @property
    def names(self) -> list[str]:
        """The runs, each once."""
        return list(dict.fromkeys(self.runs))

    def of_run(self, name: str) -> np.ndarray:
        """(N,) array of bool: the recordings of a run."""
        return np.array([run == name for run in self.runs])

    def part(self, members: np.ndarray) -> "Measurements":
        """Some of them, members (N,) of bool, or their numbers."""
        rows = {name: getattr(self, name)[members] for name in (*_NUMBERS, "groups")}
        statistics = {name: values[members] for name, values in self.statistics.items()}
        runs = tuple(np.array(self.runs)[members].tolist())
        return Measurements(runs=runs, statistics=statistics, **rows)

    def holds(self, features: np.ndarray, kinds: Sequence[str]) -> bool:
        """Whether one of the rows (K, F) is here already, as when a file is given twice.

        Bands are not compared: those here are of a discrepancy without the run's own share.
        """
        columns = [n for n, kind in enumerate(kinds) if kind != "band"]
        here = self.features[:, columns]
        near = _SAME * (here.std(0) + 1e-9 * np.abs(here).max(0) + 1e-12)
        return any(bool((np.abs(here - row) <= near).all(1).any()) for row in features[:, columns])

    def with_more(self, other: "Measurements") -> "Measurements":
        """These and others, whose runs have other names."""
        common = [name for name in self.statistics if name in other.statistics]
        return Measurements(
            np.vstack([self.features, other.features]),
            np.vstack([self.errors, other.errors]),
            np.r_[self.covariate, other.covariate],
            np.r_[self.groups, other.groups + int(self.groups.max()) + 1],
            self.runs + other.runs,
            {name: np.r_[self.statistics[name], other.statistics[name]] for name in common},
        )

    def as_table(self) -> dict[str, Any]:
        """For a file."""
        return {
            "runs": list(self.runs),
            "groups": self.groups.tolist(),
            **{name: plain(getattr(self, name)) for name in _NUMBERS},
            "statistics": {name: plain(values) for name, values in self.statistics.items()},
        }

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> "Measurements":
        """What `as_table` gave; raises `ValueError` unless it has as many rows everywhere."""
        numbers = {name: np.array(table[name], dtype=float) for name in _NUMBERS}
        statistics = {name: np.array(v, dtype=float) for name, v in table["statistics"].items()}
        groups, runs = np.array(table["groups"], dtype=int), tuple(map(str, table["runs"]))
        for one in (groups, *numbers.values(), *statistics.values()):
            if len(one) != len(runs) or not np.isfinite(one).all():
                raise ValueError("its healthy recordings are not complete")
        return cls(groups=groups, runs=runs, statistics=statistics, **numbers)


@dataclass(frozen=True)
class Signature:
    """Mean scores of recordings with a known fault, over the covariate.

    It is a statistic of one rig, and carries over to another as far as that is alike.
    """

    fault: str
    coefficients: np.ndarray  # (3, F) or (1, F), as in `Population`
    source: str  # of the data it was learnt from


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
    """How F scores of healthy recordings scatter."""

    between: np.ndarray  # (F, F), covariance of the means of a run
    within: np.ndarray  # (F, F), of recordings of a run around its mean
    motions: float  # recordings of a run, of which ``between`` is the mean
    freedom: int  # number of recordings that it was learnt from

    @classmethod
    def of(cls, scores: np.ndarray, groups: np.ndarray, drifts: np.ndarray) -> "Scatter":
        """From scores (N, F) of healthy recordings, each run (``groups``, (N,)) by the others.

        ``drifts`` (D, F) are shifts by a standard deviation between occasions.
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
    """What may have happened to an actuator: faults that can be named, and other changes."""

    def __init__(self, scatter: Scatter, directions: Sequence[Direction]) -> None:
        self._scatter, self._directions = scatter, directions
        self._spread = cache(self._spread_of)

    def posterior(self, scores: np.ndarray, terms: np.ndarray) -> Posterior:
        """Probabilities of the causes, from the mean of scores (N, F) of recordings.

        ``terms`` (N, 3) or (N, 1) are `basis` at their covariates.
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
