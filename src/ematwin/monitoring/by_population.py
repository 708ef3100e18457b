"""The verdict of the healthy population, on recordings one by one and by the run.

It judges kinds with `Model.monitoring`, where residuals of healthy recordings were learnt. The
probabilities of the causes (`ematwin.monitoring.population`) decide, as they do for other kinds. A
fault raises an alarm, and so does a change without a name.
"""

from collections.abc import Sequence

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
from ematwin.monitoring.measure import Measured
from ematwin.monitoring.population import Posterior
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

    ``measured`` holds their measurements, where available. `RecordError` if a recording is of
    another command, rate or rig.
    """
    known = calibration.measure(recordings) if measured is None else measured
    one_source = len({one.source for one in recordings}) == 1

    def diagnosis(members: np.ndarray, without: str = "") -> Diagnosis:
        first = recordings[members[0]]
        labels = {name: text for name, text in first.labels.items() if name != without}
        name = name_of(first, labels, one_source)
        return _Together(calibration, known, members).diagnosis(name, labels)

    alone = tuple(diagnosis(np.array([n])) for n in range(len(recordings)))
    runs = (np.flatnonzero(known.groups == g) for g in np.unique(known.groups))
    together = tuple(diagnosis(members, without="motion") for members in runs)
    return Detection(alone, together, {"": calibration})


class _Together:
    """Recordings that are judged together: members (n,) of those that were measured."""

    def __init__(
        self, calibration: PopulationCalibration, measured: Measured, members: np.ndarray
    ) -> None:
        self._calibration, self._monitoring = calibration, calibration.monitoring
        self._own = own = measured.part(members)
        self._scores = calibration.scores(own)
        self._estimates = [measured.estimates[n] for n in members]
        self._barred = dict.fromkeys(text for n in members for text in measured.barred[n])
        self._statistics = {name: float(x.mean()) for name, x in own.statistics.items()}
        self._covariate: Covariate | None = None
        if (name := self._monitoring.covariate) is not None:
            unit = calibration.model.unknown(calibration.actuator, name).unit
            self._covariate = Covariate(name, unit, float(own.covariate.mean()))

    def diagnosis(self, name: str, labels: dict[str, str]) -> Diagnosis:
        """Their diagnosis."""
        found = self._calibration.posterior(self._own)
        mean, names = self._scores.mean(0), self._calibration.layout.names
        evidence = {names[n]: float(mean[n]) for n in np.argsort(-np.abs(mean))[:4]}
        magnitudes, strange = self._magnitudes(), self._is_strange()
        doubt = self._doubt(strange)
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
            motions=len(self._scores),
            # a wreck is strange too
            alarm=verdict.grade in ("fault", "changed") or (faulty > CERTAIN and strange),
            notes=tuple(self._notes()),
            when=self._estimates[0].when,
            probabilities={} if doubt else found.probabilities,
            standing=Standing(found.distance, evidence, self._statistics, self._covariate),
        )

    def _told(
        self, found: Posterior, magnitudes: tuple[Magnitude, ...], evidence: str
    ) -> dict[str, str]:
        """Each cause in words, with the quantity that a fault raises."""
        told = {UNNAMED: f"like no fault that can be named (most in {evidence})"}
        for fault in found.probabilities.keys() - told.keys():
            raised = {one.name for one in self._calibration.quantities if one.named == fault}
            own = [m for m in magnitudes if m.name in raised]
            sizes = [f"{m.name} {str(m)[:-1]}; healthy {m.healthy_text})" for m in own]
            if fault in found.likeness and not any(abs(m.score) > SIGMAS for m in own):
                sizes.insert(0, "by likeness to recordings with it")
            told[fault] = ", ".join([fault] * (raised != {fault}) + sizes)
        return told

    def _is_strange(self) -> bool:
        """Whether the residual is so unlike health that no fault explains it.

        Healthy runs that differ by noise alone, as simulations do, leave so little that anything
        is unlike them. A twin that explains a recording well has found the fault that does.
        """
        if max(one.misfit for one in self._estimates) <= EXPLAINED:
            return False
        left = [n for n, kind in enumerate(self._calibration.layout.kinds) if kind != "model"]
        unexplained = self._scores[:, left].mean(0)
        return float(np.sqrt(np.mean(unexplained**2))) > _STRANGE

    def _doubt(self, strange: bool) -> str:
        """Why there can be no verdict; "" if there can."""
        if self._barred:
            return " ".join(self._barred)
        if strange:
            return (
                "So unlike the healthy recordings that another rig or a wrong unit is more likely "
                "than a fault; check the channels."
            )
        low, high, outside = self._beside_range()
        one = self._covariate
        if one is None or outside <= _FAR:
            return ""
        return (
            f"Its {one.name} (about {one.value:.4g} {one.unit}) lies far outside the range of the "
            f"healthy recordings ({low:.4g} to {high:.4g} {one.unit})."
        )

    def _notes(self) -> list[str]:
        notes = list(dict.fromkeys(text for one in self._estimates for text in one.warnings))
        usual, found = self._calibration.statistics, self._statistics
        for one in self._monitoring.statistics:
            if one.name not in found or one.name not in usual:
                continue
            (mean, spread), now = usual[one.name], found[one.name]
            if abs(now - mean) > _CHANGED * max(spread, _LEAST_CHANGE * abs(mean)):
                notes.append(
                    f"{one.changed} ({now:.3g} {one.unit}, healthy {mean:.3g} {one.unit}). "
                    f"{one.advice}"
                )
        low, high, outside = self._beside_range()
        if (load := self._covariate) is not None and outside > _SLACK:
            notes.append(
                f"Its {load.name} lies outside the range of the healthy recordings (about "
                f"{load.value:.4g} {load.unit}, where they had {low:.4g} to {high:.4g} "
                f"{load.unit}): what is healthy there is extrapolated."
            )
        return notes

    def _beside_range(self) -> tuple[float, float, float]:
        """The healthy range of the covariate, and how far outside it lies, over its size."""
        if self._covariate is None:
            return -np.inf, np.inf, 0.0
        healthy, value = self._calibration.healthy.covariate, self._covariate.value
        low, high = float(healthy.min()), float(healthy.max())
        beyond = max(low - value, value - high, 0.0)
        return low, high, beyond / max(abs(low), abs(high), 1e-12)

    def _magnitudes(self) -> tuple[Magnitude, ...]:
        calibration, reported = self._calibration, self._calibration.reported
        spread = np.hypot(reported.within / np.sqrt(len(self._scores)), reported.between)
        value = calibration.values_of(self._own.features).mean(0)
        healthy = reported.mean(self._own.covariate).mean(0)
        lower = {o.name: o.lower - o.slack for o in calibration.model.faults(calibration.actuator)}
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
