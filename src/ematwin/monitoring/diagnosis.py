"""Diagnosis: the verdict on a recording with its values, as a row of a table."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ematwin.estimation.identification import Identification
from ematwin.estimation.verdict import UNNAMED, Grade, Verdict
from ematwin.showing import markup
from ematwin.showing.text import number_of, said, said_between


@dataclass(frozen=True)
class Magnitude:
    """A fault, or another reported quantity, with its interval.

    Attributes
    ----------
    value, low, high : in ``unit``, with the 95 % interval
    healthy : (2,) band in which 95 % of healthy recordings lie
    score : standard deviations from healthy
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    healthy: tuple[float, float]
    score: float

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
        return said(self.value, self.unit, 3)


@dataclass(frozen=True)
class Standing:
    """Where recordings stand beside the healthy population, for kinds that are judged by one.

    Attributes
    ----------
    distance : from the healthy mean, where healthy ones have about 1
    evidence : the features furthest from health: name to score
    statistics : measurements beside the twin, by name, SI
    covariate : estimated with it, such as the load; None for a kind without one
    """

    distance: float
    evidence: Mapping[str, float] = field(default_factory=dict)
    statistics: Mapping[str, float] = field(default_factory=dict)
    covariate: Covariate | None = None

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        one = self.covariate
        return {
            "distance": self.distance,
            **({} if one is None else {one.key: one.value}),
            **self.statistics,
            "evidence": dict(self.evidence),
        }


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
        at = self.standing
        if at is not None:
            found["distance"] = at.distance
        found |= {"alarm": self.alarm, "fault": self.fault}
        found |= {"grade": self.grade, "reason": self.reason}
        for m in self.magnitudes:
            unit = m.unit.replace("*", "").replace(" ", "")
            key = f"{m.name}_{unit}" if unit not in ("", "x") else m.name
            found |= {key: m.value, f"{key}_low": m.low, f"{key}_high": m.high}
        if at is None:
            return found
        if at.covariate is not None:
            found[at.covariate.key] = at.covariate.value
        return found | dict(at.statistics)

    def _repr_html_(self) -> str:
        """The verdict, then the magnitudes, in a notebook."""
        rows = [(m.name, str(m), m.healthy_text) for m in self.magnitudes]
        return "".join(
            [
                markup.verdict(f"{self.title}: {self.verdict.sentence}", self.grade),
                markup.table(("quantity", "value (95 %)", "healthy"), rows),
                *(markup.note(text) for text in self.notes),
            ]
        )

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {
            "name": self.name,
            "when": self.when,
            "labels": self.labels,
            "motions": self.motions,
            "alarm": self.alarm,
            "grade": self.grade,
            "faults": list(self.faults),
            "reason": self.reason,
            "sentence": self.verdict.sentence,
            "fault": self.fault or None,
            "probability": dict(self.probabilities),
            "magnitudes": {
                m.name: {
                    "value": m.value, "unit": m.unit, "low": m.low, "high": m.high,
                    "healthy": list(m.healthy), "score": m.score,
                }
                for m in self.magnitudes
            },
            **({} if self.standing is None else self.standing.as_dict()),
            "notes": list(self.notes),
        }  # fmt: skip
