"""The verdict of the healthy population, on recordings one by one and by the run.

It judges kinds with `Model.monitoring`, where residuals of healthy recordings were learnt. The
probabilities of the causes (`ematwin.monitoring.population`) decide, as they do for other kinds. A
fault raises an alarm, and so does a change without a name.
"""

from collections.abc import Sequence

import numpy as np

from ematwin.estimation.constants import CERTAIN, COVERAGE, EXPLAINED, SIGMAS
from ematwin.estimation.verdict import UNNAMED, judged
from ematwin.models.base import Reported
from ematwin.monitoring.detection import (
    Covariate,
    Detection,
    Diagnosis,
    Magnitude,
    Standing,
    name_of,
)
from ematwin.monitoring.measure import Measured
from ematwin.monitoring.population import Posterior, basis
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.recordings.recording import Recording
from ematwin.showing.text import listed

_CHANGED = 6.0  # healthy standard deviations of a statistic
_LEAST_CHANGE = 0.05  # of its healthy mean: the standard deviation counts as no less
_STRANGE = 12.0  # root mean square of scores of residuals; seeded faults of a real rig reach 4
_SLACK = 0.15  # of the largest healthy covariate: so far outside their range it is noted
_FAR = 0.5  # of it: so far outside there is no verdict


def by_population(
    recordings: Sequence[Recording],
    calibration: PopulationCalibration,
    measured: Measured | None = None,
) -> Detection:
    """Diagnoses of recordings one by one, and of each run together.

    ``measured`` holds their measurements, where available.

    Raises
    ------
    RecordError
        If a recording is of another command, rate or rig.
    """
    measured = calibration.measure(recordings) if measured is None else measured
    one_source = len({one.source for one in recordings}) == 1
    judge = _Judge(calibration, measured)

    def diagnosis(members: np.ndarray, without: str = "") -> Diagnosis:
        first = recordings[members[0]]
        labels = {name: text for name, text in first.labels.items() if name != without}
        return judge.diagnosis(members, name_of(first, labels, one_source), labels)

    alone = tuple(diagnosis(np.array([n])) for n in range(len(recordings)))
    runs = (np.flatnonzero(measured.groups == g) for g in np.unique(measured.groups))
    together = tuple(diagnosis(members, without="motion") for members in runs)
    return Detection(alone, together, {"": calibration})


class _Judge:
    def __init__(self, calibration: PopulationCalibration, measured: Measured) -> None:
        self._calibration, self._measured = calibration, measured
        model, actuator = calibration.model, calibration.actuator
        self._monitoring, self._reported = calibration.monitoring, calibration.quantities
        self._lower = {one.name: one.lower - one.slack for one in model.faults(actuator)}
        self._scores = calibration.scores(measured)
        self._values = calibration.values_of(measured.features)
        self._healthy = calibration.reported.mean(measured.covariate)

    def diagnosis(self, members: np.ndarray, name: str, labels: dict[str, str]) -> Diagnosis:
        """The diagnosis of some recordings taken together."""
        calibration, measured = self._calibration, self._measured
        scores = self._scores[members]
        found = calibration.causes.posterior(
            scores, basis(measured.covariate[members], calibration.scale)
        )
        mean, names = scores.mean(0), calibration.layout.names
        evidence = {names[n]: float(mean[n]) for n in np.argsort(-np.abs(mean))[:4]}
        statistics = {key: float(x[members].mean()) for key, x in measured.statistics.items()}
        covariate = self._covariate(members)
        magnitudes, strange = self._magnitudes(members), self._is_strange(members)
        doubt = self._doubt(members, strange, covariate)
        faulty = 1.0 - found.healthy
        told = self._told(found, magnitudes, listed(list(evidence)))
        verdict = judged(
            found.probabilities, faulty, {}, calibrated=True, reach={}, found=told, ranges=told,
            obstacles=[doubt] * bool(doubt),
        )  # fmt: skip
        return Diagnosis(
            name=name,
            labels=labels,
            verdict=verdict,
            magnitudes=magnitudes,
            motions=len(members),
            # a wreck is strange too
            alarm=verdict.grade in ("fault", "changed") or (faulty > CERTAIN and strange),
            notes=tuple(self._notes(members, statistics, covariate)),
            when=measured.estimates[members[0]].when,
            probabilities={} if doubt else found.probabilities,
            standing=Standing(found.distance, evidence, statistics, covariate),
        )

    def _told(
        self, found: Posterior, magnitudes: tuple[Magnitude, ...], evidence: str
    ) -> dict[str, str]:
        """Each cause in words, with the quantity that a fault raises."""
        told = {UNNAMED: f"like no fault that can be named (most in {evidence})"}
        for fault in found.probabilities.keys() - told.keys():
            raised = {one.name for one in self._reported if one.named == fault}
            own = [m for m in magnitudes if m.name in raised]
            sizes = [f"{m.name} {str(m)[:-1]}; healthy {m.healthy_text})" for m in own]
            if fault in found.likeness and not any(abs(m.score) > SIGMAS for m in own):
                sizes.insert(0, "by likeness to recordings with it")
            told[fault] = ", ".join([fault] * (raised != {fault}) + sizes)
        return told

    def _is_strange(self, members: np.ndarray) -> bool:
        """Whether the residual is so unlike health that no fault explains it.

        Healthy runs that differ by noise alone, as simulations do, leave so little that anything
        is unlike them. A twin that explains a recording well has found the fault that does.
        """
        if max(self._measured.estimates[n].misfit for n in members) <= EXPLAINED:
            return False
        left = [n for n, kind in enumerate(self._calibration.layout.kinds) if kind != "model"]
        unexplained = self._scores[members][:, left].mean(0)
        return float(np.sqrt(np.mean(unexplained**2))) > _STRANGE

    def _doubt(self, members: np.ndarray, strange: bool, covariate: Covariate | None) -> str:
        """Why there can be no verdict; "" if there can."""
        barred = dict.fromkeys(text for n in members for text in self._measured.barred[n])
        if barred:
            return " ".join(barred)
        if strange:
            return (
                "So unlike the healthy recordings that another rig or a wrong unit is more likely "
                "than a fault; check the channels."
            )
        low, high, outside = self._beside_range(covariate)
        if covariate is None or outside <= _FAR:
            return ""
        return (
            f"Its {covariate.name} (about {covariate.value:.4g} {covariate.unit}) lies far outside "
            f"the range of the healthy recordings ({low:.4g} to {high:.4g} {covariate.unit})."
        )

    def _notes(
        self, members: np.ndarray, statistics: dict[str, float], covariate: Covariate | None
    ) -> list[str]:
        estimates = [self._measured.estimates[n] for n in members]
        notes = list(dict.fromkeys(text for one in estimates for text in one.warnings))
        usual = self._calibration.statistics
        for one in self._monitoring.statistics:
            if one.name not in statistics or one.name not in usual:
                continue
            (mean, spread), now = usual[one.name], statistics[one.name]
            if abs(now - mean) > _CHANGED * max(spread, _LEAST_CHANGE * abs(mean)):
                notes.append(
                    f"{one.changed} ({now:.3g} {one.unit}, healthy {mean:.3g} {one.unit}). "
                    f"{one.advice}"
                )
        low, high, outside = self._beside_range(covariate)
        if covariate is not None and outside > _SLACK:
            notes.append(
                f"Its {covariate.name} lies outside the range of the healthy recordings (about "
                f"{covariate.value:.4g} {covariate.unit}, where they had {low:.4g} to {high:.4g} "
                f"{covariate.unit}): what is healthy there is extrapolated."
            )
        return notes

    def _covariate(self, members: np.ndarray) -> Covariate | None:
        calibration, name = self._calibration, self._monitoring.covariate
        if name is None:
            return None
        unit = calibration.model.unknown(calibration.actuator, name).unit
        return Covariate(name, unit, float(self._measured.covariate[members].mean()))

    def _beside_range(self, covariate: Covariate | None) -> tuple[float, float, float]:
        """The healthy range of a covariate, and how far outside it lies, over its largest size."""
        limits = self._calibration.covariate_range
        if covariate is None or limits is None:
            return -np.inf, np.inf, 0.0
        low, high = limits
        beyond = max(low - covariate.value, covariate.value - high, 0.0)
        return low, high, beyond / max(abs(low), abs(high), 1e-12)

    def _magnitudes(self, members: np.ndarray) -> tuple[Magnitude, ...]:
        reported = self._calibration.reported
        spread = np.hypot(reported.within / np.sqrt(len(members)), reported.between)
        value = self._values[members].mean(0)
        healthy = self._healthy[members].mean(0)
        found = []
        for n, one in enumerate(self._reported):
            reach = COVERAGE * spread[n] * np.array([-1.0, 1.0])
            ends = np.r_[value[n], value[n] + reach, healthy[n] + reach]
            now, low, high, *band = self._shown(one, ends, healthy[n])
            score = float((value[n] - healthy[n]) / max(spread[n], 1e-12))
            usual = band[0], band[1]
            found.append(Magnitude(one.name, one.unit, now, low, high, usual, score))
        return tuple(found)

    def _shown(self, one: Reported, values: np.ndarray, healthy: float) -> list[float]:
        """Values in the unit that is reported."""
        if one.logarithmic:
            return np.exp(values - healthy).tolist()  # times the healthy mean at this covariate
        lower = self._lower.get(one.name, -np.inf)
        return np.asarray(np.maximum(values, lower) * one.scale).tolist()
