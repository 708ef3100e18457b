"""A calibration with the healthy population, and its tables in the file of the calibration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.estimation.baseline import Baseline, uncertain
from ematwin.estimation.prior import Prior
from ematwin.models.base import Model, Reported
from ematwin.models.parameter_set import ParameterSet
from ematwin.monitoring.calibration import FORMAT, Calibration
from ematwin.monitoring.classification import Signature
from ematwin.monitoring.features import Layout
from ematwin.monitoring.gather import Given, recordings_of
from ematwin.monitoring.healthy import HealthyRuns, Learning
from ematwin.monitoring.index import clear_limit
from ematwin.monitoring.measure import Bench, Measured, layout_of
from ematwin.monitoring.population import Population
from ematwin.monitoring.scores import Scores

_DIGITS = 9
_FITTED = 0.01  # of a logarithm: error of a fitted parameter, where older versions kept none


@dataclass(frozen=True)
class Thresholds:
    """Index above which an alarm is raised.

    Attributes
    ----------
    motion : of one recording
    run : of a run of ``run_size`` recordings, from their mean scores
    false_alarm_rate : of either, on a healthy run of another day
    """

    motion: float
    run: float
    run_size: float
    false_alarm_rate: float

    def of(self, motions: int) -> float:
        """The threshold for this many recordings of a run together.

        The square of the index falls with their number n as B + W/n, since differences between
        runs do not average out.
        """
        if self.run_size <= 1.0 or self.run >= self.motion:
            return self.motion
        size = self.run_size
        between = max((size * self.run**2 - self.motion**2) / (size - 1.0), 0.0)
        within = self.motion**2 - between
        return float(np.sqrt(between + within / min(float(motions), size)))


@dataclass(frozen=True)
class PopulationCalibration(Calibration):
    """A calibration with the healthy population, which judges kinds that one descent fits.

    Attributes
    ----------
    command : (S,) array, SI; ``interval`` s
    settling_time : s
    channels : names of the C channels that are compared
    discrepancy : (3, C S) or (1, C S) array: mean residual of the twin on healthy recordings,
        one channel after another, SI, over the covariate
    population : of the features
    reported : population of the reported quantities (`Monitoring.reported`)
    thresholds : of the index
    statistics : healthy mean and standard deviation of measurements beside the twin, by name
    covariate_range : least and largest covariate of the healthy recordings, SI; None without one
    signatures : known faults
    facts : runs, files, version
    healthy : features of each healthy recording, to which later ones can be added; None in
        calibrations of versions that did not keep them
    """

    command: np.ndarray
    interval: float
    settling_time: float
    channels: tuple[str, ...]
    discrepancy: np.ndarray
    population: Population
    reported: Population
    thresholds: Thresholds
    statistics: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    covariate_range: tuple[float, float] | None = None
    signatures: tuple[Signature, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    healthy: HealthyRuns | None = None

    @property
    def quantities(self) -> tuple[Reported, ...]:
        """Reported quantities of its kind."""
        return self.model.monitoring.reported(self.model, self.actuator)

    @cached_property
    def layout(self) -> Layout:
        """The features of its recordings."""
        return layout_of(
            self.model, self.actuator, self.command, self.interval, self.settling_time,
            self.channels,
        )  # fmt: skip

    @property
    def learning(self) -> Learning:
        """How population and thresholds follow from the healthy runs.

        Raises
        ------
        ValueError
            If they were not kept.
        """
        if self.healthy is None:
            raise ValueError("its healthy recordings were not kept")
        return Learning(self.model, self.actuator, self.layout, self.healthy, self.population.scale)

    def clear_limit(self, motions: int) -> float:
        """The index from which a change without a name raises an alarm, for this many recordings.

        It lies above the threshold by the drift between occasions.
        """
        return clear_limit(self.thresholds.of(motions), self.layout.kinds, len(self.channels))

    def measure(self, recordings: Given) -> Measured:
        """Estimates and features of recordings, or of those in files.

        Raises
        ------
        RecordError
            If one of them follows another command, has another rate, or is implausible.
        """
        bench = Bench(
            self.model, self.actuator, recordings_of(recordings, self.actuator), self.command,
            self.interval, self.settling_time, self.channels,
        )  # fmt: skip
        first = bench.fit()
        return bench.measured(bench.fit(self.discrepancy, self.population.scale, first))

    def scores(self, recordings: "Given | Measured") -> Scores:
        """How far recordings, or measurements of them, lie from health, feature by feature."""
        measured = recordings if isinstance(recordings, Measured) else self.measure(recordings)
        values = self.population.scores(measured.features, measured.covariate)
        return Scores(values, self.layout.names, self.layout.kinds, measured.groups)

    def tested(self) -> Scores:
        """Scores of the healthy recordings that set the thresholds, each left out of learning.

        Raises
        ------
        ValueError
            If they were not kept.
        """
        learning = self.learning
        held_back = np.isin(learning.healthy.runs, self.facts.get("held_back", []))
        values, groups = learning.tested(held_back)
        return Scores(values, self.layout.names, self.layout.kinds, groups)

    def _table(self, sources: Mapping[str, str] | None) -> dict[str, Any]:
        learnt: dict[str, Any] = {
            "format": FORMAT,
            "ematwin": __version__,
            "interval": self.interval,
            "settling_time": self.settling_time,
            "channels": list(self.channels),
            "magnitudes": list(self.layout.magnitudes),
            "quantities": [one.name for one in self.quantities],
            "threshold": vars(self.thresholds).copy(),
            "statistics": {name: list(pair) for name, pair in self.statistics.items()},
            "facts": self.facts,
            "command": _plain(self.command),
            "discrepancy": _plain(self.discrepancy),
            "population": _population_table(self.population),
            "reported": _population_table(self.reported),
        }
        if self.covariate_range is not None:
            learnt["covariate_range"] = list(self.covariate_range)
        if self.healthy is not None:
            learnt["healthy"] = self.healthy.as_table(_DIGITS)
        return {
            **super()._table(sources),
            "calibration": learnt,
            "signature": [
                {"fault": s.fault, "source": s.source, "coefficients": _plain(s.coefficients)}
                for s in self.signatures
            ],
        }

    def check(
        self, magnitudes: Sequence[str] | None = None, quantities: Sequence[str] | None = None
    ) -> None:
        """Raise `ValueError` unless all parts fit together, and to the kind as it is now.

        ``magnitudes`` and ``quantities`` name the features and the reported quantities with which
        it was made.
        """
        numbers = [self.interval, *vars(self.thresholds).values()]
        if not all(np.isfinite(x) and x > 0.0 for x in numbers):
            raise ValueError(f"{numbers} must be positive")
        if not (np.isfinite(self.settling_time) and self.settling_time >= 0.0):
            raise ValueError(f"the settling time is {self.settling_time}")
        reported = [one.name for one in self.quantities]
        for made, now in ((magnitudes, list(self.layout.magnitudes)), (quantities, reported)):
            if made is not None and list(made) != now:
                raise ValueError(f"it knows {', '.join(made)}, the kind {', '.join(now)}")
        covariate = self.model.monitoring.covariate
        if (covariate is None) != (self.covariate_range is None):
            raise ValueError(f"the range of the covariate is {self.covariate_range}")
        rows = 1 if covariate is None else 3
        features = len(self.layout.names)
        arrays: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {}
        samples = len(self.channels) * self.command.size
        arrays["discrepancy"] = (self.discrepancy, (rows, samples))
        for name, part, count in (
            ("population", self.population, features), ("reported", self.reported, len(reported)),
        ):  # fmt: skip
            if (part.scale is None) != (covariate is None):
                raise ValueError(f"the scale of {name} is {part.scale}")
            arrays[name] = (part.coefficients, (rows, count))
            arrays[f"{name} within"] = (part.within, (count,))
            arrays[f"{name} between"] = (part.between, (count,))
        for s in self.signatures:
            arrays[f"signature {s.fault}"] = (s.coefficients, (rows, features))
        if self.healthy is not None:
            count = len(self.healthy.runs)
            arrays["healthy features"] = (self.healthy.features, (count, features))
            arrays["healthy values"] = (self.healthy.values, (count, len(reported)))
            shape = (count, len(self.layout.magnitudes))
            arrays["healthy errors"] = (self.healthy.errors, shape)
        for name, (values, wanted) in arrays.items():
            if values.shape != wanted:
                raise ValueError(f"{name} has the shape {values.shape}, not {wanted}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} holds values that are not finite")


def population_in(
    actuator: ParameterSet,
    baseline: Baseline,
    learnt: Mapping[str, Any],
    signatures: Sequence[Mapping[str, Any]],
) -> PopulationCalibration:
    """The calibration in the tables of a file; raises `ValueError` if its parts do not fit."""
    within = learnt.get("covariate_range")
    found = PopulationCalibration(
        actuator=actuator,
        baseline=baseline,
        command=np.array(learnt["command"], dtype=float),
        interval=float(learnt["interval"]),
        settling_time=float(learnt["settling_time"]),
        channels=tuple(learnt["channels"]),
        discrepancy=np.array(learnt["discrepancy"], dtype=float),
        population=_population(learnt["population"]),
        reported=_population(learnt["reported"]),
        thresholds=Thresholds(**learnt["threshold"]),
        statistics={
            name: (float(pair[0]), float(pair[1])) for name, pair in learnt["statistics"].items()
        },
        covariate_range=None if within is None else (float(within[0]), float(within[1])),
        signatures=tuple(
            Signature(s["fault"], np.array(s["coefficients"], dtype=float), s["source"])
            for s in signatures
        ),
        facts=dict(learnt.get("facts", {})),
        healthy=HealthyRuns.from_table(learnt["healthy"]) if "healthy" in learnt else None,
    )
    found.check(learnt.get("magnitudes"), learnt.get("quantities"))
    return found


def _plain(values: np.ndarray) -> Any:
    return np.vectorize(lambda x: float(f"{x:.{_DIGITS}g}"))(values).tolist()


def _population_table(population: Population) -> dict[str, Any]:
    scale = {} if population.scale is None else {"scale": population.scale}
    return {
        **scale,
        "coefficients": _plain(population.coefficients),
        "within": _plain(population.within),
        "between": _plain(population.between),
    }


def _population(table: Mapping[str, Any]) -> Population:
    return Population(
        float(table["scale"]) if "scale" in table else None,
        np.array(table["coefficients"], dtype=float),
        np.array(table["within"], dtype=float),
        np.array(table["between"], dtype=float),
    )


def older_baseline(model: Model, actuator: ParameterSet, learnt: Mapping[str, Any]) -> Baseline:
    """How well parameters are known by a calibration that did not say so."""
    prior = Prior.independent(uncertain(model, actuator))
    facts = learnt.get("facts", {})
    undetermined = set(facts.get("undetermined", []))
    fitted = [n for n, p in enumerate(prior.names) if p in model.nominal and p not in undetermined]
    covariance = prior.covariance.copy()
    covariance[fitted, fitted] = _FITTED**2
    magnitudes = [one.name for one in model.faults(actuator) if one.direction_of is None]
    spread = _population(learnt["population"]).spread.tolist()
    return Baseline(
        Prior(prior.names, prior.mean, covariance),
        scatter=dict(zip(magnitudes, spread, strict=False)),
        recordings=max(1, len(facts.get("runs", []))),
    )


def from_first_format(learnt: Mapping[str, Any]) -> dict[str, Any]:
    """What version 0.1 wrote, which knew ball screws only, as it is written now."""
    coupling = learnt["coupling"]
    return {
        **learnt,
        "command": learnt["set_point"],
        "channels": ["current", "position_error"],
        "statistics": {"sensor_coupling": (coupling[0], coupling[1])},
        "covariate_range": learnt["load_range"],
        **{
            name: {**learnt[name], "scale": learnt[name]["load_scale"]}
            for name in ("population", "reported")
        },
    }
