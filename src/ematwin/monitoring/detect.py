"""``detect``: a verdict on recordings, one by one and by the run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from ematwin.estimation.estimate import Estimate
from ematwin.models.base import Reported
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
from ematwin.recordings.recording import Recording, label_text

COVERAGE = 1.96  # standard deviations of an interval: 95 %
_ENDS = np.array([-1.0, 1.0])
_CHANGED = 6.0  # healthy standard deviations of a statistic
_LEAST_CHANGE = 0.05  # of its healthy mean: the standard deviation counts as no less
_STRANGE = 12.0  # root mean square of scores of residuals; seeded faults of a real rig reach 4


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
    index, threshold : health index and where the alarm begins
    fault : name of the fault, "" without an alarm
    named_by : "physics", "signature" or ""
    statistics : what was measured beside the twin, by name, SI
    evidence : the features furthest from health: name to score
    notes : sentences
    alone : magnitudes that raise the alarm by themselves, where the threshold lies beyond what a
        single one can bring the index to
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

    @property
    def alarm(self) -> bool:
        """Whether the index is above its threshold, or a magnitude is far off by itself."""
        return self.index > self.threshold or bool(self.alone)

    @property
    def load(self) -> float | None:
        """The estimated load, SI, where that is the covariate."""
        one = self.covariate
        return one.value if one is not None and one.name == "load" else None

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        one = self.covariate
        return {
            "name": self.name,
            "labels": self.labels,
            "motions": self.motions,
            "index": self.index,
            "threshold": self.threshold,
            "alarm": self.alarm,
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


def detect(recordings: Given, calibration: Calibration | str | Path) -> Detection:
    """Judge recordings against the healthy population, each alone and each run together.

    Parameters
    ----------
    recordings : or the files that hold them
    calibration : or its file

    Raises
    ------
    RecordError
        If a recording is of another command, rate or rig.
    """
    if not isinstance(calibration, Calibration):
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
        scores = self._scores[members]
        mean = scores.mean(0)
        index = float(health_index(mean[None], calibration.layout.kinds)[0])
        magnitudes = self._magnitudes(members)
        alone = self._alone(magnitudes, limit)
        named = Name("", "")
        if index > limit or alone:
            named = self._name(scores, self._measured.covariate[members], magnitudes)
        order = np.argsort(-np.abs(mean))[:4]
        names = calibration.layout.names
        return Verdict(
            name=name,
            labels=labels,
            motions=len(members),
            magnitudes=magnitudes,
            covariate=self._covariate(members),
            index=index,
            threshold=limit,
            fault=named.fault,
            named_by=named.by,
            statistics={key: float(x[members].mean()) for key, x in self._statistics.items()},
            evidence={names[n]: float(mean[n]) for n in order},
            notes=tuple(self._notes(members, limit)),
            alone=alone,
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
        bound = float(student.ppf(1.0 - 0.5 * rate, runs - 1) * np.sqrt(1.0 + 1.0 / runs))
        return tuple(one.name for one in magnitudes if abs(one.score) > bound)

    def _covariate(self, members: np.ndarray) -> Covariate | None:
        name = self._model.covariate
        if name is None:
            return None
        return Covariate(name, self._unit, float(self._measured.covariate[members].mean()))

    def _name(
        self, scores: np.ndarray, covariate: np.ndarray, magnitudes: tuple[Magnitude, ...]
    ) -> Name:
        calibration = self._calibration
        if calibration.signatures:
            scale = calibration.population.scale
            named = named_by_signature(scores, covariate, scale, calibration.signatures)
            if named.fault != UNNAMED:
                return named
        return named_by_physics({m.name: m.score for m in magnitudes}, self._reported)

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
        left = [n for n, kind in enumerate(calibration.layout.kinds) if kind != "model"]
        unexplained = self._scores[members][:, left].mean(0)
        if float(np.sqrt(np.mean(unexplained**2))) > _STRANGE:
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
        slack = 0.15 * max(abs(low), abs(high))
        if low - slack <= covariate.value <= high + slack:
            return []
        return [
            f"Its {covariate.name} lies outside the range of the healthy recordings (about "
            f"{covariate.value:.4g} {covariate.unit}, where they had {low:.4g} to {high:.4g} "
            f"{covariate.unit}): what is healthy there is extrapolated."
        ]
