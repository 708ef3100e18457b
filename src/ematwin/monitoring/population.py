"""The healthy population: where features of healthy recordings lie, and how far they scatter.

Features may depend on a covariate that is unknown and estimated with each recording, such as the
load; their healthy mean is a parabola in it. Their spread has two parts: between recordings of one
run, and between runs.

Measurements of each healthy recording are kept, so that later runs can be added to them.

A known fault has a signature: the mean scores of recordings with it. Signatures are statistics of
one rig; they carry over to another only as far as that rig is alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_RIDGE = 0.05  # of the number of recordings: holds the parabola down where one load was recorded
_SAME = 0.05  # standard deviations of a feature: what one recording may differ by if fitted again


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
        """The population of healthy recordings.

        Parameters
        ----------
        features : (N, F) array
        covariate : (N,) array, SI; not looked at without a scale
        groups : (N,) array, number of the run (and condition) of each recording
        scale : of the covariate
        errors : (F,) array, standard errors of the features, which stand in where each run has a
            single recording; zero where not known
        cut : (F,) array of bool, features whose healthy value lies on a bound, which hides a part
            of their scatter: their standard error is the least that counts
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
class HealthyRuns:
    """Measurements on N healthy recordings."""

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

    def holds(self, features: np.ndarray, kinds: Sequence[str]) -> bool:
        """Whether one of the rows (K, F) is here already, as when a file is given twice.

        Bands are not compared: those here are of a discrepancy without the run's own share.
        """
        columns = [n for n, kind in enumerate(kinds) if kind != "band"]
        here = self.features[:, columns]
        near = _SAME * (here.std(0) + 1e-9 * np.abs(here).max(0) + 1e-12)
        return any(bool((np.abs(here - row) <= near).all(1).any()) for row in features[:, columns])

    def with_more(self, other: "HealthyRuns") -> "HealthyRuns":
        """These and others, whose runs have other names."""
        common = [name for name in self.statistics if name in other.statistics]
        return HealthyRuns(
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
            "covariate": plain(self.covariate),
            "errors": plain(self.errors),
            "statistics": {name: plain(values) for name, values in self.statistics.items()},
            "features": plain(self.features),
        }

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> "HealthyRuns":
        """What `as_table` gave; raises `ValueError` unless it has as many rows everywhere."""
        features, errors, covariate = (
            np.array(table[name], dtype=float) for name in ("features", "errors", "covariate")
        )
        groups, runs = np.array(table["groups"], dtype=int), tuple(map(str, table["runs"]))
        statistics = {name: np.array(v, dtype=float) for name, v in table["statistics"].items()}
        for one in (features, errors, covariate, groups, *statistics.values()):
            if len(one) != len(runs) or not np.isfinite(one).all():
                raise ValueError("its healthy recordings are not complete")
        return cls(features, errors, covariate, groups, runs, statistics)


@dataclass(frozen=True)
class Signature:
    """Mean scores of recordings with a known fault, over the covariate."""

    fault: str
    coefficients: np.ndarray  # (3, F) or (1, F), as in `Population`
    source: str  # of the data it was learnt from
