"""How a healthy population is learnt: discrepancy of the twin, healthy runs, signatures.

Bands of the residual of a run come from a discrepancy learnt from the other runs: a share of the
run's noise in it would make its bands look quieter than the bands of a later run.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.local import LocalDescent
from ematwin.models.base import Monitoring
from ematwin.models.comparison import Comparison
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.measure import Bench, Fit, Measured
from ematwin.monitoring.population import Population, Signature, basis, fit_mean
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.numerics.signals import spread_of

_MOST_MEANS = 24  # mean recordings that the nominal parameters are fitted to
_OUTLIER = 4.0  # robust standard deviations of the logarithm of a run's distance
_LEAST_SCATTER = 0.2  # of that logarithm: few runs may agree by chance
_WILD = 4.0  # healthy deviations that a feature counts at most: one alone makes no run odd
_ODD = 8.0  # robust standard deviations of what is reported


def with_spread(calibration: PopulationCalibration, measured: Measured) -> Baseline:
    """The baseline with how far healthy runs differ, as the population says."""
    spread = calibration.population.spread.tolist()
    return replace(
        calibration.baseline,
        scatter=dict(zip(calibration.layout.magnitudes, spread, strict=False)),
        misfit=float(np.median([one.misfit for one in measured.estimates])),
        recordings=len(calibration.healthy.names),
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
    scores = calibration.scores(measured)
    return Signature(
        said.strip(), fit_mean(measured.covariate, calibration.scale, scores),
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
    healthy, kinds = calibration.healthy, np.array(calibration.layout.kinds)
    members = [healthy.of_run(run) for run in healthy.names]
    if len(members) < 4:
        return  # of three, nobody can tell which one is the odd one

    def refuse(n: int, how: str) -> None:
        raise RecordError(
            f"Run {healthy.names[n]} is unlike the other {len(members) - 1} healthy runs: {how}. "
            "If it is faulty or of another rig, leave it out."
        )

    sizes = np.minimum(np.abs(calibration.tested), _WILD)
    # of all features, and of the residual alone: magnitudes may differ from day to day so much
    # that a rough run does not stand out
    for columns in (np.ones(len(kinds), dtype=bool), kinds != "model"):
        levels = np.array([np.log(sizes[own][:, columns].mean()) for own in members])
        for n, (away, spread) in enumerate(_beside_others(levels)):
            if away > _OUTLIER * max(spread, _LEAST_SCATTER):
                refuse(n, f"it lies {np.exp(away):.1f} times as far from the others as they lie "
                       "from each other")  # fmt: skip
    for k, one in enumerate(calibration.quantities):
        levels = np.array([calibration.values[own, k].mean() for own in members])
        for n, (away, spread) in enumerate(_beside_others(levels)):
            if abs(away) > max(_ODD * spread, one.least):
                unit, scale = ("%", 100.0) if one.logarithmic else (one.unit, one.scale)
                shown = f"{scale * abs(away):.2g} {unit}".rstrip()
                refuse(n, f"its {one.name} differs from theirs by {shown}")


def _beside_others(levels: np.ndarray) -> list[tuple[float, float]]:
    """How far each is from the median of the others, and the robust spread of these."""
    found = []
    for n, own in enumerate(levels):
        rest = np.delete(levels, n)
        middle = float(np.median(rest))
        found.append((float(own - middle), float(spread_of(np.abs(rest - middle)))))
    return found


def without_own_share(
    bench: Bench, measured: Measured, fit: Fit, scale: float | None, runs: Sequence[str]
) -> np.ndarray:
    """Features (N, F) with the bands that are left of a discrepancy from the other runs alone.

    Magnitudes and means need none of it: a run adds to the discrepancy as much as it takes from the
    mean of the population.

    Parameters
    ----------
    fit : with the discrepancy of all recordings
    runs : name of the run of each recording
    """
    features, layout = measured.features.copy(), bench.layout
    bands = [n for n, kind in enumerate(layout.kinds) if kind == "band"]
    left = fit.residuals.reshape(len(features), -1)
    for run in dict.fromkeys(runs):
        own = np.array(runs) == run
        mean = fit_mean(fit.covariate[~own], scale, left[~own])
        rest = left[own] - basis(fit.covariate[own], scale) @ mean
        for n, row in zip(np.flatnonzero(own), rest, strict=True):
            magnitudes = dict(zip(layout.magnitudes, features[n], strict=False))
            residuals = row.reshape(len(layout.channels), -1)
            features[n, bands] = layout.values(magnitudes, residuals)[bands]
    return features
