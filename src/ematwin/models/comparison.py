"""Comparison: one recording beside the twin, for many candidates at once.

It answers with costs (the sum of squared, weighted residuals), with the residuals themselves, and
with what else a search can use: a smoother version of itself, and one that starts anew from
recorded states (multiple shooting). A kind of actuator either gives whole traces and takes
`TraceComparison`, or scores its candidates while it simulates them.
"""

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.sensors import as_sensed
from ematwin.recordings.recording import Recording

Candidates = Mapping[str, np.ndarray]
"""Values (B,) by name of the unknown; what is not named is healthy or nominal."""


def one_candidate(values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Values by name as those of a single candidate."""
    return {name: np.array([value]) for name, value in values.items()}


class Placed(NamedTuple):
    """A recording counted from where an answer shows its rotor to stand."""

    recording: Recording | None  # None where no place explains it
    said: str  # a sentence on the result


class Left(NamedTuple):
    """The residual of a channel, RMS."""

    share: float  # of the channel
    times: float  # in the unit of `Model.noise`


class Comparison(ABC):
    """A recording prepared for comparing candidates with it."""

    recording: Recording
    actuator: Any  # of the twin
    scale: float  # the cost of a twin that does not answer at all
    statistics: Mapping[str, float] = {}  # measured on the recording beside the comparison
    length: float | None = None  # s, of stretches that are each compared from their recorded state
    # standard deviation that one independent residual is expected to have: the unit in which a
    # prior counts beside the residuals; and how many of these there are
    noise: float = 1.0
    independent: float = 1.0
    # root of the cost over the scale that the noise alone leaves, or what the twin is known to
    # miss; and the same for the noise that was measured on the recording, where that lacks it
    expected_misfit: float = 0.0
    recorded_noise: float = 0.0
    whitened: bool = False  # residuals are in standard deviations of the noise
    # how many of the residuals, the last ones, are of further channels that count where intervals
    # are formed (`with_evidence`); in their standard deviations
    evidence: int = 0
    ignores: frozenset[str] = frozenset()  # nuisances without effect on the compared channels
    model_error: float = 1.0  # factor on standard errors (`Model.model_error`)
    has_reference: bool = False  # to correct the answers by (`missed`)
    unseen: frozenset[str] = frozenset()  # unknowns on which only the reference depends
    unplaced: bool = False  # only an answer can show from where the recording counts (`placed`)

    @abstractmethod
    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted residuals (B, K) of B = ``count`` candidates; not finite where one diverged."""

    def costs(self, candidates: Candidates, count: int) -> np.ndarray:
        """Sums of squares (B,) of the residuals; infinite where a candidate diverged."""
        residuals = self.residuals(candidates, count)
        costs = np.einsum("bk,bk->b", residuals, residuals)
        return np.where(np.isfinite(costs), costs, np.inf)

    def costs_within(self, candidates: Candidates, count: int, limits: np.ndarray) -> np.ndarray:
        """The costs (B,), where those above a limit (B,) may be infinite: stopped early."""
        return self.costs(candidates, count)

    @abstractmethod
    def responses(self, candidates: Candidates, count: int) -> dict[str, np.ndarray]:
        """Response of the twin on the compared channels, (B, S) arrays by name, SI."""

    @abstractmethod
    def measured(self) -> dict[str, np.ndarray]:
        """The recording's side of the same channels, (S,) arrays."""

    @abstractmethod
    def captions(self) -> dict[str, tuple[str, str]]:
        """Title and unit of each compared channel, for figures."""

    def with_evidence(self) -> "Comparison":
        """The same comparison with what further channels of the recording tell; itself by default.

        Channels such as voltages need nuisances of their own, which a search does not have: they
        join where all that is unknown is free.
        """
        return self

    def smoothed(self) -> "Comparison | None":
        """The same comparison with a smooth misfit around each minimum; None if it has none."""
        return None

    def coarse(self) -> "Comparison":
        """The same comparison in less time, to find minima roughly; or itself."""
        return self

    def refined(self) -> "Comparison":
        """The same comparison with a finer step, where an answer is to be finer; or itself."""
        return self

    def sampled_first(self, instant: float) -> "Comparison":
        """With a known first sample of the drive's loops, s after the start."""
        other = copy.copy(self)
        other.recording = self.recording.with_first_sample(instant)
        return other

    def placed(self, values: Mapping[str, float]) -> "Placed | None":
        """What an answer shows of where its recording counts from; None where that is known."""
        return None

    def restarted(self) -> "Comparison | None":
        """The same comparison by stretches, each from its recorded state; None without states."""
        return None

    def exact(self, values: Mapping[str, float]) -> dict[str, np.ndarray] | None:
        """Response of the reference model, (S,) arrays; None without one, NaN where it diverged."""
        return None

    def missed(self, values: Mapping[str, float]) -> dict[str, np.ndarray] | None:
        """Reference less fast model at one candidate, (S,) arrays by channel."""
        exact = self.exact(values)
        if exact is None:
            return None
        fast = self.responses(one_candidate(values), 1)
        return {name: trace - fast[name][0] for name, trace in exact.items()}

    def exact_residuals(self, values: Mapping[str, float]) -> np.ndarray | None:
        """Weighted residuals (K,) of the reference model, as `residuals` gives; else as `exact`."""
        missed = self.missed(values)
        if missed is None:
            return None
        return np.asarray(self.with_missed(missed).residuals(one_candidate(values), 1)[0])

    def with_missed(self, missed: Mapping[str, np.ndarray]) -> "Comparison":
        """With the error of the twin, (S,) arrays, subtracted from the recording; or itself."""
        return self

    def left(self, values: Mapping[str, float]) -> dict[str, Left]:
        """What a candidate leaves of each channel of which the kind states how much is usual."""
        return {}

    def noise_weights(self, residuals: np.ndarray) -> np.ndarray:
        """Factors (K,) by which `reweighed` multiplies residuals; by default one."""
        return np.ones(residuals.size)

    def reweighed(self, residuals: np.ndarray) -> "Comparison":
        """With each channel weighed by the noise that residuals (K,) at a good point show.

        Itself where one channel is compared, whose noise `with_shown_noise` finds.
        """
        return self

    def averaged(self, others: "Sequence[Comparison]") -> "Comparison":
        """The mean of this recording and others over the same command; itself by default."""
        return self

    def beside(self, others: "Sequence[Comparison]") -> "Comparison":
        """The same comparison where ``others`` (this one among them) count with it; or itself.

        A twin that misses the same in each repetition has fewer `independent` residuals.
        """
        return self


def correlation_time(residual: np.ndarray) -> float:
    """How many samples of a residual (K,) count as one, because they are alike.

    The sum of its autocorrelations until they first vanish (Priestley 1981, Spectral Analysis and
    Time Series, section 5.3.2).
    """
    spectrum = np.abs(np.fft.rfft(residual, 2 * residual.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: residual.size]
    if correlation[0] <= 0.0:
        return 1.0
    ends = np.flatnonzero(correlation <= 0.0)
    end = int(ends[0]) if ends.size else residual.size
    return float(1.0 + 2.0 * correlation[1:end].sum() / correlation[0])


class TraceComparison(Comparison):
    """Residuals of whole traces, each channel weighed by its noise.

    ``prepared`` holds, by channel, the recording's side (S,) where it is not as recorded.
    """

    whitened = True

    def __init__(
        self, model: Any, recording: Recording, actuator: Any,
        prepared: Mapping[str, np.ndarray] | None = None,
    ) -> None:  # fmt: skip
        self._model, self.model_error = model, model.model_error
        self.recording, self.actuator = recording, actuator
        channels = {**recording.channels, **(prepared or {})}
        stated = model.noise(actuator, recording)
        self._noise = {name: noise for name, noise in stated.items() if name in channels}
        self._stated = self._noise
        if not self._noise:
            raise RecordError(
                f"{recording.name} has none of the channels that are compared "
                f"({', '.join(model.outputs)}); record one of them."
            )
        self._measured = {name: channels[name] for name in self._noise}
        self._largest = {name: float(np.abs(x).max()) for name, x in self._measured.items()}
        self._sensors = frozenset(one.name for one in model.sensors(actuator))
        self._target = self._measured
        squares = (np.sum((trace / self._noise[n]) ** 2) for n, trace in self._target.items())
        self.scale = float(sum(squares))
        if self.scale == 0.0:
            raise RecordError(
                f"{recording.name} holds nothing but zeros in {', '.join(self._noise)}: nothing "
                "moves. Give a command that moves the actuator, or check the channels."
            )
        self.independent = float(len(self._noise) * len(recording))
        self.expected_misfit = math.sqrt(self.independent / self.scale)

    def with_missed(self, missed: Mapping[str, np.ndarray]) -> Self:
        """The same comparison with the error of the twin subtracted from the recording."""
        other = copy.copy(self)
        other._target = {n: trace - missed.get(n, 0.0) for n, trace in self._measured.items()}
        return other

    def noise_weights(self, residuals: np.ndarray) -> np.ndarray:
        """Factors (K,); channels with larger residuals than the kind states count less.

        Correlated samples count once. Smaller residuals do not raise a weight: an error of the twin
        that pulls parameters throughout a recording leaves none, and no reference shows it.
        """
        rows = residuals.reshape(len(self._noise), -1)
        noise = [math.sqrt(float(np.mean(one**2)) * correlation_time(one)) for one in rows]
        return np.repeat(1.0 / np.maximum(noise, 1.0), rows.shape[1])

    def reweighed(self, residuals: np.ndarray) -> Self:
        """The same comparison with each channel weighed by its residuals."""
        other = copy.copy(self)
        each = self.noise_weights(residuals)[:: len(self.recording)].tolist()
        noises = zip(self._noise.items(), each, strict=True)
        other._noise = {name: noise / weight for (name, noise), weight in noises}
        other.independent = float(len(self._noise) * len(self.recording))
        return other

    def averaged(self, others: Sequence[Comparison]) -> Self:
        """The mean of this recording and others over the same command."""
        other = copy.copy(self)
        traces = [self._measured, *(one.measured() for one in others)]
        other._measured = {n: np.stack([t[n] for t in traces]).mean(0) for n in self._noise}
        other._target = other._measured
        other.recording = self.recording.changed(**other._measured)
        return other

    def costs(self, candidates: Candidates, count: int) -> np.ndarray:
        """Sums of squares (B,), of as many candidates at a time as memory should hold."""
        many = max(1, 2_000_000 // len(self.recording))  # samples of traces that are held
        costs = np.empty(count)
        for n in range(0, count, many):
            some = {name: values[n : n + many] for name, values in candidates.items()}
            costs[n : n + many] = super().costs(some, min(many, count - n))
        return costs

    def measured(self) -> dict[str, np.ndarray]:
        """The recording's side, (S,) arrays."""
        return dict(self._measured)

    def responses(self, candidates: Candidates, count: int) -> dict[str, np.ndarray]:
        """The twin's side as its sensors show it, (B, S) arrays.

        Candidates that differ in sensors alone are simulated once.
        """
        sensors = {name: candidates[name] for name in candidates.keys() & self._sensors}
        twins = {name: x for name, x in candidates.items() if name not in sensors}
        if not sensors:
            answer = self._model.respond(self.actuator, self.recording, twins, count)
            return {name: answer[name] for name in self._noise}
        rows = np.stack([np.zeros(count), *twins.values()])
        _, first, which = np.unique(rows, axis=1, return_index=True, return_inverse=True)
        some = {name: x[first] for name, x in twins.items()}
        answer = self._model.respond(self.actuator, self.recording, some, first.size)
        traces = {name: answer[name][which.ravel()] for name in self._noise}
        return as_sensed(traces, sensors, self._largest, self.recording.interval)

    def left(self, values: Mapping[str, float]) -> dict[str, Left]:
        """What a candidate leaves of each channel."""
        answers, found = self.responses(one_candidate(values), 1), {}
        for name, target in self._target.items():
            size, rest = (math.sqrt(float(np.mean(x**2))) for x in (target, target - answers[name]))
            found[name] = Left(rest / max(size, 1e-300), rest / self._stated[name])
        return found

    def captions(self) -> dict[str, tuple[str, str]]:
        """The meaning of each channel."""
        channels = [self._model.channel(name) for name in self._noise]
        return {one.name: (one.meaning, one.unit) for one in channels}

    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted residuals (B, K), channel after channel."""
        answer = self.responses(candidates, count)
        samples = len(self.recording)
        found = np.empty((count, len(self._target) * samples))
        for n, (name, target) in enumerate(self._target.items()):
            part = found[:, n * samples : (n + 1) * samples]
            noise = self._noise[name]
            np.divide(answer[name], noise, out=part)
            part -= target / noise
        return found
