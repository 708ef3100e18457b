"""Measurements of each healthy recording, kept so that later runs can be added to them.

Every run both teaches and tests. The population is learnt from all of them, and the thresholds from
each run judged by the others. Bands of the residual of a run come from a discrepancy learnt from
the other runs: a share of the run's noise in it would make its bands look quieter than the bands of
a later run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.base import Model, Reported
from ematwin.models.parameter_set import ParameterSet
from ematwin.monitoring.features import Layout
from ematwin.monitoring.index import health_index, prediction_bound
from ematwin.monitoring.measure import Fit, Measured, reported_values, statistics_of
from ematwin.monitoring.population import Population, basis, fit_mean

_OUTLIER = 4.0  # robust standard deviations of the logarithm of a run's index
_LEAST_SCATTER = 0.2  # of that logarithm: few runs may agree by chance
_SAME = 0.05  # standard deviations of a feature: what one recording may differ by if fitted again
_ODD = 8.0  # robust standard deviations of what is reported


@dataclass(frozen=True)
class HealthyRuns:
    """Measurements on N healthy recordings.

    Attributes
    ----------
    features : (N, F) array
    values : (N, R) array, of the reported quantities
    errors : (N, M) array, standard errors of the magnitudes, at most their ranges
    covariate : (N,) array, SI; zeros for a kind that has none
    groups : (N,) array, number of the run (and condition) of each recording
    runs : name of the run of each recording
    statistics : (N,) arrays by name, measurements beside the twin
    """

    features: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    covariate: np.ndarray
    groups: np.ndarray
    runs: tuple[str, ...]
    statistics: Mapping[str, np.ndarray]

    @classmethod
    def of(
        cls,
        model: Model,
        actuator: ParameterSet,
        layout: Layout,
        measured: Measured,
        features: np.ndarray,
        runs: Sequence[str],
    ) -> "HealthyRuns":
        """From measurements; ``features`` in place of theirs."""
        errors = [
            [min(one.standard_errors[name], one.ranges[name]) for name in layout.magnitudes]
            for one in measured.estimates
        ]
        return cls(
            features,
            reported_values(model, actuator, layout, features),
            np.array(errors, dtype=float).reshape(len(features), len(layout.magnitudes)),
            measured.covariate,
            measured.groups,
            tuple(runs),
            statistics_of(measured.estimates),
        )

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
            np.vstack([self.values, other.values]),
            np.vstack([self.errors, other.errors]),
            np.r_[self.covariate, other.covariate],
            np.r_[self.groups, other.groups + int(self.groups.max()) + 1],
            self.runs + other.runs,
            {name: np.r_[self.statistics[name], other.statistics[name]] for name in common},
        )

    def as_table(self, digits: int) -> dict[str, Any]:
        """For a file."""

        def plain(values: np.ndarray) -> Any:
            return np.vectorize(lambda x: float(f"{x:.{digits}g}"))(values).tolist()

        return {
            "runs": list(self.runs),
            "groups": [int(g) for g in self.groups],
            "covariate": plain(self.covariate),
            "errors": plain(self.errors),
            "values": plain(self.values),
            "statistics": {name: plain(values) for name, values in self.statistics.items()},
            "features": plain(self.features),
        }

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> "HealthyRuns":
        """What `as_table` gave; raises `ValueError` unless it has as many rows everywhere."""
        found = cls(
            features=np.array(table["features"], dtype=float),
            values=np.array(table["values"], dtype=float),
            errors=np.array(table["errors"], dtype=float),
            covariate=np.array(table["covariate"], dtype=float),
            groups=np.array(table["groups"], dtype=int),
            runs=tuple(str(run) for run in table["runs"]),
            statistics={name: np.array(v, dtype=float) for name, v in table["statistics"].items()},
        )
        arrays = [found.features, found.values, found.errors, found.covariate, found.groups]
        arrays += list(found.statistics.values())
        if any(len(one) != len(found.runs) or not np.isfinite(one).all() for one in arrays):
            raise ValueError("its healthy recordings are not complete")
        return found


@dataclass(frozen=True)
class Learning:
    """Populations and thresholds from healthy runs of one actuator.

    Parameters
    ----------
    model, actuator, layout : as calibrated
    healthy : HealthyRuns
    scale : of the covariate, as in `Population`
    """

    model: Model
    actuator: ParameterSet
    layout: Layout
    healthy: HealthyRuns
    scale: float | None

    def populations(self, members: np.ndarray) -> tuple[Population, Population]:
        """Of the features, and of the reported quantities, from members (N,) of bool."""
        magnitudes = self.layout.magnitudes
        unknowns = {one.name: one for one in self.model.faults(self.actuator)}
        on_bound = np.array([
            unknowns[name].healthy in (unknowns[name].lower, unknowns[name].upper)
            for name in magnitudes
        ], dtype=bool)  # fmt: skip
        errors = np.zeros(len(self.layout.names))
        errors[: len(magnitudes)] = np.sqrt((self.healthy.errors[members] ** 2).mean(0))
        cut = np.zeros(errors.shape, dtype=bool)
        cut[: len(magnitudes)] = on_bound
        population = self._population(self.healthy.features, members, errors, cut)
        reported = self.model.monitoring.reported(self.model, self.actuator)
        own_errors, own_cut = np.zeros(len(reported)), np.zeros(len(reported), dtype=bool)
        for n, one in enumerate(reported):
            if one.name in magnitudes:
                place = magnitudes.index(one.name)
                own_errors[n], own_cut[n] = errors[place], cut[place]
                if one.logarithmic:
                    own_errors[n] /= float(np.exp(self.healthy.values[members, n].mean()))
        return population, self._population(self.healthy.values, members, own_errors, own_cut)

    def _population(
        self, features: np.ndarray, members: np.ndarray, errors: np.ndarray, cut: np.ndarray
    ) -> Population:
        healthy = self.healthy
        return Population.of(
            features[members], healthy.covariate[members], healthy.groups[members], self.scale,
            errors, cut,
        )  # fmt: skip

    def tested(self, held_back: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores (K, F) and groups (K,) of recordings, each judged by a population without it.

        ``held_back`` (N,) of bool: those judged by all others; where there are none, each run is
        judged by the others.
        """
        healthy = self.healthy
        folds = [held_back]
        if not held_back.any():
            folds = [healthy.of_run(name) for name in healthy.names]
        scores = []
        for own in folds:
            population, _ = self.populations(~own)
            scores.append(population.scores(healthy.features[own], healthy.covariate[own]))
        return np.vstack(scores), np.concatenate([healthy.groups[own] for own in folds])

    def limits(
        self, scores: np.ndarray, groups: np.ndarray, rate: float
    ) -> tuple[float, float, float]:
        """Thresholds of a motion and of a run, and recordings in a run."""
        kinds, runs = self.layout.kinds, np.unique(groups)
        means = np.stack([scores[groups == g].mean(0) for g in runs])
        return (
            prediction_bound(health_index(scores, kinds), groups, rate),
            prediction_bound(health_index(means, kinds), runs, rate),
            len(scores) / len(runs),
        )

    def check_outliers(self) -> None:
        """Refuse a run that is unlike all others: it may be a faulty one among the healthy."""
        healthy, kinds = self.healthy, self.layout.kinds
        runs = healthy.names
        if len(runs) < 4:
            return  # of three, nobody can tell which one is the odd one
        means = []
        for run in runs:
            own = healthy.of_run(run)
            population, _ = self.populations(~own)
            scores = population.scores(healthy.features[own], healthy.covariate[own])
            groups = healthy.groups[own]
            means.append(np.stack([scores[groups == g].mean(0) for g in np.unique(groups)]))
        # of all features, and of the residual alone: magnitudes may differ from day to day so much
        # that a rough run does not stand out
        residual = [n for n, kind in enumerate(kinds) if kind != "model"]
        for columns in (list(range(len(kinds))), residual):
            of = [kinds[n] for n in columns]
            level = np.array([
                np.log(np.mean(health_index(one[:, columns], of))) for one in means
            ])  # fmt: skip
            for n, run in enumerate(runs):
                rest = np.delete(level, n)
                away = level[n] - float(np.median(rest))
                if away > _OUTLIER * max(_robust_spread(rest), _LEAST_SCATTER):
                    raise _odd_one(
                        run, len(runs), f"it lies {np.exp(away):.1f} times as far from the others "
                        "as they lie from each other",
                    )  # fmt: skip
        for k, one in enumerate(self.model.monitoring.reported(self.model, self.actuator)):
            if not np.isfinite(one.least):
                continue
            level = np.array([healthy.values[healthy.of_run(run), k].mean() for run in runs])
            for n, run in enumerate(runs):
                rest = np.delete(level, n)
                away = abs(level[n] - float(np.median(rest)))
                if away > max(_ODD * _robust_spread(rest), one.least):
                    raise _odd_one(
                        run, len(runs), f"its {one.name} differs from theirs by {_shown(one, away)}"
                    )


def without_own_share(
    layout: Layout,
    measured: Measured,
    fit: Fit,
    scale: float | None,
    runs: Sequence[str],
    learning: np.ndarray,
) -> np.ndarray:
    """Features (N, F) with the bands that are left of a discrepancy from the other runs alone.

    Magnitudes and means need none of it: a run adds to the discrepancy as much as it takes from the
    mean of the population.

    Parameters
    ----------
    fit : with the discrepancy of all recordings that are learnt from
    runs : name of the run of each recording
    learning : (N,) array of bool, recordings that the discrepancy was learnt from
    """
    features = measured.features.copy()
    bands = [n for n, kind in enumerate(layout.kinds) if kind == "band"]
    left = np.concatenate([fit.residuals[name] for name in layout.channels], axis=1)
    of_run = np.array(runs)
    for run in dict.fromkeys(of_run[learning].tolist()):
        own = learning & (of_run == run)
        others = learning & ~own
        if not bands or not others.any():
            continue
        missed = basis(fit.covariate[own], scale) @ fit_mean(
            fit.covariate[others], scale, left[others]
        )
        for n, row in zip(np.flatnonzero(own), left[own] - missed, strict=True):
            residuals = dict(zip(layout.channels, np.split(row, len(layout.channels)), strict=True))
            magnitudes = dict(zip(layout.magnitudes, features[n], strict=False))
            features[n, bands] = layout.values(magnitudes, residuals)[bands]
    return features


def _shown(one: Reported, away: float) -> str:
    """A difference as people read it."""
    if one.logarithmic:
        return f"{100.0 * away:.2g} %"
    return f"{one.scale * away:.2g} {one.unit}".rstrip()


def _robust_spread(values: np.ndarray) -> float:
    """Standard deviation by the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _odd_one(run: str, count: int, how: str) -> RecordError:
    return RecordError(
        f"Run {run} is unlike the other {count - 1} healthy runs: {how}. If it is faulty or of "
        "another rig, leave it out."
    )
