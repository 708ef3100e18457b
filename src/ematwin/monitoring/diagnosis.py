"""Diagnosis: the verdict on a recording with its values, as a row of a table."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ematwin.estimation.identification import Identification
from ematwin.estimation.verdict import UNNAMED, Grade, Verdict
from ematwin.showing.results import html, plain
from ematwin.showing.text import number_of, said, said_between


@dataclass(frozen=True)
class Magnitude:
    """A fault, or another reported quantity, with its interval."""

    name: str
    unit: str
    value: float  # value, low, high: in ``unit``, with the 95 % interval
    low: float
    high: float
    healthy: tuple[float, float]  # band in which 95 % of healthy recordings lie
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
        said, header = (
            f"{self.title}: {self.verdict.sentence}",
            ("quantity", "value (95 %)", "healthy"),
        )
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
