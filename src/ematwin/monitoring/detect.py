"""``detect``: a verdict on motions, one by one and by the run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ematwin.monitoring.calibrate import measure, numbered
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.index import health_index
from ematwin.monitoring.measure import REPORTED, reported_values
from ematwin.monitoring.naming import UNNAMED, Name, named_by_physics, named_by_signature
from ematwin.signals.motion import Motion, label_text

COVERAGE = 1.96  # standard deviations of an interval: 95 %
_ENDS = np.array([-1.0, 1.0])
_REWIRED = 6.0  # healthy standard deviations of the sensor coupling
_STRANGE = 12.0  # root mean square of scores; seeded faults of a real rig reach 4


@dataclass(frozen=True)
class Magnitude:
    """A reported magnitude with its interval.

    Attributes
    ----------
    value, low, high : in the unit of `ematwin.monitoring.measure.REPORTED`; the interval is what
        healthy runs scatter by, around the value
    healthy : (2,) band in which 95 % of healthy motions of other runs lie
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
class Verdict:
    """What is said of one motion, or of the motions of a run together.

    Attributes
    ----------
    name : of the motion or run
    labels : what the file says of it
    motions : how many it rests on
    magnitudes : friction, backlash, gain, roughness
    load : N, estimated
    index, threshold : health index and where the alarm begins
    fault : name of the fault, "" without an alarm
    named_by : "physics", "signature" or ""
    coupling : A/m, of the sensors
    evidence : the features furthest from health: name to score
    notes : sentences
    """

    name: str
    labels: dict[str, str]
    motions: int
    magnitudes: tuple[Magnitude, ...]
    load: float
    index: float
    threshold: float
    fault: str
    named_by: str
    coupling: float
    evidence: dict[str, float]
    notes: tuple[str, ...]

    @property
    def alarm(self) -> bool:
        """Whether the index is above its threshold."""
        return self.index > self.threshold

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {
            "name": self.name,
            "labels": self.labels,
            "motions": self.motions,
            "index": self.index,
            "threshold": self.threshold,
            "alarm": self.alarm,
            "fault": self.fault or None,
            "named_by": self.named_by or None,
            "magnitudes": {
                m.name: {
                    "value": m.value, "unit": m.unit, "low": m.low, "high": m.high,
                    "healthy": list(m.healthy), "score": m.score,
                }
                for m in self.magnitudes
            },
            "load_N": self.load,
            "sensor_coupling": self.coupling,
            "evidence": self.evidence,
            "notes": list(self.notes),
        }  # fmt: skip


@dataclass(frozen=True)
class Detection:
    """Verdicts on motions and on runs."""

    motions: tuple[Verdict, ...]
    runs: tuple[Verdict, ...]
    calibration: Calibration


def detect(motions: list[Motion], calibration: Calibration | str | Path) -> Detection:
    """Judge motions against the healthy population, each alone and each run together.

    Raises
    ------
    RecordError
        If a motion is of another command, rate or rig.
    """
    if not isinstance(calibration, Calibration):
        calibration = Calibration.load(calibration)
    features, measured = measure(calibration, motions)
    load = measured.load
    scores = calibration.population.scores(features, load)
    values = reported_values(calibration.layout, features)
    groups = numbered([motion.together for motion in motions])
    one_source = len({motion.source for motion in motions}) == 1
    judge = _Judge(calibration, scores, values, load, measured.coupling)
    single = tuple(
        judge.verdict(
            np.array([n]), _name_of(motion.source, motion.labels, one_source), motion.labels
        )
        for n, motion in enumerate(motions)
    )
    together = []
    for g in np.unique(groups):
        members = np.flatnonzero(groups == g)
        labels = {k: v for k, v in motions[members[0]].labels.items() if k != "motion"}
        name = _name_of(motions[members[0]].source, labels, one_source)
        together.append(judge.verdict(members, name, labels))
    return Detection(single, tuple(together), calibration)


def _name_of(source: str, labels: dict[str, str], one_source: bool) -> str:
    """Labels for tables, with the file where there are several or no labels."""
    said = label_text(labels)
    return said if said and one_source else f"{source} {said}".strip()


def gathered_notes(verdicts: tuple[Verdict, ...]) -> list[str]:
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
    def __init__(
        self,
        calibration: Calibration,
        scores: np.ndarray,
        values: np.ndarray,
        load: np.ndarray,
        coupling: np.ndarray,
    ) -> None:
        self._calibration = calibration
        self._scores, self._values, self._load = scores, values, load
        self._coupling = coupling
        reported = calibration.reported
        self._healthy = reported.mean(load)

    def verdict(self, members: np.ndarray, name: str, labels: dict[str, str]) -> Verdict:
        """The verdict on some motions taken together."""
        calibration = self._calibration
        limit = calibration.thresholds.of(len(members))
        scores = self._scores[members]
        mean = scores.mean(0)
        index = float(health_index(mean[None], calibration.layout.kinds)[0])
        magnitudes = self._magnitudes(members)
        named = Name("", "")
        if index > limit:
            named = self._name(scores, self._load[members], magnitudes)
        order = np.argsort(-np.abs(mean))[:4]
        names = calibration.layout.names
        return Verdict(
            name=name,
            labels=labels,
            motions=len(members),
            magnitudes=magnitudes,
            load=float(self._load[members].mean()),
            index=index,
            threshold=limit,
            fault=named.fault,
            named_by=named.by,
            coupling=float(self._coupling[members].mean()),
            evidence={names[n]: float(mean[n]) for n in order},
            notes=tuple(self._notes(members)),
        )

    def _name(
        self, scores: np.ndarray, load: np.ndarray, magnitudes: tuple[Magnitude, ...]
    ) -> Name:
        calibration = self._calibration
        if calibration.signatures:
            scale = calibration.population.load_scale
            named = named_by_signature(scores, load, scale, calibration.signatures)
            if named.fault != UNNAMED:
                return named
        return named_by_physics({m.name: m.score for m in magnitudes})

    def _magnitudes(self, members: np.ndarray) -> tuple[Magnitude, ...]:
        reported = self._calibration.reported
        within = reported.within / np.sqrt(len(members))
        spread = np.hypot(within, reported.between)
        value = self._values[members].mean(0)
        healthy = self._healthy[members].mean(0)
        found = []
        for n, (name, (unit, _)) in enumerate(REPORTED.items()):
            reach = COVERAGE * spread[n]
            ends = np.r_[value[n], value[n] + reach * _ENDS, healthy[n] + reach * _ENDS]
            if name == "backlash":
                shown = np.maximum(ends, 0.0) * 1e3
            else:
                shown = np.exp(ends - healthy[n])  # times the healthy mean at this load
            found.append(
                Magnitude(
                    name, unit, float(shown[0]), float(shown[1]), float(shown[2]),
                    (float(shown[3]), float(shown[4])),
                    float((value[n] - healthy[n]) / max(spread[n], 1e-12)),
                )
            )  # fmt: skip
        return tuple(found)

    def _notes(self, members: np.ndarray) -> list[str]:
        calibration = self._calibration
        notes = []
        mean, spread = calibration.coupling
        coupling = float(self._coupling[members].mean())
        if abs(coupling - mean) > _REWIRED * max(spread, 0.05 * abs(mean)):
            notes.append(
                f"The sensors share fast noise otherwise than in the healthy runs ({coupling:.3g} "
                f"A/m, healthy {mean:.3g}): rewiring and reassembly do that, and so may rough "
                "running. It is taken out of the current before the verdict."
            )
        low, high = calibration.load_range
        slack = 0.15 * max(abs(low), abs(high))
        load = float(self._load[members].mean())
        if not low - slack <= load <= high + slack:
            notes.append(
                f"Its load lies outside that of the healthy motions (about {load:.4g} N, where "
                f"they had {low:.4g} to {high:.4g} N): what is healthy there is extrapolated."
            )
        if float(np.sqrt(np.mean(self._scores[members].mean(0) ** 2))) > _STRANGE:
            notes.append(
                "It is so unlike the healthy motions that another rig or a wrong unit is likelier "
                "than a fault; check the channels."
            )
        return notes
