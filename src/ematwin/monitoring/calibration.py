"""Calibration: an actuator with its healthy population, as `calibrate` makes and `detect` takes it.

It is one TOML file: a parameter file of the actuator with the tables ``calibration`` (what was
learnt from which runs) and ``signature`` (known faults) beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ematwin import __version__
from ematwin.errors import ParameterError
from ematwin.monitoring.features import Layout
from ematwin.monitoring.measure import REPORTED
from ematwin.monitoring.phases import phases
from ematwin.monitoring.population import Population
from ematwin.plant.ball_screw import BallScrew
from ematwin.readers.files import written_whole
from ematwin.validation import load_toml

FORMAT = 1
_DIGITS = 9


@dataclass(frozen=True)
class Signature:
    """Mean scores of motions with a known fault, over the load.

    Attributes
    ----------
    fault : its name
    coefficients : (3, F) array, as in `Population`
    source : what it was learnt from
    """

    fault: str
    coefficients: np.ndarray
    source: str


@dataclass(frozen=True)
class Thresholds:
    """Index above which an alarm is raised.

    Attributes
    ----------
    motion : of one motion
    run : of a run of ``run_size`` motions, from their mean scores
    false_alarm_rate : of either, on a healthy run of another day
    """

    motion: float
    run: float
    run_size: float
    false_alarm_rate: float

    def of(self, motions: int) -> float:
        """The threshold for this many motions of a run together.

        The square of the index falls with their number n as B + W/n, since what is between runs
        does not average out.
        """
        if self.run_size <= 1.0 or self.run >= self.motion:
            return self.motion
        size = self.run_size
        between = max((size * self.run**2 - self.motion**2) / (size - 1.0), 0.0)
        within = self.motion**2 - between
        return float(np.sqrt(between + within / min(float(motions), size)))


@dataclass(frozen=True)
class Calibration:
    """What `detect` and `identify` need of the healthy actuator.

    Attributes
    ----------
    actuator : BallScrew, nominal
    set_point : (S,) array, m; ``interval`` s
    settling_time : s
    discrepancy : (3, 2 S) array: what the twin misses of current (A) and position error (m) on
        healthy motions, over the load
    population : of the features
    reported : population of the magnitudes that are reported (`REPORTED`)
    thresholds : of the index
    coupling : (2,) healthy mean and standard deviation of the sensor coupling, A/m
    load_range : (2,) least and largest load of the healthy motions, N
    signatures : known faults
    facts : runs, files, version
    """

    actuator: BallScrew
    set_point: np.ndarray
    interval: float
    settling_time: float
    discrepancy: np.ndarray
    population: Population
    reported: Population
    thresholds: Thresholds
    coupling: tuple[float, float]
    load_range: tuple[float, float]
    signatures: tuple[Signature, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def layout(self) -> Layout:
        """The features of its motions."""
        return Layout.of(phases(self.set_point, self.interval, self.settling_time))

    def save(self, path: str | Path, sources: Mapping[str, str]) -> None:
        """Write the TOML file, whole or not at all.

        ``sources`` says where the values of parameters come from, by place.
        """
        table = {
            **_actuator_table(self.actuator, sources),
            "calibration": {
                "format": FORMAT,
                "ematwin": __version__,
                "interval": self.interval,
                "settling_time": self.settling_time,
                "coupling": list(self.coupling),
                "load_range": list(self.load_range),
                "threshold": vars(self.thresholds).copy(),
                "facts": self.facts,
                "set_point": _plain(self.set_point),
                "discrepancy": _plain(self.discrepancy),
                "population": _population_table(self.population),
                "reported": _population_table(self.reported),
            },
            "signature": [
                {"fault": s.fault, "source": s.source, "coefficients": _plain(s.coefficients)}
                for s in self.signatures
            ],
        }
        with written_whole(path) as draft:
            draft.write_text(tomli_w.dumps(table), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> "Calibration":
        """Read what `save` wrote.

        Raises
        ------
        ParameterError
            If the file holds no calibration, one of a newer version, or a damaged one.
        FileError
            If it cannot be read.
        """
        path = Path(path)
        table = load_toml(path, "calibration")
        learnt = table.pop("calibration", None)
        if not isinstance(learnt, dict):
            raise ParameterError(
                f"{path} holds an actuator but no calibration; make one with ematwin calibrate."
            )
        written = learnt.get("format", FORMAT)
        if isinstance(written, int) and written > FORMAT:
            raise ParameterError(
                f"{path} was written by a newer ematwin (format {written}, this one knows "
                f"{FORMAT}). Update ematwin."
            )
        signatures = table.pop("signature", [])
        actuator = BallScrew.from_dict(table, str(path))
        try:
            if not isinstance(written, int):
                raise ValueError(f"its format is {written!r}")
            found = cls(
                actuator=actuator,
                set_point=np.array(learnt["set_point"], dtype=float),
                interval=float(learnt["interval"]),
                settling_time=float(learnt["settling_time"]),
                discrepancy=np.array(learnt["discrepancy"], dtype=float),
                population=_population(learnt["population"]),
                reported=_population(learnt["reported"]),
                thresholds=Thresholds(**learnt["threshold"]),
                coupling=(float(learnt["coupling"][0]), float(learnt["coupling"][1])),
                load_range=(float(learnt["load_range"][0]), float(learnt["load_range"][1])),
                signatures=tuple(
                    Signature(s["fault"], np.array(s["coefficients"], dtype=float), s["source"])
                    for s in signatures
                ),
                facts=dict(learnt.get("facts", {})),
            )
            found.check()
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ParameterError(
                f"{path}: its calibration is damaged ({type(error).__name__}: {error}). Make it "
                "anew with ematwin calibrate."
            ) from None
        return found

    def check(self) -> None:
        """Raise `ValueError` unless all parts fit together."""
        numbers = [self.interval, self.settling_time, *vars(self.thresholds).values()]
        if not all(np.isfinite(x) and x > 0.0 for x in numbers):
            raise ValueError(f"{numbers} must be positive")
        features = len(self.layout.names)
        arrays: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {}
        arrays["discrepancy"] = (self.discrepancy, (3, 2 * self.set_point.size))
        for name, part, count in (
            ("population", self.population, features), ("reported", self.reported, len(REPORTED)),
        ):  # fmt: skip
            arrays[name] = (part.coefficients, (3, count))
            arrays[f"{name} within"] = (part.within, (count,))
            arrays[f"{name} between"] = (part.between, (count,))
        for s in self.signatures:
            arrays[f"signature {s.fault}"] = (s.coefficients, (3, features))
        for name, (values, wanted) in arrays.items():
            if values.shape != wanted:
                raise ValueError(f"{name} has the shape {values.shape}, not {wanted}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} holds values that are not finite")


def _actuator_table(actuator: BallScrew, sources: Mapping[str, str]) -> dict[str, Any]:
    table: dict[str, Any] = {
        "kind": actuator.kind, "name": actuator.name, "description": actuator.description,
    }  # fmt: skip
    for place, value, unit, _, source in actuator.parameters():
        section, name = place.split(".")
        table.setdefault(section, {})[name] = {
            "value": value, "unit": unit, "source": sources.get(place, source),
        }  # fmt: skip
    return table


def _plain(values: np.ndarray) -> Any:
    return np.vectorize(lambda x: float(f"{x:.{_DIGITS}g}"))(values).tolist()


def _population_table(population: Population) -> dict[str, Any]:
    return {
        "load_scale": population.load_scale,
        "coefficients": _plain(population.coefficients),
        "within": _plain(population.within),
        "between": _plain(population.between),
    }


def _population(table: Mapping[str, Any]) -> Population:
    return Population(
        float(table["load_scale"]),
        np.array(table["coefficients"], dtype=float),
        np.array(table["within"], dtype=float),
        np.array(table["between"], dtype=float),
    )
