"""Measurements of each recording before any verdict: its estimate, and features.

Nothing here knows a kind of actuator: the twin is asked through `Problem`, and whatever is
particular to a kind comes from its `Model`. Features are the magnitudes of faults, and statistics
of the residual: means of each channel in each phase of the command, and its power in bands of
frequency where the phase is steady.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.constants import SAME_COMMAND
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.free_unknowns import searched
from ematwin.estimation.laplace import width_at
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Search, named
from ematwin.models.base import Monitoring
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.phases import Phase, phases
from ematwin.models.registry import model_of
from ematwin.monitoring.population import Measurements, basis
from ematwin.recordings.recording import Recording

_SAME_RATE = 0.01
DIFFERENCE = 2e-3  # share of a range, over which slopes are taken: as long as motions determine it
_PARTS = 4  # of a transient
# Edges of the bands as shares of the Nyquist frequency. In a recording of a ball screw at 25 Hz
# they are slow swaying, stick and slip, one turn of the screw and its harmonics, balls and sensor.
BANDS = (0.03, 0.16, 0.32, 0.45, 0.72, 1.0)


@dataclass(frozen=True)
class Layout:
    """Which features the recordings of a command have."""

    phases: tuple[Phase, ...]  # of the command
    magnitudes: tuple[str, ...]  # names of the faults whose values are features
    channels: tuple[str, ...]  # names of the channels whose residuals give features
    names: tuple[str, ...]  # of the features
    kinds: tuple[str, ...]  # "model", "mean" or "band", one for each

    @classmethod
    def of(
        cls,
        phases: Sequence[Phase],
        magnitudes: Sequence[str],
        channels: Sequence[str],
        short: Mapping[str, str] | None = None,
    ) -> "Layout":
        """The features of recordings with these phases; ``short`` renames channels in them."""
        found = [(name, "model") for name in magnitudes]
        for channel in channels:
            said = (short or {}).get(channel, channel)
            for phase in phases:
                if phase.steady:
                    found.append((f"{said} mean, {phase.title}", "mean"))
                    bands = range(1, len(BANDS))
                    found += [(f"{said} band {n}, {phase.title}", "band") for n in bands]
                else:
                    parts = range(1, _PARTS + 1)
                    found += [(f"{said} part {n}, {phase.title}", "mean") for n in parts]
        names, kinds = zip(*found, strict=True)
        return cls(tuple(phases), tuple(magnitudes), tuple(channels), names, kinds)

    def of_channels(self) -> np.ndarray:
        """(C, F) array of bool: the statistics of the residual of each channel."""
        first, count = len(self.magnitudes), len(self.channels)
        own = (np.arange(len(self.names)) - first) * count // max(1, len(self.names) - first)
        return np.array([(own == n) & (np.array(self.kinds) != "model") for n in range(count)])

    def values(
        self, magnitudes: Mapping[str, float], residuals: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Features (F,) of a recording, from its values by name, and residuals (S,) by channel."""
        found = [float(magnitudes[name]) for name in self.magnitudes]
        for residual in residuals:
            for phase in self.phases:
                part = residual[phase.samples]
                if phase.steady:
                    found.append(float(part.mean()))
                    found += band_levels(part)
                else:
                    found += [float(piece.mean()) for piece in np.array_split(part, _PARTS)]
        return np.array(found)


def band_levels(residual: np.ndarray) -> list[float]:
    """Natural logarithm of the amplitude in each band of `BANDS`."""
    window = np.hanning(residual.size)
    spectrum = np.abs(np.fft.rfft((residual - residual.mean()) * window)) ** 2
    power = spectrum / float(window @ window)
    shares = np.linspace(0.0, 1.0, power.size)  # of the Nyquist frequency
    levels = []
    for low, high in pairwise(BANDS):
        inside = (shares >= low) & (shares < high if high < 1.0 else shares <= high)
        mean = float(power[inside].mean()) if inside.any() else 0.0
        levels.append(0.5 * float(np.log(mean + 1e-18)))
    return levels


@dataclass(frozen=True)
class Motion:
    """The motion that recordings of an actuator have in common."""

    command: np.ndarray  # (S,), SI
    interval: float  # interval, settling_time: s, the latter until a transient has died out
    settling_time: float
    channels: tuple[str, ...] = ()  # names of the C that are compared; else those of a recording

    def layout(self, actuator: ParameterSet) -> Layout:
        """The features of its recordings."""
        model = model_of(actuator)
        magnitudes = [one.name for one in model.faults(actuator) if one.direction_of is None]
        parts = phases(self.command, self.interval, self.settling_time)
        return Layout.of(parts, magnitudes, self.channels, Monitoring.of(model).short)

    def check(self, recording: Recording, actuator: ParameterSet) -> tuple[list[str], list[str]]:
        """Doubts about a recording, and reasons that forbid a verdict (`checked`).

        `RecordError` unless it follows the command at the rate.
        """
        model, command, interval = model_of(actuator), self.command, self.interval
        model.check_channels(recording)
        channel = model.channel(model.command)
        travel = float(np.ptp(command))
        if travel <= 0.0:
            raise RecordError(
                f"The {channel.meaning} ({channel.name}) of {recording.name} never moves; a "
                "recording is needed in which the actuator does."
            )
        if abs(recording.interval - interval) > _SAME_RATE * interval:
            raise RecordError(
                f"{recording.name} is sampled every {recording.interval:g} s where {interval:g} s "
                "is needed; resample it, or calibrate for this rate."
            )
        own = recording.channels[model.command]
        if own.size != command.size:
            raise RecordError(
                f"{recording.name} has {own.size} samples where {command.size} are needed: it is "
                "another motion, or cut short. Leave it out, or calibrate for it."
            )
        off = float(np.abs(own - command).max())
        if off > SAME_COMMAND * travel:
            raise RecordError(
                f"{recording.name} follows another command: it is off by up to {off:.4g} "
                f"{channel.unit} of {travel:.4g} {channel.unit} of travel. Leave it out, calibrate "
                "for it, or correct its unit."
            )
        return checked(model, recording, actuator)


@dataclass(frozen=True)
class Measured(Measurements):
    """Measurements with the estimates: all that a verdict rests on."""

    estimates: tuple[Estimate, ...]
    barred: tuple[list[str], ...]  # of each, sentences on channels that forbid a verdict


@dataclass(frozen=True)
class Fit:
    """The twin fitted to each of N recordings."""

    problems: tuple[Problem, ...]
    found: tuple[Found, ...]
    residuals: np.ndarray  # (N, C, S), of each channel, SI
    covariate: np.ndarray  # (N,), SI; zeros for a kind that has none


class Bench:
    """N recordings of a motion of an actuator beside its twin, each with a comparison.

    ``groups`` (N,) number their runs (and conditions). `RecordError` if one of them follows another
    command, has another rate, or is implausible.
    """

    def __init__(
        self, actuator: ParameterSet, motion: Motion, recordings: Sequence[Recording]
    ) -> None:
        self._actuator, self.recordings = actuator, tuple(recordings)
        self._model = model = model_of(actuator)
        self._doubts = [motion.check(one, actuator) for one in recordings]
        self.monitoring = Monitoring.of(model)
        self.comparisons: list[Comparison] = [
            self.monitoring.compare(model, one, actuator, motion.settling_time)
            for one in recordings
        ]
        together = {key: n for n, key in enumerate(dict.fromkeys(r.together for r in recordings))}
        self.groups = np.array([together[one.together] for one in recordings])
        channels = motion.channels or tuple(self.comparisons[0].measured())
        for recording, comparison in zip(recordings, self.comparisons, strict=True):
            for name in channels:
                if name not in comparison.measured():
                    raise RecordError(
                        f"{recording.name} has no {name}, unlike the others; record it, or "
                        "calibrate without it."
                    )
        self.motion = replace(motion, channels=channels)
        self.layout = self.motion.layout(actuator)

    def fit(
        self,
        discrepancy: np.ndarray | None = None,
        scale: float | None = None,
        before: Fit | None = None,
        search: Search | None = None,
    ) -> Fit:
        """Fit the twin to every recording, by a ``search``, the kind's by default.

        Or from a fit ``before``, with the ``discrepancy`` taken off first: (3, C S) or (1, C S),
        the error of the twin in the channels one after another, over the covariate in units of
        ``scale``.
        """
        name, channels = self.monitoring.covariate, self.motion.channels
        missed = None
        if discrepancy is not None and before is not None:
            missed = self._missed(before.covariate, discrepancy, scale)
        free = searched(self._model, self._actuator)
        problems, found, left = [], [], []
        covariate = np.zeros(len(self.recordings))
        for n, comparison in enumerate(self.comparisons):
            compared = comparison
            if missed is not None:
                compared = comparison.with_missed(dict(zip(channels, missed[n], strict=True)))
            starts = self._model.starts(self._actuator, self.recordings[n])
            problem = Problem([compared], free, starts=starts)
            chosen = search or named(self._model.default_search)
            if before is not None:
                chosen = LocalDescent(before.found[n].point)
            end = chosen.run(problem, budget=None, seed=1, report=lambda *_: None)
            if end.stopped == "interrupted":
                raise KeyboardInterrupt
            if name is not None:
                covariate[n] = problem.values(end.point)[name]
            answer = comparison.responses(problem.candidates(end.point[None]), 1)
            measured = comparison.measured()
            left.append([measured[channel] - answer[channel][0] for channel in channels])
            problems.append(problem)
            found.append(end)
        residuals = np.array(left)
        if discrepancy is not None:
            residuals -= self._missed(covariate, discrepancy, scale)
        return Fit(tuple(problems), tuple(found), residuals, covariate)

    def _missed(
        self, covariate: np.ndarray, discrepancy: np.ndarray, scale: float | None
    ) -> np.ndarray:
        """Error (N, C, S) of the twin at covariates (N,)."""
        rows = basis(covariate, scale) @ discrepancy
        return rows.reshape(len(rows), len(self.motion.channels), -1)

    def measured(self, fit: Fit) -> Measured:
        """Estimates with their covariance, and features."""
        from ematwin.estimation.identify import estimate_of

        estimates, features, layout = [], [], self.layout
        for n, (problem, found) in enumerate(zip(fit.problems, fit.found, strict=True)):
            estimate = estimate_of(
                self._actuator, problem, found.point,
                _spread_at(found.problem or problem, found.point),
                problem.relative_misfit(found.cost), self.recordings[n],
            )  # fmt: skip
            estimates.append(replace(estimate, warnings=tuple(self._doubts[n][0])))
            features.append(layout.values(problem.values(found.point), fit.residuals[n]))
        errors = [
            [min(one.standard_errors[name], one.ranges[name]) for name in layout.magnitudes]
            for one in estimates
        ]
        common = set.intersection(*(set(one.statistics) for one in estimates))
        return Measured(
            features=np.stack(features),
            errors=np.array(errors, dtype=float).reshape(len(features), len(layout.magnitudes)),
            covariate=fit.covariate,
            groups=self.groups,
            runs=tuple(one.run for one in self.recordings),
            statistics={
                name: np.array([one.statistics[name] for one in estimates])
                for name in estimates[0].statistics
                if name in common
            },
            estimates=tuple(estimates),
            barred=tuple(barred for _, barred in self._doubts),
        )


def _spread_at(problem: Problem, point: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the values at a minimum (d,), in values.

    The residual of the twin counts as noise times `Problem.model_error`.
    """
    peak = width_at(problem, point, information=np.eye(len(point)) / DIFFERENCE**2)
    chart, covariance = problem.chart, peak.widened(problem.model_error)
    errors = chart.standard_errors(peak.z, covariance)
    errors *= np.where([one.logarithmic for one in problem.unknowns], point, 1.0)
    sizes = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(sizes, sizes) * np.outer(errors, errors))
