"""The verdict of the healthy population, on recordings one by one and by the run.

It judges kinds with `Model.monitoring`, where residuals of healthy recordings were learnt.
``healthy``: the index is below its threshold, and no known fault explains the residual.
``changed``: it is above, but nothing can be named. ``fault``: a fault is named, from physics where
the index is above its threshold, or from a signature that explains a good part of the change.
``none``: the recording is of another rig or far outside of the learnt range.

A fault raises an alarm. A change without a name does so only where the index is above what may
drift between occasions as well, or where a single magnitude is far from healthy: healthy runs of
one occasion cannot show how far occasions differ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ematwin.estimation.constants import COVERAGE, EXPLAINED, SIGMAS
from ematwin.estimation.verdict import Grade, Verdict
from ematwin.models.base import Monitoring, Reported
from ematwin.monitoring.detection import Detection, name_of
from ematwin.monitoring.diagnosis import UNNAMED, Covariate, Diagnosis, Magnitude, Standing
from ematwin.monitoring.index import health_index, single_reach
from ematwin.monitoring.measure import Measured, reported_values, statistics_of
from ematwin.monitoring.population import nearest_fault
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.recordings.recording import Recording
from ematwin.showing.text import plain

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


def worn(scores: Mapping[str, float], reported: Sequence[Reported]) -> str:
    """The fault whose quantity has left its healthy spread furthest, as wear moves it; or "".

    Parameters
    ----------
    scores : of the reported quantities, in healthy standard deviations, by name
    reported : says which fault each quantity names, and in which sense
    """
    clear = []
    for one in reported:
        score = abs(scores[one.name]) if one.either else scores[one.name]
        # how small a change may be, the healthy runs themselves say
        if one.named and score > SIGMAS:
            clear.append((score, one.named))
    return max(clear)[1] if clear else ""


class _Name(NamedTuple):
    """The name of a fault, and where it comes from: "physics" or "signature"."""

    fault: str
    by: str


class _Said(NamedTuple):
    """The verdict on some recordings, and the other columns of the row."""

    grade: Grade
    reason: str
    fault: str = ""
    named_by: str = ""
    alarm: bool = False
    note: str = ""


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
        calibration = self._calibration
        limit = calibration.thresholds.of(len(members))
        clear = calibration.clear_limit(len(members))
        mean = self._scores[members].mean(0)
        magnitudes = self._magnitudes(members)
        order = np.argsort(-np.abs(mean))[:4]
        names = calibration.layout.names
        at = Standing(
            index=float(health_index(mean[None], calibration.layout.kinds)[0]),
            threshold=limit,
            clear=clear,
            alone=self._alone(magnitudes, clear),
            evidence={names[n]: float(mean[n]) for n in order},
            statistics={key: float(x[members].mean()) for key, x in self._statistics.items()},
            covariate=self._covariate(members),
        )
        said = self._graded(at, magnitudes, members)
        faults = (said.fault,) if said.grade == "fault" else ()
        lead = {"fault": said.fault, "none": "no verdict"}.get(said.grade, said.grade)
        if said.grade == "changed" and said.alarm:
            lead = UNNAMED
        sentence = f"{lead[:1].upper()}{lead[1:]}: {said.reason}"
        notes = self._notes(members, limit) + ([said.note] if said.note else [])
        return Diagnosis(
            name=name,
            labels=labels,
            verdict=Verdict(said.grade, faults, said.reason, sentence),
            magnitudes=magnitudes,
            motions=len(members),
            alarm=said.alarm,
            notes=tuple(notes),
            when=self._measured.estimates[members[0]].when,
            standing=replace(at, named_by=said.named_by),
        )

    def _graded(
        self, at: Standing, magnitudes: tuple[Magnitude, ...], members: np.ndarray
    ) -> _Said:
        """The grade, and the reason for it."""
        over = at.index > at.threshold
        clear = at.index > at.clear or bool(at.alone)
        index = f"index {at.index:.2f}, limit {at.threshold:.2f}"
        if doubt := self._doubt(members):
            return _Said("none", doubt, alarm=self._is_strange(members) and clear)
        named = self._name(members, at, magnitudes)
        if named is not None:
            text, note = self._why(named, at, magnitudes)
            return _Said("fault", f"{text} ({index}).", named.fault, named.by, True, note)
        if not (over or at.alone):
            return _Said("healthy", f"Within what healthy runs scatter by ({index}).")
        most = ", ".join(at.evidence)
        if clear:
            reason = f"{' and '.join(at.alone)} by itself" if at.alone else "a clear change"
            return _Said(
                "changed",
                f"Unlike healthy runs ({reason}; {index}), but like no fault that can be "
                f"named; most in {most}.",
                alarm=True,
            )
        return _Said(
            "changed",
            f"More than healthy runs of the same occasion scatter by ({index}), but no more "
            f"than may drift from one occasion to the next (up to {at.clear:.2f}), and like no "
            f"fault that can be named; most in {most}.",
        )

    def _why(
        self, named: _Name, at: Standing, magnitudes: tuple[Magnitude, ...]
    ) -> tuple[str, str]:
        """Why a fault is named, and what contradicts it ("" if nothing does)."""
        by_name = {m.name: m for m in magnitudes}
        own = [
            (by_name[one.name], one.either) for one in self._reported if one.named == named.fault
        ]
        own.sort(key=lambda pair: -abs(pair[0].score))
        said = ""
        if own:
            m = own[0][0]
            said = f"{m}, healthy {plain(m.healthy[0])} to {plain(m.healthy[1])}"
        if named.by == "physics":
            name = own[0][0].name.replace("_", " ").capitalize()
            return f"{name} is far outside what healthy runs showed ({said})", ""
        text = "It resembles the recordings that were taught as this fault"
        raised = any((abs(m.score) if either else m.score) > SIGMAS for m, either in own)
        if not own or raised:
            return text, ""
        most = ", ".join(at.evidence)
        return f"{text}, although {own[0][0].name} itself is as in healthy ones", (
            f"It is named {named.fault} because it resembles the recordings that were taught as "
            f"{named.fault}, not because {own[0][0].name} is raised ({said}): most stands out in "
            f"{most}."
        )

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

    def _is_blind(self, limit: float) -> bool:
        """Whether no single magnitude can bring the index above the threshold."""
        return limit >= single_reach(self._calibration.layout.kinds)

    def _alone(self, magnitudes: tuple[Magnitude, ...], limit: float) -> tuple[str, ...]:
        """Magnitudes beyond the prediction bound of a new healthy run, each judged by itself.

        Two-sided Student's t with Bonferroni's correction; only where the index is blind to them.
        """
        if not self._is_blind(limit):
            return ()
        from scipy.special import stdtrit

        runs = max(2, len(self._calibration.healthy.names))
        rate = self._calibration.thresholds.false_alarm_rate / len(magnitudes)
        bound = stdtrit(runs - 1, 1.0 - 0.5 * rate) * float(np.sqrt(1.0 + 1.0 / runs))
        return tuple(one.name for one in magnitudes if abs(one.score) > bound)

    def _covariate(self, members: np.ndarray) -> Covariate | None:
        name = self._monitoring.covariate
        if name is None:
            return None
        return Covariate(name, self._unit, float(self._measured.covariate[members].mean()))

    def _name(
        self, members: np.ndarray, at: Standing, magnitudes: tuple[Magnitude, ...]
    ) -> _Name | None:
        """The fault, if one can be named.

        A signature names whatever the index; physics (`worn`) only where there is a change.
        """
        calibration = self._calibration
        if calibration.signatures:
            fault = nearest_fault(
                self._scores[members], self._measured.covariate[members],
                calibration.scale, calibration.signatures,
            )  # fmt: skip
            if fault:
                return _Name(fault, "signature")
        if at.index <= at.threshold and not at.alone:
            return None
        reported = calibration.reported
        spread = np.hypot(reported.within / np.sqrt(len(members)), reported.between)
        # occasions are taken to differ in the magnitudes of the twin by as much as single healthy
        # recordings do, in what is read from the unrest of residuals by no more than runs do
        drift = np.array([
            reported.spread[n] if one.name in calibration.layout.magnitudes else 0.0
            for n, one in enumerate(self._reported)
        ])  # fmt: skip
        wider = np.hypot(1.0, drift / np.maximum(spread, 1e-12))
        scores = {m.name: m.score / float(wider[n]) for n, m in enumerate(magnitudes)}
        fault = worn(scores, self._reported)
        return _Name(fault, "physics") if fault else None

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

    def _notes(self, members: np.ndarray, limit: float) -> list[str]:
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
        if self._is_blind(limit):
            notes.append(
                f"The alarm threshold is beyond what a single magnitude can bring the index to "
                f"({limit:.2f}), because few healthy runs were learnt: magnitudes were also judged "
                "one by one. Calibrate with more healthy runs."
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
