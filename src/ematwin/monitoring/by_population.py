"""The verdict of the healthy population, on recordings one by one and by the run.

It judges kinds with `Model.monitoring`, where residuals of healthy recordings were learnt. The
probabilities of the causes (`ematwin.monitoring.causes`) decide, as they do for other kinds. A
fault raises an alarm, and so does a change without a name.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from ematwin.estimation.constants import CERTAIN, COVERAGE, EXPLAINED, SIGMAS
from ematwin.estimation.verdict import UNNAMED, judged
from ematwin.models.base import Monitoring, Reported
from ematwin.monitoring.causes import Posterior
from ematwin.monitoring.detection import Detection, name_of
from ematwin.monitoring.diagnosis import Covariate, Diagnosis, Magnitude, Standing
from ematwin.monitoring.measure import Measured, reported_values, statistics_of
from ematwin.monitoring.population import basis
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.recordings.recording import Recording
from ematwin.showing.text import listed

_ENDS = np.array([-1.0, 1.0])
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
    single = tuple(
        judge.diagnosis(np.array([n]), name_of(one, one.labels, one_source), one.labels)
        for n, one in enumerate(recordings)
    )
    together = []
    for g in np.unique(measured.groups):
        members = np.flatnonzero(measured.groups == g)
        first = recordings[members[0]]
        labels = {k: v for k, v in first.labels.items() if k != "motion"}
        together.append(judge.diagnosis(members, name_of(first, labels, one_source), labels))
    return Detection(single, tuple(together), {"": calibration})


class _Judge:
    def __init__(self, calibration: PopulationCalibration, measured: Measured) -> None:
        self._calibration, self._measured = calibration, measured
        model, actuator = calibration.model, calibration.actuator
        self._monitoring = Monitoring.of(model)
        self._reported = self._monitoring.reported(model, actuator)
        self._lower = {one.name: one.lower - one.slack for one in model.faults(actuator)}
        self._scores = calibration.scores(measured)
        self._values = reported_values(model, actuator, calibration.layout, measured.features)
        self._healthy = calibration.reported.mean(measured.covariate)
        self._statistics = statistics_of(measured.estimates)
        self._unit = ""
        if self._monitoring.covariate is not None:
            self._unit = model.unknown(actuator, self._monitoring.covariate).unit

    def diagnosis(self, members: np.ndarray, name: str, labels: dict[str, str]) -> Diagnosis:
        """The diagnosis of some recordings taken together."""
        calibration, measured = self._calibration, self._measured
        scores = self._scores[members]
        found = calibration.causes.posterior(
            scores, basis(measured.covariate[members], calibration.scale)
        )
        mean, names = scores.mean(0), calibration.layout.names
        evidence = {names[n]: float(mean[n]) for n in np.argsort(-np.abs(mean))[:4]}
        magnitudes, doubt = self._magnitudes(members), self._doubt(members)
        faulty = 1.0 - found.healthy
        told = self._told(found, magnitudes, evidence)
        verdict = judged(
            found.probabilities, faulty, {}, calibrated=True, reach={}, found=told, ranges=told,
            obstacles=[doubt] * bool(doubt),
        )  # fmt: skip
        changed = verdict.grade in ("fault", "changed")
        return Diagnosis(
            name=name,
            labels=labels,
            verdict=verdict,
            magnitudes=magnitudes,
            motions=len(members),
            # a wreck is strange too
            alarm=changed or (faulty > CERTAIN and self._is_strange(members)),
            notes=tuple(self._notes(members)),
            when=measured.estimates[members[0]].when,
            probabilities={} if doubt else found.probabilities,
            standing=Standing(
                distance=found.distance,
                evidence=evidence,
                statistics={key: float(x[members].mean()) for key, x in self._statistics.items()},
                covariate=self._covariate(members),
            ),
        )

    def _told(
        self, found: Posterior, magnitudes: tuple[Magnitude, ...], evidence: Iterable[str]
    ) -> dict[str, str]:
        """Each cause in words, with the quantity that a fault raises."""
        told = {UNNAMED: f"like no fault that can be named (most in {listed(list(evidence))})"}
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

    def _doubt(self, members: np.ndarray) -> str:
        """Why there can be no verdict; "" if there can."""
        barred = dict.fromkeys(text for n in members for text in self._measured.barred[n])
        if barred:
            return " ".join(barred)
        if self._is_strange(members):
            return (
                "So unlike the healthy recordings that another rig or a wrong unit is more likely "
                "than a fault; check the channels."
            )
        covariate = self._covariate(members)
        if covariate is None or self._outside(covariate) <= _FAR:
            return ""
        low, high = self._calibration.covariate_range or (0.0, 0.0)
        return (
            f"Its {covariate.name} (about {covariate.value:.4g} {covariate.unit}) lies far outside "
            f"the range of the healthy recordings ({low:.4g} to {high:.4g} {covariate.unit})."
        )

    def _covariate(self, members: np.ndarray) -> Covariate | None:
        name = self._monitoring.covariate
        if name is None:
            return None
        return Covariate(name, self._unit, float(self._measured.covariate[members].mean()))

    def _magnitudes(self, members: np.ndarray) -> tuple[Magnitude, ...]:
        reported = self._calibration.reported
        within = reported.within / np.sqrt(len(members))
        spread = np.hypot(within, reported.between)
        value = self._values[members].mean(0)
        healthy = self._healthy[members].mean(0)
        found = []
        for n, one in enumerate(self._reported):
            reach = COVERAGE * spread[n]
            ends = np.r_[value[n], value[n] + reach * _ENDS, healthy[n] + reach * _ENDS]
            shown = self._shown(one, ends, healthy[n])
            found.append(
                Magnitude(
                    one.name, one.unit, float(shown[0]), float(shown[1]), float(shown[2]),
                    (float(shown[3]), float(shown[4])),
                    float((value[n] - healthy[n]) / max(spread[n], 1e-12)),
                )
            )  # fmt: skip
        return tuple(found)

    def _shown(self, one: Reported, values: np.ndarray, healthy: float) -> np.ndarray:
        """Values in the unit that is reported."""
        if one.logarithmic:
            return np.exp(values - healthy)  # times the healthy mean at this covariate
        return np.maximum(values, self._lower.get(one.name, -np.inf)) * one.scale

    def _notes(self, members: np.ndarray) -> list[str]:
        calibration = self._calibration
        estimates = [self._measured.estimates[n] for n in members]
        notes = list(dict.fromkeys(text for one in estimates for text in one.warnings))
        for statistic in self._monitoring.statistics:
            if not {statistic.name} <= self._statistics.keys() & calibration.statistics.keys():
                continue
            mean, spread = calibration.statistics[statistic.name]
            now = float(self._statistics[statistic.name][members].mean())
            if abs(now - mean) > _CHANGED * max(spread, _LEAST_CHANGE * abs(mean)):
                notes.append(
                    f"{statistic.changed} ({now:.3g} {statistic.unit}, healthy {mean:.3g} "
                    f"{statistic.unit}). {statistic.advice}"
                )
        return notes + self._note_on_covariate(members)

    def _note_on_covariate(self, members: np.ndarray) -> list[str]:
        covariate, limits = self._covariate(members), self._calibration.covariate_range
        if covariate is None or limits is None:
            return []
        low, high = limits
        if self._outside(covariate) <= _SLACK:
            return []
        return [
            f"Its {covariate.name} lies outside the range of the healthy recordings (about "
            f"{covariate.value:.4g} {covariate.unit}, where they had {low:.4g} to {high:.4g} "
            f"{covariate.unit}): what is healthy there is extrapolated."
        ]

    def _outside(self, covariate: Covariate) -> float:
        """How far a covariate lies outside the healthy range, over its largest size."""
        low, high = self._calibration.covariate_range or (-np.inf, np.inf)
        beyond = max(low - covariate.value, covariate.value - high, 0.0)
        return beyond / max(abs(low), abs(high), 1e-12)
