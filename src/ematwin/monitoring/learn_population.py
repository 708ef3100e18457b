"""How a healthy population is learnt: discrepancy of the twin, healthy runs, signatures.

Bands of the residual of a run come from a discrepancy learnt from the other runs: a share of the
run's noise in it would make its bands look quieter than the bands of a later run.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.baseline import Baseline, NominalParameter
from ematwin.estimation.local import LocalDescent
from ematwin.models.base import Monitoring, Reported
from ematwin.models.comparison import Comparison
from ematwin.monitoring.calibration_report import CalibrationReport
from ematwin.monitoring.features import Layout
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.measure import Bench, Fit, Measured, statistics_of
from ematwin.monitoring.population import HealthyRuns, Population, Signature, basis, fit_mean
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.numerics.signals import spread_of

_MOST_MEANS = 24  # mean recordings that the nominal parameters are fitted to
_OUTLIER = 4.0  # robust standard deviations of the logarithm of a run's distance
_LEAST_SCATTER = 0.2  # of that logarithm: few runs may agree by chance
_WILD = 4.0  # healthy deviations that a feature counts at most: one alone makes no run odd
_ODD = 8.0  # robust standard deviations of what is reported


def healthy_runs(
    layout: Layout, measured: Measured, features: np.ndarray, runs: Sequence[str]
) -> HealthyRuns:
    """Healthy runs from measurements; ``features`` in place of theirs."""
    errors = [
        [min(one.standard_errors[name], one.ranges[name]) for name in layout.magnitudes]
        for one in measured.estimates
    ]
    return HealthyRuns(
        features,
        np.array(errors, dtype=float).reshape(len(features), len(layout.magnitudes)),
        measured.covariate,
        measured.groups,
        tuple(runs),
        statistics_of(measured.estimates),
    )


def with_spread(calibration: PopulationCalibration, measured: Measured) -> Baseline:
    """The baseline with how far healthy runs differ, as the population says."""
    spread = calibration.population.spread.tolist()
    return replace(
        calibration.baseline,
        scatter=dict(zip(calibration.layout.magnitudes, spread, strict=False)),
        misfit=float(np.median([one.misfit for one in measured.estimates])),
        recordings=len(calibration.healthy.names),
    )


def report_on(
    calibration: PopulationCalibration,
    parameters: list[NominalParameter],
    tied: list[tuple[str, ...]],
    notes: list[str],
) -> CalibrationReport:
    """Report a calibration whose healthy runs were kept."""
    reported = calibration.reported
    runs = calibration.healthy.names
    return CalibrationReport(
        calibration,
        parameters,
        tied,
        runs,
        {
            one.name: (float(reported.within[n]), float(reported.between[n]))
            for n, one in enumerate(calibration.quantities)
        },
        tuple(notes),
    )


def restated(one: Signature, before: Population, after: Population) -> Signature:
    """A signature in the scores of another population over the same covariate."""
    raw = one.coefficients * before.spread + before.coefficients
    return replace(one, coefficients=(raw - after.coefficients) / after.spread)


def signature(calibration: PopulationCalibration, fault: str, recordings: Given) -> Signature:
    """What recordings with a known fault look like; ``fault`` as in `calibrate`."""
    given = recordings_of(recordings, calibration.actuator)
    measured = calibration.measure(given)
    runs = ", ".join(dict.fromkeys(one.run for one in given))
    said, colon, remark = fault.partition(":")
    return Signature.of(
        said.strip(), calibration.scores(measured), measured.covariate, calibration.scale,
        f"{len(given)} motions{colon}{remark}, runs {runs}",
    )  # fmt: skip


def evenly(items: Sequence[Any] | np.ndarray, most: int) -> list[Any]:
    """So many of the items at most, evenly chosen."""
    places = np.linspace(0, len(items) - 1, min(len(items), most))
    return [items[n] for n in np.unique(np.round(places).astype(int))]


def mean_recordings(bench: Bench) -> list[Comparison]:
    """The mean recording of each run and condition, evenly chosen where there are many.

    More than `_MOST_MEANS` make the fit slow, not better.
    """
    means = []
    for group in evenly(np.unique(bench.groups), _MOST_MEANS):
        members = [bench.comparisons[n] for n in np.flatnonzero(bench.groups == group)]
        means.append(members[0].averaged(members[1:]))
    return means


def with_discrepancy(bench: Bench) -> tuple[Fit, np.ndarray, float | None]:
    """The last fit, the discrepancy of the twin over the covariate, and the covariate's scale."""
    fit = bench.fit(search=LocalDescent())  # healthy ones lie in the valley of health
    scale = None
    if Monitoring.of(bench.model).covariate is not None:
        scale = float(np.sqrt((fit.covariate**2).mean())) or 1.0
    discrepancy = np.zeros(1)
    for _ in range(2):  # of discrepancy and values in turn
        left = fit.residuals.reshape(len(fit.found), -1)
        discrepancy = discrepancy + fit_mean(fit.covariate, scale, left)
        fit = bench.fit(discrepancy, scale, fit)
    return fit, discrepancy, scale


def check_outliers(calibration: PopulationCalibration) -> None:
    """Refuse a run that is unlike all others: it may be a faulty one among the healthy."""
    healthy, kinds = calibration.healthy, calibration.layout.kinds
    runs = healthy.names
    if len(runs) < 4:
        return  # of three, nobody can tell which one is the odd one
    away_from_others = np.minimum(np.abs(calibration.tested), _WILD)
    # of all features, and of the residual alone: magnitudes may differ from day to day so much
    # that a rough run does not stand out
    every = np.ones(len(kinds), dtype=bool)
    for columns in (every, np.array(kinds) != "model"):
        level = np.array([
            np.log(away_from_others[healthy.of_run(run)][:, columns].mean()) for run in runs
        ])  # fmt: skip
        for n, run in enumerate(runs):
            rest = np.delete(level, n)
            away = level[n] - float(np.median(rest))
            if away > _OUTLIER * max(_robust_spread(rest), _LEAST_SCATTER):
                raise _odd_one(
                    run, len(runs), f"it lies {np.exp(away):.1f} times as far from the others "
                    "as they lie from each other",
                )  # fmt: skip
    for k, one in enumerate(calibration.quantities):
        if not np.isfinite(one.least):
            continue
        level = np.array([calibration.values[healthy.of_run(run), k].mean() for run in runs])
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
) -> np.ndarray:
    """Features (N, F) with the bands that are left of a discrepancy from the other runs alone.

    Magnitudes and means need none of it: a run adds to the discrepancy as much as it takes from the
    mean of the population.

    Parameters
    ----------
    fit : with the discrepancy of all recordings
    runs : name of the run of each recording
    """
    features = measured.features.copy()
    bands = [n for n, kind in enumerate(layout.kinds) if kind == "band"]
    left = fit.residuals.reshape(len(features), -1)
    of_run = np.array(runs)
    for run in dict.fromkeys(runs):
        own = of_run == run
        others = ~own
        missed = basis(fit.covariate[own], scale) @ fit_mean(
            fit.covariate[others], scale, left[others]
        )
        for n, row in zip(np.flatnonzero(own), left[own] - missed, strict=True):
            residuals = row.reshape(len(layout.channels), -1)
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
    return float(spread_of(np.abs(values - np.median(values))))


def _odd_one(run: str, count: int, how: str) -> RecordError:
    return RecordError(
        f"Run {run} is unlike the other {count - 1} healthy runs: {how}. If it is faulty or of "
        "another rig, leave it out."
    )
