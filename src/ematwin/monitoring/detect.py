"""``detect``: a verdict on recordings, one by one and by the run.

A verdict has a grade. ``healthy``: the index is below its threshold, and no known fault explains
what is left. ``changed``: it is above, but nothing can be named. ``fault``: a fault is named, from
physics where the index is above its threshold, or from a signature that explains a good part of
the change. ``none``: no verdict, because the recording is of another rig or far outside of what was
learnt.

A fault raises an alarm. A change without a name does so only where the index is above what may
drift between occasions as well, or where a magnitude is far off by itself: healthy runs of one
occasion cannot show how far occasions differ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.verdict import EXPLAINED
from ematwin.models.base import Reported
from ematwin.monitoring.calibrate import CalibrationReport
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.classification import (
    UNNAMED,
    Name,
    named_by_physics,
    named_by_signature,
)
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.index import health_index, single_reach
from ematwin.monitoring.measure import Measured, reported_values, statistics_of
from ematwin.numerics.student import student_quantile
from ematwin.recordings.recording import Recording, label_text
from ematwin.showing import markup
from ematwin.showing.drawing import drawn
from ematwin.showing.frames import frame_of_rows

COVERAGE = 1.96  # standard deviations of an interval: 95 %
_ENDS = np.array([-1.0, 1.0])
_CHANGED = 6.0  # healthy standard deviations of a statistic
_LEAST_CHANGE = 0.05  # of its healthy mean: the standard deviation counts as no less
_STRANGE = 12.0  # root mean square of scores of residuals; seeded faults of a real rig reach 4
_SLACK = 0.15  # of the largest healthy covariate: so far outside their range it is noted
_FAR = 0.5  # of it: so far outside there is no verdict
_SIGMAS = 3.0  # healthy deviations from which a magnitude counts as raised


@dataclass(frozen=True)
class Magnitude:
    """A reported quantity with its interval.

    Attributes
    ----------
    value, low, high : in the unit of `ematwin.models.base.Reported`; the interval is what healthy
        runs scatter by, around the value
    healthy : (2,) band in which 95 % of healthy recordings of other runs lie
    score : healthy standard deviations from the healthy mean
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    healthy: tuple[float, float]
    score: float


@dataclass(frozen=True)
class Covariate:
    """The covariate that was estimated with a recording, such as its load.

    Attributes
    ----------
    name, unit, value : SI
    """

    name: str
    unit: str
    value: float

    @property
    def key(self) -> str:
        """Name with unit, for tables: ``load_N``."""
        return f"{self.name}_{self.unit}".rstrip("_")

    def __str__(self) -> str:
        digits = ".0f" if abs(self.value) >= 10.0 else ".3g"
        return f"{self.value:{digits}} {self.unit}".rstrip()


@dataclass(frozen=True)
class Verdict:
    """What follows from one recording, or from the recordings of a run together.

    Attributes
    ----------
    name : of the recording or run
    labels : what the file says of it
    motions : how many recordings it rests on
    magnitudes : what the kind reports
    covariate : estimated with it, such as the load; None for a kind without one
    index, threshold : health index, and the bound that healthy runs seldom exceed
    fault : name of the fault, or `UNNAMED`; "" without an alarm
    named_by : "physics", "signature" or ""
    statistics : what was measured beside the twin, by name, SI
    evidence : the features furthest from health: name to score
    notes : sentences
    alone : magnitudes that raise the alarm by themselves, where the threshold lies beyond what a
        single one can bring the index to
    grade : "healthy", "changed", "fault" or "none"
    alarm : whether somebody should look: at a fault, and at a change that is clear
    reason : a sentence on why this grade
    clear : the index from which a change without a name raises an alarm
    when : time at which its first recording began, ISO 8601, or None
    """

    name: str
    labels: dict[str, str]
    motions: int
    magnitudes: tuple[Magnitude, ...]
    covariate: Covariate | None
    index: float
    threshold: float
    fault: str
    named_by: str
    statistics: Mapping[str, float] = field(default_factory=dict)
    evidence: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    alone: tuple[str, ...] = ()
    grade: str = "healthy"
    alarm: bool = False
    reason: str = ""
    clear: float = np.inf
    when: str | None = None

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults; none unless the grade is "fault"."""
        return (self.fault,) if self.grade == "fault" else ()

    @property
    def said(self) -> str:
        """Name of the fault or grade, for tables."""
        if self.grade in ("fault", "none"):
            return self.fault if self.grade == "fault" else "no verdict"
        return self.fault or self.grade

    @property
    def load(self) -> float | None:
        """The estimated load, SI, where that is the covariate."""
        one = self.covariate
        return one.value if one is not None and one.name == "load" else None

    @property
    def row(self) -> dict[str, object]:
        """It as a row of a table: labels, index, verdict, each magnitude with its interval."""
        found: dict[str, object] = {"name": self.name, **self.labels}
        found |= {"motions": self.motions, "index": self.index, "limit": self.threshold}
        found |= {"alarm": self.alarm, "fault": self.fault, "named_by": self.named_by}
        found |= {"grade": self.grade, "reason": self.reason}
        for m in self.magnitudes:
            key = f"{m.name}_{m.unit}" if m.unit not in ("", "x") else m.name
            found |= {key: m.value, f"{key}_low": m.low, f"{key}_high": m.high}
        if self.covariate is not None:
            found[self.covariate.key] = self.covariate.value
        return found | dict(self.statistics)

    def _repr_html_(self) -> str:
        """The verdict, then the magnitudes, in a notebook."""
        rows = [
            (m.name, f"{m.value:.3g} {m.unit}".rstrip(), f"{m.low:.3g} to {m.high:.3g}",
             f"{m.healthy[0]:.3g} to {m.healthy[1]:.3g}")
            for m in self.magnitudes
        ]  # fmt: skip
        because = f": {self.reason}" if self.reason else ""
        return "".join(
            [
                markup.verdict(f"{self.name}: {self.said}{because}", self.grade),
                markup.table(("quantity", "value", "95 %", "healthy"), rows),
                *(markup.note(text) for text in self.notes),
            ]
        )

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        one = self.covariate
        return {
            "name": self.name,
            "when": self.when,
            "labels": self.labels,
            "motions": self.motions,
            "index": self.index,
            "threshold": self.threshold,
            "clear_threshold": self.clear,
            "alarm": self.alarm,
            "grade": self.grade,
            "faults": list(self.faults),
            "reason": self.reason,
            **({"alone": list(self.alone)} if self.alone else {}),
            "fault": self.fault or None,
            "named_by": self.named_by or None,
            "magnitudes": {
                m.name: {
                    "value": m.value, "unit": m.unit, "low": m.low, "high": m.high,
                    "healthy": list(m.healthy), "score": m.score,
                }
                for m in self.magnitudes
            },
            **({} if one is None else {one.key: one.value}),
            **self.statistics,
            "evidence": dict(self.evidence),
            "notes": list(self.notes),
        }  # fmt: skip


@dataclass(frozen=True)
class Detection:
    """Verdicts on recordings and on runs.

    Attributes
    ----------
    motions : a verdict on each recording
    runs : a verdict on the recordings of each run together
    calibration : Calibration
    estimates : of each recording, in the order of ``motions``
    """

    motions: tuple[Verdict, ...]
    runs: tuple[Verdict, ...]
    calibration: Calibration
    estimates: tuple[Estimate, ...] = ()

    @property
    def grade(self) -> str:
        """The grade of the run that somebody has to look at first."""
        grades = [verdict.grade for verdict in self.runs]
        return next((one for one in ("fault", "changed", "none") if one in grades), "healthy")

    @property
    def sentence(self) -> str:
        """How many runs raise an alarm, and of which faults."""
        names: dict[str, int] = {}
        for verdict in self.runs:
            if verdict.alarm:
                names[verdict.fault] = names.get(verdict.fault, 0) + 1
        said = "; ".join(f"{fault} in {count}" for fault, count in names.items())
        return f"{counted(self.runs, 'runs')}{': ' + said if said else ''}."

    def to_frame(self, each: str = "run") -> Any:
        """A pandas DataFrame with a row for each "run" or "motion", by name; needs pandas."""
        return frame_of_rows((one.row for one in self._each(each)), "name")

    to_dataframe = to_frame

    def plot(self, each: str = "run") -> Any:
        """The trend over runs, or over motions: a figure of plotly."""
        return drawn(self, each, {"run": "plot_trend", "motion": "plot_index"})

    def _each(self, each: str) -> "tuple[Verdict, ...]":
        if each not in ("run", "motion"):
            raise InputError(f"each must be run or motion, received {each!r}.")
        return self.runs if each == "run" else self.motions

    def _repr_html_(self) -> str:
        """How many raise an alarm, then each run, in a notebook."""
        rows = [(v.name, v.said, f"{v.index:.2f} / {v.threshold:.2f}", v.reason) for v in self.runs]
        marked = [n for n, verdict in enumerate(self.runs) if verdict.alarm]
        return "".join(
            [
                markup.verdict(self.sentence, self.grade),
                markup.table(("run", "verdict", "index / limit", "because"), rows, marked),
                *(markup.note(text) for text in gathered_notes(self.runs)),
            ]
        )


def detect(
    recordings: Given, calibration: Calibration | CalibrationReport | str | Path
) -> Detection:
    """Judge recordings against the healthy population, each alone and each run together.

    Parameters
    ----------
    recordings : or the files that hold them
    calibration : what `calibrate` gave, or its file

    Raises
    ------
    RecordError
        If a recording is of another command, rate or rig.
    InputError
        If the calibration has no healthy population.
    """
    if isinstance(calibration, CalibrationReport):
        if calibration.calibration is None:
            raise InputError(
                "The calibration has no healthy population to judge by: it was learnt from "
                f"{len(calibration.learnt)} runs. Give it three or more over one command."
            )
        calibration = calibration.calibration
    elif not isinstance(calibration, Calibration):
        calibration = Calibration.load(calibration)
    given = recordings_of(recordings, calibration.actuator)
    return judge(given, calibration.measure(given), calibration)


def judge(
    recordings: Sequence[Recording], measured: Measured, calibration: Calibration
) -> Detection:
    """Verdicts from what was measured on recordings."""
    one_source = len({one.source for one in recordings}) == 1
    judge = _Judge(calibration, measured)
    single = tuple(
        judge.verdict(np.array([n]), _name_of(one.source, one.labels, one_source), one.labels)
        for n, one in enumerate(recordings)
    )
    together = []
    for g in np.unique(measured.groups):
        members = np.flatnonzero(measured.groups == g)
        first = recordings[members[0]]
        labels = {k: v for k, v in first.labels.items() if k != "motion"}
        name = _name_of(first.source, labels, one_source)
        together.append(judge.verdict(members, name, labels))
    return Detection(single, tuple(together), calibration, measured.estimates)


def _name_of(source: str, labels: dict[str, str], one_source: bool) -> str:
    """Labels for tables, with the file where there are several or no labels."""
    said = label_text(labels)
    return said if said and one_source else f"{source} {said}".strip()


def counted(verdicts: Sequence[Verdict], kind: str) -> str:
    """How many verdicts raise an alarm, and of how many of the rest something is to be said."""
    rest = [verdict.grade for verdict in verdicts if not verdict.alarm]
    said = {
        "changed by no more than may drift": rest.count("changed"),
        "without a verdict": rest.count("none"),
    }
    more = "".join(f", {count} {text}" for text, count in said.items() if count)
    return f"{sum(v.alarm for v in verdicts)} of {len(verdicts)} {kind} raise an alarm{more}"


def gathered_notes(verdicts: Sequence[Verdict]) -> list[str]:
    """The notes of many verdicts, alike ones once, each with how many have it."""
    seen: dict[str, list[tuple[str, str]]] = {}
    for verdict in verdicts:
        for note in verdict.notes:
            seen.setdefault(note.partition(" (")[0], []).append((verdict.name, note))
    return [
        f"{found[0][0]}: {found[0][1]}"
        + (f" {len(found)} of {len(verdicts)} are like this." if len(found) > 1 else "")
        for found in seen.values()
    ]


def gathered_reasons(verdicts: Sequence[Verdict]) -> list[str]:
    """Why verdicts are other than healthy, the first of each name or grade."""
    found: dict[str, str] = {}
    for verdict in verdicts:
        if verdict.grade != "healthy":
            found.setdefault(verdict.said, f"{verdict.said}: {verdict.reason}")
    return list(found.values())


class _Judge:
    def __init__(self, calibration: Calibration, measured: Measured) -> None:
        self._calibration, self._measured = calibration, measured
        model, actuator = calibration.model, calibration.actuator
        self._model = model
        self._reported = model.reported(actuator)
        self._lower = {one.name: one.lower - one.slack for one in model.faults(actuator)}
        self._scores = calibration.scores(measured).values
        self._values = reported_values(model, actuator, calibration.layout, measured.features)
        self._healthy = calibration.reported.mean(measured.covariate)
        self._statistics = statistics_of(measured.estimates)
        self._unit = ""
        if model.covariate is not None:
            self._unit = model.unknown(actuator, model.covariate).unit

    def verdict(self, members: np.ndarray, name: str, labels: dict[str, str]) -> Verdict:
        """The verdict on some recordings taken together."""
        calibration = self._calibration
        limit = calibration.thresholds.of(len(members))
        clear = calibration.clear_limit(len(members))
        scores = self._scores[members]
        mean = scores.mean(0)
        index = float(health_index(mean[None], calibration.layout.kinds)[0])
        magnitudes = self._magnitudes(members)
        order = np.argsort(-np.abs(mean))[:4]
        names = calibration.layout.names
        plain = Verdict(
            name=name,
            labels=labels,
            motions=len(members),
            magnitudes=magnitudes,
            covariate=self._covariate(members),
            index=index,
            threshold=limit,
            fault="",
            named_by="",
            statistics={key: float(x[members].mean()) for key, x in self._statistics.items()},
            evidence={names[n]: float(mean[n]) for n in order},
            notes=tuple(self._notes(members, limit)),
            alone=self._alone(magnitudes, clear),
            clear=clear,
            when=self._measured.estimates[members[0]].when,
        )
        return self._graded(plain, members)

    def _graded(self, plain: Verdict, members: np.ndarray) -> Verdict:
        """A verdict with its grade, and the reason for it."""
        over = plain.index > plain.threshold
        clear = plain.index > plain.clear or bool(plain.alone)
        index = f"index {plain.index:.2f}, limit {plain.threshold:.2f}"
        doubt, strange = self._doubt(members), self._is_strange(members)
        if doubt:
            alarm = strange and clear
            return replace(
                plain, grade="none", alarm=alarm, fault=UNNAMED if alarm else "", reason=doubt
            )
        named = self._name(members, plain)
        if named.fault != UNNAMED:
            text, note = self._why(named, plain)
            return replace(
                plain, grade="fault", alarm=True, fault=named.fault, named_by=named.by,
                reason=f"{text} ({index}).", notes=plain.notes + ((note,) if note else ()),
            )  # fmt: skip
        if not (over or plain.alone):
            return replace(plain, reason=f"Within what healthy runs scatter by ({index}).")
        most = ", ".join(plain.evidence)
        if clear:
            reason = f"{' and '.join(plain.alone)} by itself" if plain.alone else "a clear change"
            return replace(
                plain, grade="changed", alarm=True, fault=UNNAMED,
                reason=f"Unlike healthy runs ({reason}; {index}), but like no fault that can be "
                f"named; most in {most}.",
            )  # fmt: skip
        return replace(
            plain, grade="changed",
            reason=f"More than healthy runs of the same occasion scatter by ({index}), but no more "
            f"than may drift from one occasion to the next (up to {plain.clear:.2f}), and like no "
            f"fault that can be named; most in {most}.",
        )  # fmt: skip

    def _why(self, named: Name, plain: Verdict) -> tuple[str, str]:
        """Why a fault is named, and what contradicts it ("" if nothing does)."""
        by_name = {m.name: m for m in plain.magnitudes}
        own = [
            (by_name[one.name], one.either) for one in self._reported if one.named == named.fault
        ]
        own.sort(key=lambda pair: -abs(pair[0].score))
        said = ""
        if own:
            m = own[0][0]
            said = (
                f"{m.name} {m.value:.3g} {m.unit}".rstrip()
                + f", healthy {m.healthy[0]:.3g} to {m.healthy[1]:.3g}"
            )
        if named.by == "physics":
            m = own[0][0]
            return f"{said}: {abs(m.score):.1f} healthy deviations off", ""
        text = "It resembles the recordings that were taught as this fault"
        raised = any((abs(m.score) if either else m.score) > _SIGMAS for m, either in own)
        if not own or raised:
            return text, ""
        most = ", ".join(plain.evidence)
        return f"{text}, although {own[0][0].name} itself is as in healthy ones", (
            f"It is named {named.fault} because it resembles the recordings that were taught as "
            f"{named.fault}, not because {own[0][0].name} is raised ({said}): most stands out in "
            f"{most}."
        )

    def _is_strange(self, members: np.ndarray) -> bool:
        """Whether what the twin leaves is so unlike health that no fault explains it.

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
                "than a fault."
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
        runs = max(2, len(self._calibration.facts.get("runs", [])))
        rate = self._calibration.thresholds.false_alarm_rate / len(magnitudes)
        bound = student_quantile(1.0 - 0.5 * rate, runs - 1) * float(np.sqrt(1.0 + 1.0 / runs))
        return tuple(one.name for one in magnitudes if abs(one.score) > bound)

    def _covariate(self, members: np.ndarray) -> Covariate | None:
        name = self._model.covariate
        if name is None:
            return None
        return Covariate(name, self._unit, float(self._measured.covariate[members].mean()))

    def _name(self, members: np.ndarray, plain: Verdict) -> Name:
        """The fault, if one can be named.

        A signature names whatever the index; physics only where there is a change.
        """
        calibration = self._calibration
        if calibration.signatures:
            named = named_by_signature(
                self._scores[members], self._measured.covariate[members],
                calibration.population.scale, calibration.signatures,
            )  # fmt: skip
            if named.fault != UNNAMED:
                return named
        if plain.index <= plain.threshold and not plain.alone:
            return Name(UNNAMED, "")
        reported = calibration.reported
        spread = np.hypot(reported.within / np.sqrt(len(members)), reported.between)
        # occasions are taken to differ in the magnitudes of the twin by as much as single healthy
        # recordings do, in what is read from the unrest of residuals by no more than runs do
        drift = np.array([
            reported.spread[n] if one.name in calibration.layout.magnitudes else 0.0
            for n, one in enumerate(self._reported)
        ])  # fmt: skip
        wider = np.hypot(1.0, drift / np.maximum(spread, 1e-12))
        scores = {m.name: m.score / float(wider[n]) for n, m in enumerate(plain.magnitudes)}
        return named_by_physics(scores, self._reported)

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
        for statistic in self._model.statistics:
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
        notes += self._note_on_covariate(members)
        if self._is_strange(members):
            notes.append(
                "It is so unlike the healthy recordings that another rig or a wrong unit is more "
                "likely than a fault; check the channels."
            )
        return notes

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
