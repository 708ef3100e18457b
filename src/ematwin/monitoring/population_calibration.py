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
from ematwin.estimation.constants import SIGMAS, SMALLEST
from ematwin.estimation.verdict import UNNAMED
from ematwin.models.base import Monitoring, Reported
from ematwin.models.parameter_set import ParameterSet
from ematwin.monitoring.calibration import FORMAT, Calibration
from ematwin.monitoring.measure import Beside, Feature, Measurements, Motion
from ematwin.monitoring.population import Causes, Direction, Parabola, Population, Posterior
from ematwin.monitoring.runs import Given, recordings_of

# standard deviation between occasions, of each fault and of the level of each channel, in healthy
# ones: an assumption, since healthy recordings of one occasion cannot show it
DRIFT = 1.0
_SAME = 0.05  # standard deviations of a feature: what one recording may differ by if fitted again
_STEP = 2e-3  # of features, over which slopes are taken


@dataclass(frozen=True)
class Signature:
    """Mean scores of recordings with a known fault, over the covariate.

    It is a statistic of one rig, and carries over to another as far as that is alike.
    """

    fault: str
    scores: Parabola
    source: str  # of the data it was learnt from

    def in_scores_of(self, before: Population, after: Population) -> "Signature":
        """The same in the scores of another population over the same covariate."""
        raw = self.scores.coefficients * before.spread + before.mean.coefficients
        scores = (raw - after.mean.coefficients) / after.spread
        return replace(self, scores=replace(self.scores, coefficients=scores))


@dataclass(frozen=True)
class PopulationCalibration(Calibration):
    """A calibration with the healthy population, which judges kinds with `Model.monitoring`."""

    motion: Motion
    # mean residual of the twin on healthy recordings, one channel after another (C S), SI
    discrepancy: Parabola
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
        """The R reported quantities of its kind."""
        return self.monitoring.reported(self.model, self.actuator)

    @cached_property
    def layout(self) -> list[Feature]:
        """The F features of its recordings, without values."""
        return self.motion.layout(self.actuator)

    @property
    def magnitudes(self) -> list[str]:
        """Names of the faults whose values are features."""
        return [one.name for one in self.layout if one.kind == "model"]

    @cached_property
    def kinds(self) -> np.ndarray:
        """(F,) array of str, kinds of the features."""
        return np.array([one.kind for one in self.layout])

    @property
    def run_spread(self) -> dict[str, tuple[float, float]]:
        """As of `ematwin.monitoring.calibration.CalibrationReport`."""
        spread = zip(self.reported.within.tolist(), self.reported.between.tolist(), strict=True)
        return {one.name: both for one, both in zip(self.quantities, spread, strict=True)}

    def values_of(self, features: np.ndarray) -> np.ndarray:
        """Reported values (N, R), SI, of features (N, F); logarithms of multiples of healthy."""
        by_name = {one.name: row for one, row in zip(self.layout, features.T, strict=True)}
        magnitudes = {
            one.name: np.log(by_name[one.name]) if one.logarithmic else by_name[one.name]
            for one in self.quantities
            if one.name in self.magnitudes
        }
        every = {**self.monitoring.derived(by_name), **magnitudes}  # derived ones are logarithms
        return np.column_stack([every[one.name] for one in self.quantities])

    @cached_property
    def population(self) -> Population:
        """Of the features."""
        return self._population(self.healthy.features, [one.name for one in self.layout])

    @cached_property
    def reported(self) -> Population:
        """Of the reported quantities (`Monitoring.reported`)."""
        values = self.values_of(self.healthy.features)
        return self._population(values, [one.name for one in self.quantities])

    def _population(self, values: np.ndarray, names: Sequence[str]) -> Population:
        """Of values (N, n) of the healthy recordings."""
        # a bound at the healthy value hides a part of the scatter
        cut = {
            one.name: SMALLEST * one.width / SIGMAS
            for one in self.model.faults(self.actuator)
            if one.healthy in (one.lower, one.upper)
        }
        least = np.array([cut.get(name, 0.0) for name in names])
        return Population.of(values, self.healthy.covariate, self.healthy.groups, self.scale, least)

    @property
    def scale(self) -> float:
        """Of the covariate, SI."""
        return self.discrepancy.scale

    def without(self, run: str) -> "PopulationCalibration":
        """The same, learnt from all healthy runs but one."""
        return replace(self, healthy=self.healthy.part(self.healthy.runs != run))

    def knows(self, given: Measurements) -> bool:
        """Whether one of these recordings is a healthy one here, as when a file is given twice.

        Bands are not compared: those here are of a discrepancy without the run's own share.
        """
        compared = self.kinds != "band"
        here = self.healthy.features[:, compared]
        near = _SAME * (here.std(0) + 1e-9 * np.abs(here).max(0) + 1e-12)
        rows = given.features[:, compared]
        return any(bool((np.abs(here - row) <= near).all(1).any()) for row in rows)

    @cached_property
    def tested(self) -> np.ndarray:
        """Scores (N, F) of the healthy recordings, each run judged by the others."""
        scores = np.empty_like(self.healthy.features)
        for run in self.healthy.names:
            own = self.healthy.runs == run
            scores[own] = self.without(run).scores(self.healthy.part(own))
        return scores

    @cached_property
    def causes(self) -> Causes:
        """What may have happened to the actuator."""
        kinds, channels = self.kinds, np.array([one.channel for one in self.layout])
        levels = [(channels == name) & (kinds == "mean") for name in self.motion.channels]
        drifts = DRIFT * np.vstack([np.eye(len(kinds))[kinds == "model"], *levels])
        taught = [Direction(one.fault, one.scores, True) for one in self.signatures]
        others = [
            Direction(UNNAMED, self._constant(np.zeros(len(kinds))), around=np.isin(kinds, these))
            for these in (("mean", "band"), ("mean",), ("band",))
        ]
        directions = [*self._moved(), *taught, *others]
        return Causes(self.tested, self.healthy.groups, drifts, directions)

    def _moved(self) -> list[Direction]:
        """Directions in which reported quantities rise and fall, with the faults that do that.

        Recordings with a known fault say more than physics does on the quantities that it moves.
        """
        healthy = np.ones(len(self.layout))  # multiples are 1
        away = self.values_of(healthy + _STEP * np.eye(len(healthy)))
        slopes = (away - self.values_of(healthy[None])).T / _STEP  # (R, F)
        spread, found = self.population.spread, []
        for one, slope, scatter in zip(self.quantities, slopes, self.reported.spread, strict=True):
            shift = slope / spread / np.abs(slope / spread).max()
            # a statistic is of several features, which seldom rise alike, nor without others
            kind = self.kinds[np.argmax(np.abs(slope))]
            around = None if kind == "model" else self.kinds == kind
            moves = [s.scores.coefficients[0] * spread @ slope / scatter for s in self.signatures]
            raised = one.named or UNNAMED
            for fault, sense in ((raised, 1.0), (raised if one.either else UNNAMED, -1.0)):
                if max((sense * move for move in moves), default=0.0) < SIGMAS:
                    found.append(Direction(fault, self._constant(sense * shift), around=around))
        return found

    def _constant(self, row: np.ndarray) -> Parabola:
        return Parabola(self.scale, np.outer([1.0, 0.0, 0.0], row))

    def beside(self, recordings: Given) -> list[Beside]:
        """Recordings, or those in files, beside their fitted twin; errors as of `Beside`."""
        given = recordings_of(recordings, self.actuator)
        beside = [Beside(self.actuator, self.motion, one) for one in given]
        return [one.fit().again(self.discrepancy) for one in beside]

    def scores(self, measured: Measurements) -> np.ndarray:
        """How far measurements lie from health, (N, F), in healthy standard deviations."""
        return self.population.scores(measured.features, measured.covariate)

    def posterior(self, measured: Measurements) -> Posterior:
        """Probabilities of what happened, from recordings that are judged together."""
        return self.causes.posterior(self.scores(measured), measured.covariate)

    def _table(self, sources: Mapping[str, str] | None) -> dict[str, Any]:
        healthy, known = self.healthy, self.signatures
        table = {
            "format": FORMAT,
            "ematwin": __version__,
            "interval": self.motion.interval,
            "settling_time": self.motion.settling_time,
            "channels": list(self.motion.channels),
            "magnitudes": self.magnitudes,
            "quantities": [one.name for one in self.quantities],
            "scale": self.scale,
            "facts": self.facts,
            "command": _plain(self.motion.command),
            "discrepancy": _plain(self.discrepancy.coefficients),
            "healthy": {
                "runs": healthy.runs.tolist(),
                "groups": healthy.groups.tolist(),
                "covariate": _plain(healthy.covariate),
                "features": _plain(healthy.features),
                "statistics": {name: _plain(rows) for name, rows in healthy.statistics.items()},
            },
        }
        signatures = [
            {"fault": s.fault, "source": s.source, "coefficients": _plain(s.scores.coefficients)}
            for s in known
        ]
        return {**super()._table(sources), "calibration": table, "signature": signatures}


def population_in(
    actuator: ParameterSet,
    baseline: Baseline,
    learnt: Mapping[str, Any],
    signatures: Sequence[Mapping[str, Any]],
) -> PopulationCalibration:
    """The calibration in the tables of a file; raises `ValueError` if its parts do not fit."""
    known = learnt if learnt["format"] == FORMAT else learnt["population"]  # which 0.2 kept
    interval, settling = float(learnt["interval"]), float(learnt["settling_time"])
    scale = float(known["scale"])
    if not (min(interval, scale) > 0.0 <= settling < np.inf):
        raise ValueError(f"{interval}, {scale} and {settling} do not fit")
    command = np.array(learnt["command"], dtype=float)
    motion = Motion(command, interval, settling, tuple(learnt["channels"]))
    table, count = learnt["healthy"], len(learnt["healthy"]["runs"])
    width = len(motion.layout(actuator))
    found = PopulationCalibration(
        actuator=actuator,
        baseline=baseline,
        motion=motion,
        discrepancy=Parabola(
            scale, _numbers(learnt["discrepancy"], 3, len(motion.channels) * command.size)
        ),
        healthy=Measurements(
            features=_numbers(table["features"], count, width),
            covariate=_numbers(table["covariate"], count),
            groups=_numbers(table["groups"], count).astype(int),
            runs=np.array(table["runs"], dtype=str),
            statistics={name: _numbers(rows, count) for name, rows in table["statistics"].items()},
        ),
        signatures=tuple(
            Signature(
                one["fault"], Parabola(scale, _numbers(one["coefficients"], 3, width)),
                one["source"],
            )
            for one in signatures
        ),
        facts=dict(learnt.get("facts", {})),
    )  # fmt: skip
    quantities = [one.name for one in found.quantities]
    for made, now in ((learnt["magnitudes"], found.magnitudes), (learnt["quantities"], quantities)):
        if list(made) != now:
            raise ValueError(f"it knows {', '.join(made)}, the kind {', '.join(now)}")
    return found


def _plain(values: np.ndarray) -> Any:
    """Numbers for a file."""
    return np.vectorize(lambda x: float(f"{x:.9g}"))(values).tolist()


def _numbers(rows: Any, *shape: int) -> np.ndarray:
    """An array in a file."""
    found = np.array(rows, dtype=float)
    if found.shape != shape or not np.isfinite(found).all():
        raise ValueError(f"an array of shape {found.shape}, not {shape}, or of infinite values")
    return found
