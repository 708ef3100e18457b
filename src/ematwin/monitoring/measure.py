"""Measurements of recordings before any verdict: the twin fitted to each, and features.

Nothing here knows a kind of actuator: the twin is asked through `Problem`, and whatever is
particular to a kind comes from its `Model`. Features are the magnitudes of faults, and statistics
of the residual: means of each channel in each phase of the command, and its power in bands of
frequency where the phase is steady.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.constants import SAME_COMMAND
from ematwin.estimation.free_unknowns import searched
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Search, named
from ematwin.models.base import Monitoring
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.phases import Phase, phases
from ematwin.models.registry import model_of
from ematwin.monitoring.population import Parabola
from ematwin.recordings.recording import Recording

_SAME_RATE = 0.01
_PARTS = 4  # of a transient
# Edges of the bands as shares of the Nyquist frequency. In a recording of a ball screw at 25 Hz
# they are slow swaying, stick and slip, one turn of the screw and its harmonics, balls and sensor.
BANDS = (0.03, 0.16, 0.32, 0.45, 0.72, 1.0)


class Feature(NamedTuple):
    """A number by which a recording is compared with healthy ones."""

    name: str
    kind: str  # "model": magnitude of a fault; "mean" or "band": of the residual of a channel
    channel: str  # "" of magnitudes
    value: float


@dataclass(frozen=True)
class Motion:
    """The motion that recordings of an actuator have in common."""

    command: np.ndarray  # (S,), SI
    interval: float  # interval, settling_time: s, the latter until a transient has died out
    settling_time: float
    channels: tuple[str, ...]  # names of the C that are compared

    def layout(self, actuator: ParameterSet) -> list[Feature]:
        """The features of its recordings, at values of no meaning."""
        still = np.zeros((len(self.channels), self.command.size))
        return self.features(actuator, model_of(actuator).healthy(actuator), still)

    @cached_property
    def phases(self) -> list[Phase]:
        """Of the command."""
        return phases(self.command, self.interval, self.settling_time)

    def features(
        self, actuator: ParameterSet, magnitudes: Mapping[str, float], residuals: np.ndarray
    ) -> list[Feature]:
        """The F features of a recording with magnitudes of faults and residuals (C, S), SI."""
        short = Monitoring.of(model_of(actuator)).short
        found = [
            Feature(one.name, "model", "", magnitudes[one.name])
            for one in model_of(actuator).faults(actuator)
            if one.direction_of is None
        ]
        for channel, residual in zip(self.channels, residuals, strict=True):
            for name, kind, value in self._statistics(residual):
                said = f"{short.get(channel, channel)} {name}"
                found.append(Feature(said, kind, channel, float(value)))
        return found

    def _statistics(self, residual: np.ndarray) -> Iterator[tuple[str, str, float]]:
        """Yield name, kind and value of the statistics of a residual (S,)."""
        for phase in self.phases:
            part = residual[phase.samples]
            if phase.steady:
                yield f"mean, {phase.title}", "mean", part.mean()
                for n, level in enumerate(band_levels(part), 1):
                    yield f"band {n}, {phase.title}", "band", level
            else:
                for n, piece in enumerate(np.array_split(part, _PARTS), 1):
                    yield f"part {n}, {phase.title}", "mean", piece.mean()

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
class Measurements:
    """Measurements on N recordings, a row of each array for each."""

    features: np.ndarray  # (N, F)
    covariate: np.ndarray  # (N,), SI; zeros for a kind that has none
    groups: np.ndarray  # (N,), number of the run (and condition) of each recording
    runs: np.ndarray  # (N,) of str, name of the run of each recording
    statistics: Mapping[str, np.ndarray]  # (N,) by name, measurements beside the twin

    @property
    def names(self) -> list[str]:
        """The runs, each once."""
        return list(dict.fromkeys(self.runs.tolist()))

    def part(self, members: np.ndarray) -> Self:
        """Some of them, members (N,) of bool, or their numbers."""
        every = {one.name: getattr(self, one.name) for one in fields(self)}
        statistics = {name: rows[members] for name, rows in every.pop("statistics").items()}
        rows = {name: values[members] for name, values in every.items()}
        return replace(self, statistics=statistics, **rows)

    def with_more(self, other: "Measurements") -> Self:
        """These and others, whose runs have other names."""
        later = replace(other, groups=other.groups + self.groups.max() + 1)
        names = [one.name for one in fields(self) if one.name != "statistics"]
        rows = {n: np.concatenate([getattr(self, n), getattr(later, n)]) for n in names}
        common = [name for name in self.statistics if name in other.statistics]
        both = {n: np.concatenate([self.statistics[n], other.statistics[n]]) for n in common}
        return replace(self, statistics=both, **rows)


class Beside:
    """A recording of a motion of an actuator beside its twin, which is fitted to it.

    `RecordError` if it follows another command, has another rate, lacks a channel of the motion, or
    is implausible.

    Attributes
    ----------
    doubts, barred : sentences; the latter forbid a verdict
    problem, end : of the last fit
    residuals : (C, S) array, what it left of each channel, SI
    """

    problem: Problem
    end: Found
    residuals: np.ndarray

    def __init__(self, actuator: ParameterSet, motion: Motion, recording: Recording) -> None:
        self.actuator, self.motion, self.recording = actuator, motion, recording
        self._model = model_of(actuator)
        self._monitoring = Monitoring.of(self._model)
        self.doubts, self.barred = motion.check(recording, actuator)
        self.comparison = self._monitoring.compare(
            self._model, recording, actuator, motion.settling_time
        )
        for name in motion.channels:
            if name not in self.comparison.measured():
                raise RecordError(
                    f"{recording.name} has no {name}, unlike the others; record it, or calibrate "
                    "without it."
                )

    @property
    def covariate(self) -> float:
        """Of the kind, SI; 0 if it has none."""
        name = self._monitoring.covariate
        return 0.0 if name is None else self.problem.values(self.end.point)[name]

    @property
    def misfit(self) -> float:
        """Relative."""
        return self.problem.relative_misfit(self.end.cost)

    def fit(self, search: Search | None = None) -> Self:
        """Fit the twin by a search, the kind's by default."""
        return self._fit(self.comparison, search or named(self._model.default_search))

    def again(self, discrepancy: Parabola) -> Self:
        """Fit it from the last fit, with its mean error (C S) taken off the recording."""
        shape = self.residuals.shape
        missed = discrepancy.at(self.covariate).reshape(shape)
        known = dict(zip(self.motion.channels, missed, strict=True))
        self._fit(self.comparison.with_missed(known), LocalDescent(self.end.point))
        self.residuals -= discrepancy.at(self.covariate).reshape(shape)
        return self

    def _fit(self, compared: Comparison, search: Search) -> Self:
        starts = self._model.starts(self.actuator, self.recording)
        self.problem = Problem([compared], searched(self._model, self.actuator), starts=starts)
        self.end = search.run(self.problem, budget=None, seed=1, report=lambda *_: None)
        if self.end.stopped == "interrupted":
            raise KeyboardInterrupt
        candidates = self.problem.candidates(self.end.point[None])
        answer, measured = self.comparison.responses(candidates, 1), self.comparison.measured()
        left = [measured[name] - answer[name][0] for name in self.motion.channels]
        self.residuals = np.array(left)
        return self

    def features(self, residuals: np.ndarray | None = None) -> np.ndarray:
        """Values (F,) of the features; with other ``residuals`` (C, S) in place of those left."""
        values, left = self.problem.values(self.end.point), self.residuals
        left = left if residuals is None else residuals
        return np.array([one.value for one in self.motion.features(self.actuator, values, left)])


def measured(beside: Sequence[Beside]) -> Measurements:
    """The measurements on recordings beside their fitted twin."""
    statistics = [one.comparison.statistics for one in beside]
    numbers: dict[Any, int] = {}
    for one in beside:
        numbers.setdefault(one.recording.together, len(numbers))
    return Measurements(
        features=np.array([one.features() for one in beside]),
        covariate=np.array([one.covariate for one in beside]),
        groups=np.array([numbers[one.recording.together] for one in beside]),
        runs=np.array([one.recording.run for one in beside]),
        statistics={
            name: np.array([one[name] for one in statistics])
            for name in statistics[0]
            if all(name in one for one in statistics)
        },
    )
