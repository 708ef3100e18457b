"""Detection: verdicts on recordings with their values, of one actuator or of several, as a table.

`ematwin.identify` of several recordings and `ematwin.detect` give the same one.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from ematwin.errors import InputError
from ematwin.estimation.identification import Identification
from ematwin.estimation.verdict import UNNAMED, Grade, Verdict
from ematwin.monitoring.calibration import Calibration
from ematwin.recordings.recording import Recording, label_text
from ematwin.showing.results import drawn, frame, html, page_written, plain
from ematwin.showing.text import listed, number_of, said, said_between


@dataclass(frozen=True)
class Magnitude:
    """A fault, or another reported quantity, with its interval."""

    name: str
    unit: str
    value: float  # value, low, high: in ``unit``, with the 95 % interval
    low: float
    high: float
    healthy: tuple[float, float]  # band in which 95 % of healthy recordings with its error lie
    score: float  # standard deviations from healthy

    def __str__(self) -> str:
        number, between = said_between(self.value, self.low, self.high, self.unit)
        return f"{number} ({between})"

    @property
    def healthy_text(self) -> str:
        """The band of `healthy` for people, in the unit of the value."""
        low, high = (number_of(x, self.unit, 3) for x in self.healthy)
        return f"{low} to {high}"


@dataclass(frozen=True)
class Covariate:
    """The covariate that was estimated with a recording, such as its load."""

    name: str
    unit: str  # SI
    value: float
    healthy: tuple[float, float]  # range of healthy recordings

    @property
    def outside(self) -> float:
        """How far it lies outside of that range, over the larger of its ends."""
        low, high = self.healthy
        beyond = max(low - self.value, self.value - high, 0.0)
        return beyond / max(abs(low), abs(high), 1e-12)

    @property
    def range_text(self) -> str:
        """The range of healthy recordings, for people."""
        low, high = self.healthy
        return f"{low:.4g} to {high:.4g} {self.unit}"

    @property
    def key(self) -> str:
        """Name with unit, for tables: ``load_N``."""
        return f"{self.name}_{self.unit}".rstrip("_")

    def __str__(self) -> str:
        return said(self.value, self.unit, 3)


@dataclass(frozen=True)
class Standing:
    """Where recordings stand beside the healthy population, for kinds that are judged by one."""

    distance: float  # from the healthy mean, where healthy ones have about 1
    # scores of the features furthest from health, by name
    evidence: Mapping[str, float] = field(default_factory=dict)
    # measurements beside the twin, by name, SI
    statistics: Mapping[str, float] = field(default_factory=dict)
    covariate: Covariate | None = None  # such as the load; None for a kind without one

    @property
    def measured(self) -> dict[str, float]:
        """Covariate and statistics by name."""
        one = self.covariate
        return {**({} if one is None else {one.key: one.value}), **self.statistics}


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on one recording, or on the recordings of a run together, with its values.

    Attributes
    ----------
    name : of the recording or run
    labels : from the file
    verdict : Verdict
    magnitudes : faults, or quantities that the kind reports
    motions : how many recordings it rests on
    alarm : whether somebody should look: at a fault, and at a change beyond a healthy population
    notes : sentences
    probabilities : of each fault; none where the recording is a ground for no verdict
    when : time at which its first recording began, ISO 8601, or None
    standing : beside the healthy population; None where that did not judge
    identification : source of the values; None where the population alone was asked
    actuator : its serial number or name, where several are judged
    """

    name: str
    labels: dict[str, str]
    verdict: Verdict
    magnitudes: tuple[Magnitude, ...]
    motions: int = 1
    alarm: bool = False
    notes: tuple[str, ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict)
    when: str | None = None
    standing: Standing | None = None
    identification: Identification | None = field(default=None, repr=False, compare=False)
    actuator: str = ""

    @property
    def title(self) -> str:
        """Actuator and name."""
        return f"{self.actuator} {self.name}".strip()

    @property
    def grade(self) -> Grade:
        """The grade of the verdict."""
        return self.verdict.grade

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults; none unless the grade is "fault"."""
        return self.verdict.faults

    @property
    def reason(self) -> str:
        """A sentence on why this grade."""
        return self.verdict.reason or self.verdict.sentence

    @property
    def fault(self) -> str:
        """The faults in one text, `UNNAMED` for another alarm, "" without one."""
        return ", ".join(self.faults) or (UNNAMED if self.alarm else "")

    @property
    def said(self) -> str:
        """Names of the faults or grade, for tables."""
        if self.grade == "none":
            return "no verdict"
        return self.fault or self.grade

    @property
    def row(self) -> dict[str, object]:
        """It as a row of a table: labels, verdict, each magnitude with its interval."""
        found: dict[str, object] = {"actuator": self.actuator} if self.actuator else {}
        found |= {"name": self.name, **self.labels, "motions": self.motions}
        if self.standing is not None:
            found["distance"] = self.standing.distance
        found |= {name: getattr(self, name) for name in ("alarm", "fault", "grade", "reason")}
        for m in self.magnitudes:
            unit = m.unit.replace("*", "").replace(" ", "")
            key = f"{m.name}_{unit}" if unit not in ("", "x") else m.name
            found |= {key: m.value, f"{key}_low": m.low, f"{key}_high": m.high}
        return found if self.standing is None else found | self.standing.measured

    def _repr_html_(self) -> str:
        """The verdict, then the magnitudes, in a notebook."""
        rows = [(m.name, str(m), m.healthy_text) for m in self.magnitudes]
        header = ("quantity", "value (95 %)", "healthy")
        said = f"{self.title}: {self.verdict.sentence}"
        return html(said, header, rows, self.notes, grade=self.grade)

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        direct = ("name", "when", "labels", "motions", "alarm", "grade", "faults", "reason")
        of_each = ("value", "unit", "low", "high", "healthy", "score")
        at = self.standing
        found = {name: getattr(self, name) for name in direct} | {
            "sentence": self.verdict.sentence,
            "fault": self.fault or None,
            "probability": self.probabilities,
            "magnitudes": {m.name: {n: getattr(m, n) for n in of_each} for m in self.magnitudes},
        }
        if at is not None:
            found |= {"distance": at.distance, **at.measured, "evidence": at.evidence}
        return plain(found | {"notes": self.notes})


@dataclass(frozen=True)
class Detection:
    """Diagnoses of recordings and of runs, of one actuator or of several.

    Attributes
    ----------
    motions : of each recording
    runs : of the recordings of each run together, where a healthy population judges; else of each
        recording
    calibrations : of each actuator, by its serial number or name; by "" where one alone is judged
    missing : how many recordings are left after an interruption
    """

    motions: tuple[Diagnosis, ...]
    runs: tuple[Diagnosis, ...]
    calibrations: Mapping[str, Calibration]
    missing: int = 0

    @classmethod
    def of(cls, parts: Mapping[str, Self], not_begun: int) -> Self:
        """Several actuators together; ``not_begun`` recordings are of others."""
        motions, runs = (
            tuple(
                replace(row, actuator=name) for name, one in parts.items() for row in one.each(each)
            )
            for each in ("motion", "run")
        )
        known = {name: one.calibrations[""] for name, one in parts.items()}
        return cls(motions, runs, known, not_begun + sum(one.missing for one in parts.values()))

    def __getitem__(self, actuator: str) -> Self:
        """The part of one actuator; how many recordings are missing is known of all together."""
        motions, runs = (
            tuple(row for row in rows if row.actuator == actuator)
            for rows in (self.motions, self.runs)
        )
        return type(self)(motions, runs, {actuator: self.calibrations[actuator]})

    @property
    def actuators(self) -> "dict[str, Self]":
        """The part of each actuator."""
        return {name: self[name] for name in self.calibrations}

    @property
    def is_named(self) -> bool:
        """Whether its actuators have names, as in a table of runs."""
        return "" not in self.calibrations

    @property
    def grade(self) -> Grade:
        """The grade of the run that somebody has to look at first."""
        grades = [one.grade for one in self.runs]
        order: tuple[Grade, ...] = ("fault", "changed", "none")
        return next((grade for grade in order if grade in grades), "healthy")

    @property
    def by_run(self) -> bool:
        """Whether recordings of a run are judged together as well."""
        return any(one.standing is not None for one in self.runs)

    @property
    def sentence(self) -> str:
        """How many actuators and runs raise an alarm, and for which faults."""
        kind = "runs" if self.by_run else "recordings"
        said = counted(self.runs, kind)
        names = Counter(
            name for one in self.runs for name in one.faults or ((one.fault,) if one.alarm else ())
        )
        if names:
            said += f": {'; '.join(f'{fault} in {count}' for fault, count in names.items())}"
        if self.missing:
            said += f". Interrupted: {self.missing} more were not judged"
        return f"{self._said_of_actuators()}{said}."

    def _said_of_actuators(self) -> str:
        if len(self.calibrations) < 2:
            return ""
        faulty: dict[str, dict[str, None]] = {}
        for run in self.runs:
            if run.alarm:
                faulty.setdefault(run.actuator, {})[run.fault] = None
        told = [f"{name} ({', '.join(faults)})" for name, faults in faulty.items()]
        said = f"{len(told)} of {len(self.calibrations)} actuators raise an alarm"
        return f"{said}: {listed(told)}. " if told else f"{said}. "

    def rows(self, each: str = "run") -> list[dict[str, object]]:
        """A row of a table for each verdict."""
        return [one.row for one in self.each(each)]

    def to_frame(self, each: str = "run") -> Any:
        """A pandas DataFrame with a row for each "run" or "motion"; needs pandas."""
        return frame(self.rows(each), "actuator" if self.is_named else "name")

    to_dataframe = to_frame

    def plot(self, each: str = "run") -> Any:
        """The trend over runs, or over motions, of one actuator: a figure of plotly."""
        if len(self.calibrations) > 1:
            first = next(iter(self.calibrations), "NAME")
            raise InputError(f"A trend is of one actuator; plot one, e.g. found[{first!r}].plot().")
        return drawn(self, each, dict.fromkeys(("run", "motion"), "plot_trend"), each)

    def report(self, path: str | Path) -> None:
        """Write its page (.html), which holds all that it shows."""
        page_written(self, path, "report.detection:detection_page")

    def each(self, each: str) -> tuple[Diagnosis, ...]:
        """Diagnoses of each "run" or of each "motion"."""
        if each not in ("run", "motion"):
            raise InputError(f"each must be run or motion, received {each!r}.")
        return self.runs if each == "run" else self.motions

    def __str__(self) -> str:
        return "\n".join([self.sentence, *(f"{one.title}: {one.verdict}" for one in self.runs)])

    def _repr_html_(self) -> str:
        """How many raise an alarm, then each run, in a notebook."""
        rows = [(one.title, one.said, one.reason) for one in self.runs]
        marked = [n for n, one in enumerate(self.runs) if one.alarm]
        header, notes = ("run", "verdict", "because"), gathered_notes(self.runs)
        return html(self.sentence, header, rows, notes, grade=self.grade, marked=marked)


def name_of(recording: Recording, labels: dict[str, str], one_source: bool) -> str:
    """Labels for tables, with the file where there are several or no labels."""
    said = label_text(labels)
    return said if said and one_source else f"{recording.source} {said}".strip()


def counted(rows: Sequence[Diagnosis], kind: str) -> str:
    """How many raise an alarm, and of how many of the rest something is to be said."""
    said = f"{sum(one.alarm for one in rows)} of {len(rows)} {kind} raise an alarm"
    rest = Counter(one.grade for one in rows if not one.alarm)
    if rest["changed"]:
        said += f", {rest['changed']} changed by no more than may drift"
    if rest["none"]:
        said += f", {rest['none']} without a verdict"
    return said


def gathered_notes(rows: Sequence[Diagnosis]) -> list[str]:
    """The notes of many, alike ones once, each with how many have it."""
    seen: dict[str, list[tuple[str, str]]] = {}
    for one in rows:
        for note in one.notes:
            seen.setdefault(note.partition(" (")[0], []).append((one.title, note))
    return [
        f"{found[0][0]}: {found[0][1]}"
        + (f" {len(found)} of {len(rows)} are like this." if len(found) > 1 else "")
        for found in seen.values()
    ]


def gathered_reasons(rows: Sequence[Diagnosis]) -> list[str]:
    """Why verdicts are other than healthy, the first of each name or grade."""
    found: dict[str, str] = {}
    for one in rows:
        if one.grade != "healthy":
            found.setdefault(one.said, f"{one.said}: {one.reason}")
    return list(found.values())
