"""A calibration with the healthy population, and its tables in the file of the calibration.

The file keeps the healthy runs; mean and scatter follow from them. Every run both teaches and
tests: the population is learnt from all of them, and how far a new run lies from it, from each run
beside the others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ematwin import __version__
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import SIGMAS
from ematwin.estimation.verdict import UNNAMED
from ematwin.models.base import Monitoring, Reported
from ematwin.models.parameter_set import ParameterSet
from ematwin.monitoring.calibration import FORMAT, Calibration
from ematwin.monitoring.measure import DIFFERENCE, Bench, Layout, Measured, Motion
from ematwin.monitoring.population import (
    DRIFT,
    Causes,
    Direction,
    Measurements,
    Population,
    Posterior,
    Scatter,
    Signature,
    basis,
    plain,
)
from ematwin.monitoring.runs import Given, recordings_of


@dataclass(frozen=True)
class PopulationCalibration(Calibration):
    """A calibration with the healthy population, which judges kinds with `Model.monitoring`."""

    motion: Motion
    # (3, C S) or (1, C S) array: mean residual of the twin on healthy recordings, one channel after
    # another, SI, over the covariate
    discrepancy: np.ndarray
    scale: float | None  # of the covariate, as in `Population`
    healthy: Measurements  # on each healthy recording
    signatures: tuple[Signature, ...] = ()  # known faults
    # labels and sources of the recordings, parameters that they left undetermined
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def monitoring(self) -> Monitoring:
        """Of its kind."""
        return Monitoring.of(self.model)

    @property
    def quantities(self) -> tuple[Reported, ...]:
        """Reported quantities of its kind."""
        return self.monitoring.reported(self.model, self.actuator)

    @cached_property
    def layout(self) -> Layout:
        """The features of its recordings."""
        return self.motion.layout(self.actuator)

    @property
    def run_spread(self) -> dict[str, tuple[float, float]]:
        """As of `ematwin.monitoring.calibration.CalibrationReport`."""
        spread = zip(self.reported.within.tolist(), self.reported.between.tolist(), strict=True)
        return {one.name: both for one, both in zip(self.quantities, spread, strict=True)}

    def values_of(self, features: np.ndarray) -> np.ndarray:
        """Reported values (N, R), SI, of features (N, F); logarithms of multiples of healthy."""
        by_name = dict(zip(self.layout.names, features.T, strict=True))
        derived, columns = self.monitoring.derived(by_name), []
        for one in self.quantities:
            if one.name not in self.layout.magnitudes:
                columns.append(derived[one.name])  # comes as the logarithm
            else:
                values = by_name[one.name]
                columns.append(np.log(values) if one.logarithmic else values)
        return np.column_stack(columns)

    @cached_property
    def values(self) -> np.ndarray:
        """(N, R), reported quantities of the healthy recordings."""
        return self.values_of(self.healthy.features)

    @cached_property
    def population(self) -> Population:
        """Of the features."""
        return self._population(self.healthy.features, dict.fromkeys(self.layout.names, False))

    @cached_property
    def reported(self) -> Population:
        """Of the reported quantities (`Monitoring.reported`)."""
        return self._population(self.values, {one.name: one.logarithmic for one in self.quantities})

    def _population(self, values: np.ndarray, logarithmic: Mapping[str, bool]) -> Population:
        """Of values (N, n) of the healthy recordings; which are logarithms, by name."""
        healthy, faults = self.healthy, {o.name: o for o in self.model.faults(self.actuator)}
        usual = np.sqrt((healthy.errors**2).mean(0))
        errors, cut = np.zeros(len(logarithmic)), np.zeros(len(logarithmic), dtype=bool)
        for n, (name, is_logarithm) in enumerate(logarithmic.items()):
            if name in self.layout.magnitudes:
                size = float(np.exp(values[:, n].mean())) if is_logarithm else 1.0
                errors[n] = usual[self.layout.magnitudes.index(name)] / size
                cut[n] = faults[name].healthy in (faults[name].lower, faults[name].upper)
        return Population.of(values, healthy.covariate, healthy.groups, self.scale, errors, cut)

    def without(self, run: str) -> "PopulationCalibration":
        """The same, learnt from all healthy runs but one."""
        return replace(self, healthy=self.healthy.part(~self.healthy.of_run(run)))

    @property
    def statistics(self) -> dict[str, tuple[float, float]]:
        """Healthy mean and standard deviation of measurements beside the twin, by name."""
        return {
            name: (float(found.mean()), float(found.std(ddof=1)))
            for name, found in self.healthy.statistics.items()
        }

    @cached_property
    def causes(self) -> Causes:
        """What may have happened to the actuator."""
        kinds = np.array(self.layout.kinds)
        drifts = [DRIFT * row for row in np.eye(len(kinds))[kinds == "model"]]
        drifts += [DRIFT * (one & (kinds == "mean")) for one in self.layout.of_channels()]
        scatter = Scatter.of(self.tested, self.healthy.groups, np.array(drifts))
        taught = [Direction(one.fault, one.coefficients, True) for one in self.signatures]
        still = np.zeros((1 if self.scale is None else 3, len(kinds)))
        others = [
            Direction(UNNAMED, still, around=np.isin(kinds, these))
            for these in (("mean", "band"), ("mean",), ("band",))
        ]
        return Causes(scatter, [*self._moved(), *taught, *others])

    def _moved(self) -> list[Direction]:
        """Directions in which reported quantities rise and fall, with the faults that do that.

        Recordings with a known fault say more than physics does on the quantities that it moves.
        """
        healthy = np.ones(len(self.layout.names))  # multiples are 1
        away = self.values_of(healthy + DIFFERENCE * np.eye(len(healthy)))
        slopes = (away - self.values_of(healthy[None])).T / DIFFERENCE  # (R, F)
        kinds, spread, found = self.layout.kinds, self.population.spread, []
        for one, slope, scatter in zip(self.quantities, slopes, self.reported.spread, strict=True):
            shift = np.zeros((1 if self.scale is None else 3, len(slope)))
            shift[0] = slope / spread / np.abs(slope / spread).max()
            # a statistic is of several features, which seldom rise alike, nor without others
            kind = kinds[int(np.argmax(np.abs(slope)))]
            around = None if kind == "model" else np.array(kinds) == kind
            moves = [s.coefficients[0] * spread @ slope / scatter for s in self.signatures]
            raised = one.named or UNNAMED
            for fault, sense in ((raised, 1.0), (raised if one.either else UNNAMED, -1.0)):
                if max((sense * move for move in moves), default=0.0) < SIGMAS:
                    found.append(Direction(fault, sense * shift, around=around))
        return found

    @cached_property
    def tested(self) -> np.ndarray:
        """Scores (N, F) of the healthy recordings, each run judged by the others."""
        scores = np.empty_like(self.healthy.features)
        for run in self.healthy.names:
            own = self.healthy.of_run(run)
            scores[own] = self.without(run).scores(self.healthy.part(own))
        return scores

    def measure(self, recordings: Given) -> Measured:
        """Estimates and features of recordings, or of those in files; errors as of `Bench`."""
        bench = Bench(self.actuator, self.motion, recordings_of(recordings, self.actuator))
        return bench.measured(bench.fit(self.discrepancy, self.scale, bench.fit()))

    def scores(self, measured: Measurements) -> np.ndarray:
        """How far measurements lie from health, (N, F), in healthy standard deviations."""
        return self.population.scores(measured.features, measured.covariate)

    def posterior(self, measured: Measurements) -> Posterior:
        """Probabilities of what happened, from recordings that are judged together."""
        return self.causes.posterior(self.scores(measured), basis(measured.covariate, self.scale))

    def _table(self, sources: Mapping[str, str] | None) -> dict[str, Any]:
        learnt: dict[str, Any] = {
            "format": FORMAT,
            "ematwin": __version__,
            "interval": self.motion.interval,
            "settling_time": self.motion.settling_time,
            "channels": list(self.motion.channels),
            "magnitudes": list(self.layout.magnitudes),
            "quantities": [one.name for one in self.quantities],
            **({} if self.scale is None else {"scale": self.scale}),
            "facts": self.facts,
            "command": plain(self.motion.command),
            "discrepancy": plain(self.discrepancy),
            "healthy": self.healthy.as_table(),
        }
        return {
            **super()._table(sources),
            "calibration": learnt,
            "signature": [
                {"fault": s.fault, "source": s.source, "coefficients": plain(s.coefficients)}
                for s in self.signatures
            ],
        }

    def check(self, magnitudes: Sequence[str], quantities: Sequence[str]) -> None:
        """Raise `ValueError` unless all parts fit together, and to the kind as it is now.

        ``magnitudes`` and ``quantities`` name the features and the reported quantities with which
        it was made.
        """
        motion, scale = self.motion, 1.0 if self.scale is None else self.scale
        if not (min(motion.interval, scale) > 0.0 <= motion.settling_time < np.inf):
            raise ValueError(f"{motion.interval}, {scale} and {motion.settling_time} do not fit")
        reported = [one.name for one in self.quantities]
        for made, now in ((magnitudes, list(self.layout.magnitudes)), (quantities, reported)):
            if list(made) != now:
                raise ValueError(f"it knows {', '.join(made)}, the kind {', '.join(now)}")
        covariate = self.monitoring.covariate
        if (covariate is None) != (self.scale is None):
            raise ValueError(f"the scale of the covariate is {self.scale}")
        rows, count = 1 if covariate is None else 3, len(self.healthy.runs)
        features, samples = len(self.layout.names), len(motion.channels) * motion.command.size
        arrays: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {
            "discrepancy": (self.discrepancy, (rows, samples)),
            "healthy features": (self.healthy.features, (count, features)),
            "healthy errors": (self.healthy.errors, (count, len(self.layout.magnitudes))),
            **{f"signature {s.fault}": (s.coefficients, (rows, features)) for s in self.signatures},
        }
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
    if learnt["format"] < FORMAT:  # which repeated what follows from the healthy runs
        learnt = {**learnt, "scale": learnt["population"].get("scale")}
    scale = learnt.get("scale")
    found = PopulationCalibration(
        actuator=actuator,
        baseline=baseline,
        motion=Motion(
            command=np.array(learnt["command"], dtype=float),
            interval=float(learnt["interval"]),
            settling_time=float(learnt["settling_time"]),
            channels=tuple(learnt["channels"]),
        ),
        discrepancy=np.array(learnt["discrepancy"], dtype=float),
        scale=None if scale is None else float(scale),
        healthy=Measurements.from_table(learnt["healthy"]),
        signatures=tuple(
            Signature(s["fault"], np.array(s["coefficients"], dtype=float), s["source"])
            for s in signatures
        ),
        facts=dict(learnt.get("facts", {})),
    )
    found.check(learnt["magnitudes"], learnt["quantities"])
    return found
