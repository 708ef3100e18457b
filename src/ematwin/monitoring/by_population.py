"""The verdict of the healthy population, on recordings one by one and by the run.

It judges kinds with `Model.monitoring`, where residuals of healthy recordings were learnt. The
probabilities of the causes (`ematwin.monitoring.population`) decide, as they do for other kinds. A
fault raises an alarm, and so does a change without a name.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.estimation.constants import CERTAIN, COVERAGE, EXPLAINED, SIGMAS
from ematwin.estimation.verdict import UNNAMED, judged
from ematwin.monitoring.detection import (
    Covariate,
    Detection,
    Diagnosis,
    Magnitude,
    Standing,
    name_of,
)
from ematwin.monitoring.measure import Beside, Measurements, measured
from ematwin.monitoring.population import Posterior
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.showing.text import listed

_CHANGED = 6.0  # healthy standard deviations of a statistic
_LEAST_CHANGE = 0.05  # of its healthy mean: the standard deviation counts as no less
_STRANGE = 12.0  # root mean square of scores of residuals; seeded faults of a real rig reach 4
_SLACK = 0.15  # of the largest healthy covariate: so far outside their range it is noted
_FAR = 0.5  # of it: so far outside there is no verdict


def by_population(beside: Sequence[Beside], calibration: PopulationCalibration) -> Detection:
    """Diagnoses of recordings beside their fitted twin one by one, and of each run together."""
    one_source = len({one.recording.source for one in beside}) == 1
    runs: dict[Any, list[Beside]] = {}
    for one in beside:
        runs.setdefault(one.recording.together, []).append(one)
    alone = tuple(_together(calibration, [one], one_source) for one in beside)
    together = tuple(
        _together(calibration, members, one_source, without="motion") for members in runs.values()
    )
    return Detection(alone, together, {"": calibration})


def _together(
    calibration: PopulationCalibration,
    members: Sequence[Beside],
    one_source: bool,
    without: str = "",
) -> Diagnosis:
    """The diagnosis of recordings that are judged together, named ``without`` a label."""
    own, first = measured(members), members[0].recording
    labels = {name: text for name, text in first.labels.items() if name != without}
    found, scores = calibration.posterior(own), calibration.scores(own).mean(0)
    furthest = np.argsort(-np.abs(scores))[:4].tolist()
    evidence = {calibration.layout[n].name: float(scores[n]) for n in furthest}
    magnitudes, covariate = _magnitudes(calibration, own), _covariate(calibration, own)
    statistics = {name: float(x.mean()) for name, x in own.statistics.items()}
    # Healthy runs that differ by noise alone, as simulations do, leave so little that anything is
    # unlike them. A twin that explains a recording well has found the fault that does.
    unexplained = np.sqrt(np.mean(scores[calibration.kinds != "model"] ** 2))
    strange = bool(max(one.misfit for one in members) > EXPLAINED and unexplained > _STRANGE)
    doubts = list(dict.fromkeys(text for one in members for text in one.barred))
    if not doubts and strange:
        doubts.append(
            "So unlike the healthy recordings that another rig or a wrong unit is more likely "
            "than a fault; check the channels."
        )
    if not doubts and covariate is not None and covariate.outside > _FAR:
        doubts.append(
            f"Its {covariate.name} (about {covariate.value:.4g} {covariate.unit}) lies far outside "
            f"the range of the healthy recordings ({covariate.range_text})."
        )
    told = _told(calibration, found, magnitudes, listed(list(evidence)))
    faulty = 1.0 - found.healthy
    verdict = judged(
        found.probabilities, faulty, {}, calibrated=True, reach={}, found=told, ranges=told,
        obstacles=doubts,
    )  # fmt: skip
    return Diagnosis(
        name=name_of(first, labels, one_source),
        labels=labels,
        verdict=verdict,
        magnitudes=magnitudes,
        motions=len(members),
        # a wreck is strange too
        alarm=verdict.grade in ("fault", "changed") or (faulty > CERTAIN and strange),
        notes=tuple(_notes(calibration, members, statistics, covariate)),
        when=None if first.start is None else first.start.isoformat(),
        probabilities={} if doubts else found.probabilities,
        standing=Standing(found.distance, evidence, statistics, covariate),
    )


def _told(
    calibration: PopulationCalibration,
    found: Posterior,
    magnitudes: Sequence[Magnitude],
    evidence: str,
) -> dict[str, str]:
    """Each cause in words, with the quantity that a fault raises."""
    told = {UNNAMED: f"like no fault that can be named (most in {evidence})"}
    for fault in found.probabilities.keys() - told.keys():
        raised = {one.name for one in calibration.quantities if one.named == fault}
        own = [m for m in magnitudes if m.name in raised]
        sizes = [f"{m.name} {str(m)[:-1]}; healthy {m.healthy_text})" for m in own]
        if fault in found.likeness and not any(abs(m.score) > SIGMAS for m in own):
            sizes.insert(0, "by likeness to recordings with it")
        told[fault] = ", ".join([fault] * (raised != {fault}) + sizes)
    return told


def _covariate(calibration: PopulationCalibration, own: Measurements) -> Covariate | None:
    """The covariate beside its healthy range; None for a kind without one."""
    name, healthy = calibration.monitoring.covariate, calibration.healthy.covariate
    if name is None:
        return None
    unit = calibration.model.unknown(calibration.actuator, name).unit
    ends = float(healthy.min()), float(healthy.max())
    return Covariate(name, unit, float(own.covariate.mean()), ends)


def _notes(
    calibration: PopulationCalibration,
    members: Sequence[Beside],
    statistics: Mapping[str, float],
    covariate: Covariate | None,
) -> list[str]:
    notes = list(dict.fromkeys(text for one in members for text in one.doubts))
    for one in calibration.monitoring.statistics:
        usual, now = calibration.healthy.statistics.get(one.name), statistics.get(one.name)
        if usual is None or now is None:
            continue
        mean, spread = float(usual.mean()), float(usual.std(ddof=1))
        if abs(now - mean) > _CHANGED * max(spread, _LEAST_CHANGE * abs(mean)):
            told = f"{now:.3g} {one.unit}, healthy {mean:.3g} {one.unit}"
            notes.append(f"{one.changed} ({told}). {one.advice}")
    if covariate is not None and covariate.outside > _SLACK:
        notes.append(
            f"Its {covariate.name} lies outside the range of the healthy recordings (about "
            f"{covariate.value:.4g} {covariate.unit}, where they had {covariate.range_text}): what "
            "is healthy there is extrapolated."
        )
    return notes


def _magnitudes(calibration: PopulationCalibration, own: Measurements) -> tuple[Magnitude, ...]:
    """The reported quantities beside their healthy band."""
    reported = calibration.reported
    spread = np.hypot(reported.within / np.sqrt(len(own.runs)), reported.between)
    value = calibration.values_of(own.features).mean(0)
    healthy = reported.mean.at(own.covariate).mean(0)
    lower = {o.name: o.lower for o in calibration.model.faults(calibration.actuator)}
    found = []
    for n, one in enumerate(calibration.quantities):
        reach = COVERAGE * spread[n] * np.array([-1.0, 1.0])
        ends = np.r_[value[n], value[n] + reach, healthy[n] + reach]
        if one.logarithmic:
            shown = np.exp(ends - healthy[n])  # times the healthy mean at this covariate
        else:
            shown = np.maximum(ends, lower.get(one.name, -np.inf)) * one.scale
        now, low, high, *usual = shown.tolist()
        score = float((value[n] - healthy[n]) / max(spread[n], 1e-12))
        found.append(Magnitude(one.name, one.unit, now, low, high, (usual[0], usual[1]), score))
    return tuple(found)
