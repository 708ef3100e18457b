"""How a healthy population is learnt: discrepancy of the twin, spread, thresholds, signatures."""

from dataclasses import replace
from typing import Any

import numpy as np

from ematwin.estimation.baseline import Baseline
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.nominal import NominalParameter
from ematwin.models.comparison import Comparison
from ematwin.monitoring.calibration_report import CalibrationReport
from ematwin.monitoring.classification import REACH, Signature
from ematwin.monitoring.features import Layout
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.healthy import Learning
from ematwin.monitoring.index import single_reach
from ematwin.monitoring.measure import Bench, Fit, Measured
from ematwin.monitoring.population import Population, fit_mean
from ematwin.monitoring.population_calibration import PopulationCalibration, Thresholds

_MOST_MEANS = 24  # mean recordings that the nominal parameters are fitted to
_ROUNDS = 2  # of discrepancy and values in turn


def with_spread(calibration: PopulationCalibration, measured: Measured) -> Baseline:
    """The baseline with how far healthy runs differ, as the population says."""
    spread = calibration.population.spread.tolist()
    return replace(
        calibration.baseline,
        scatter=dict(zip(calibration.layout.magnitudes, spread, strict=False)),
        misfit=float(np.median([one.misfit for one in measured.estimates])),
        recordings=len(calibration.facts["runs"]),
    )


def learnt_from(learning: Learning, held_back: np.ndarray, rate: float) -> dict[str, Any]:
    """What of a `Calibration` follows from its healthy runs.

    ``held_back`` (N,) of bool: recordings that only set the thresholds.
    """
    kept = learning.healthy
    population, reported = learning.populations(~held_back)
    motion, run, size = learning.limits(*learning.tested(held_back), rate)
    covariate = kept.covariate
    return {
        "population": population,
        "reported": reported,
        "thresholds": Thresholds(motion, run, size, rate),
        "statistics": {
            name: (float(found[~held_back].mean()), float(found[~held_back].std(ddof=1)))
            for name, found in kept.statistics.items()
        },
        "covariate_range": None
        if learning.scale is None
        else (float(covariate.min()), float(covariate.max())),
        "healthy": kept,
    }


def report_on(
    calibration: PopulationCalibration,
    parameters: list[NominalParameter],
    tied: list[tuple[str, ...]],
    notes: list[str],
) -> CalibrationReport:
    """Report a calibration whose healthy runs were kept."""
    back = calibration.facts["held_back"]
    over = calibration.tested().index() > calibration.thresholds.motion
    reported = calibration.reported
    runs = len(calibration.learning.healthy.names)
    return CalibrationReport(
        calibration,
        parameters,
        tied,
        calibration.facts["runs"],
        back,
        {
            one.name: (float(reported.within[n]), float(reported.between[n]))
            for n, one in enumerate(calibration.quantities)
        },
        float(over.mean()),
        (*notes, *_cautions(calibration.thresholds, calibration.layout, runs, len(back))),
    )


def restated(one: Signature, before: Population, after: Population) -> Signature:
    """A signature in the scores of another population over the same covariate."""
    raw = one.coefficients * before.spread + before.coefficients
    return replace(one, coefficients=(raw - after.coefficients) / after.spread)


def signature(calibration: PopulationCalibration, fault: str, recordings: Given) -> Signature:
    """What recordings with a known fault look like; ``fault`` as in `calibrate`."""
    given = recordings_of(recordings, calibration.actuator)
    measured = calibration.measure(given)
    scores = calibration.scores(measured).values
    limited = np.clip(scores, -REACH, REACH)
    runs = ", ".join(dict.fromkeys(one.run for one in given))
    said, colon, remark = fault.partition(":")
    return Signature(
        said.strip(),
        fit_mean(measured.covariate, calibration.population.scale, limited),
        f"{len(given)} motions{colon}{remark}, runs {runs}",
    )


def mean_recordings(bench: Bench, learning: np.ndarray) -> list[Comparison]:
    """The mean recording of each run and condition, evenly chosen where there are many.

    More than `_MOST_MEANS` make the fit slow, not better.
    """
    groups = np.unique(bench.groups[learning])
    places = np.linspace(0, len(groups) - 1, min(len(groups), _MOST_MEANS))
    means = []
    for group in groups[np.unique(np.round(places).astype(int))]:
        members = [bench.comparisons[n] for n in np.flatnonzero(bench.groups == group)]
        means.append(members[0].averaged(members[1:]))
    return means


def with_discrepancy(bench: Bench, learning: np.ndarray) -> tuple[Fit, np.ndarray, float | None]:
    """The last fit, the discrepancy of the twin over the covariate, and the covariate's scale."""
    fit = bench.fit(search=LocalDescent())  # healthy ones lie in the valley of health
    scale = None
    if bench.model.monitoring.covariate is not None:
        scale = float(np.sqrt((fit.covariate[learning] ** 2).mean())) or 1.0
    discrepancy = np.zeros(1)
    for _ in range(_ROUNDS):
        left = np.concatenate(list(fit.residuals.values()), axis=1)[learning]
        discrepancy = discrepancy + fit_mean(fit.covariate[learning], scale, left)
        fit = bench.fit(discrepancy, scale, fit)
    return fit, discrepancy, scale


def _cautions(thresholds: Thresholds, layout: Layout, runs: int, back: int) -> list[str]:
    reach = single_reach(layout.kinds)
    if max(thresholds.motion, thresholds.run) < reach:
        return []
    said = f"{runs - back} runs to learn from and {back} held back" if back else f"{runs} runs"
    return [
        f"The thresholds ({thresholds.motion:.2f} for a motion, {thresholds.run:.2f} for a run) "
        f"are so high that no single magnitude reaches them (at most {reach:.2f}): {said} say too "
        "little about how far healthy runs differ. Record more healthy runs, on other days."
    ]
