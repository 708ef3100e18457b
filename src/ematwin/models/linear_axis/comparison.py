"""A recording of a linear axis beside its twin in closed loop: voltage and position error.

The error of the twin repeats with the reference, and is larger the lower the frequency: friction
that varies along the screw, and drift. So residuals are compared by frequency, up to the bandwidth
of the position loop. Each frequency is weighed by the power that the residual has around it
(generalised least squares by a smoothed periodogram: Ljung 1999, System Identification, 7.4).
"""

import copy
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.fft import next_fast_len, rfft

from ematwin.models.comparison import Candidates, Comparison, TraceComparison
from ematwin.recordings.recording import Recording

_SAME = 1e-4  # of the travel: references that differ less are repeated


class LinearAxisComparison(TraceComparison):
    """Spectra of the residuals of voltage and position error, each weighed by its noise."""

    def __init__(self, model: Any, recording: Recording, actuator: Any) -> None:
        channels = recording.channels
        error = channels["reference"] - channels["position"]
        super().__init__(model, recording.changed(position_error=error), actuator)
        self._length = next_fast_len(len(recording), real=True)
        bandwidth = actuator.controller.position_gain / (2.0 * math.pi)
        highest = int(bandwidth * self._length * recording.interval)
        count = min(highest, self._length // 2) + 1
        self._weights = np.ones((len(self._noise), count))
        traces = [trace / self._noise[name] for name, trace in self._measured.items()]
        self.scale = float(np.sum(self._spectra(np.concatenate(traces)[None]) ** 2))
        # both channels show one force: together they count once
        self._once = (2.0 * count - 1.0) / repeats(channels["reference"])
        self.independent = max(1.0, self._once)

    def residuals(self, candidates: Candidates, count: int) -> np.ndarray:
        """Weighted spectra (B, K) of the residuals, real and imaginary parts of each channel."""
        return self._spectra(super().residuals(candidates, count))

    def beside(self, others: Sequence[Comparison]) -> "LinearAxisComparison":
        """Recordings of one motion count as its repetitions: once together."""
        mine = self.recording.channels["reference"]
        same = sum(is_same(mine, one.recording.channels["reference"]) for one in others)
        if same < 2:
            return self
        other = copy.copy(self)
        other.independent = max(1.0, self._once / same)
        return other

    def noise_weights(self, residuals: np.ndarray) -> np.ndarray:
        """Factors (K,): frequencies around which a channel has more power than on average."""
        parts = residuals.reshape(len(self._noise), 2, -1)
        power = np.sum(parts**2, axis=1)
        count, lowest = power.shape[1], 4  # frequencies of the lowest band; others are octaves
        octaves = range(max(0, math.ceil(math.log2(count / lowest))))
        edges = np.array([0, *(lowest << n for n in octaves)])
        sizes = np.diff(np.append(edges, count))
        around = np.repeat(np.add.reduceat(power, edges, axis=1) / sizes, sizes, axis=1)
        mean = power.mean(axis=1, keepdims=True)
        # less power does not raise a weight: the fit takes up errors of the twin as well
        shares = np.sqrt(mean / np.maximum(around, np.maximum(mean, 1e-300)))
        return np.repeat(shares[:, None], 2, axis=1).ravel()

    def reweighed(self, residuals: np.ndarray) -> "LinearAxisComparison":
        """The same comparison with each frequency weighed by the residuals around it."""
        other = copy.copy(self)
        weights = self.noise_weights(residuals).reshape(len(self._noise), 2, -1)[:, 0]
        other._weights = self._weights * weights
        return other

    def _spectra(self, traces: np.ndarray) -> np.ndarray:
        """Weighted spectra (B, K) of traces (B, channels x S)."""
        rows = traces.reshape(len(traces), len(self._noise), -1)
        found = rfft(rows, self._length, norm="ortho")[..., : self._weights.shape[1]]
        found *= math.sqrt(2.0) * self._weights  # negative frequencies
        found[..., 0] /= math.sqrt(2.0)
        return np.concatenate([found.real, found.imag], axis=2).reshape(len(traces), -1)


def is_same(command: np.ndarray, other: np.ndarray) -> bool:
    """Whether two references (S,) and (S',) are one motion, of about the same length."""
    size = min(command.size, other.size)
    apart = float(np.abs(command[:size] - other[:size]).max())
    longest = max(command.size, other.size)
    return size > 0.9 * longest and apart <= _SAME * float(np.ptp(command))


def repeats(command: np.ndarray) -> float:
    """How many times a command (S,) goes through its period; 1 if it has none."""
    size = command.size
    away = command - command.mean()
    power = np.cumsum(np.r_[0.0, away**2])
    spectrum = np.abs(np.fft.rfft(away, 2 * size)) ** 2
    products = np.fft.irfft(spectrum)[: size // 2]
    lags = np.arange(products.size)
    # mean of (c[n + lag] - c[n])^2
    apart = (power[size] - power[lags] + power[size - lags] - 2.0 * products) / (size - lags)
    left = np.flatnonzero(apart > 0.1 * away.var())
    if not left.size:
        return 1.0
    again = np.flatnonzero(apart[left[0] :] < (_SAME * max(float(np.ptp(command)), 1e-300)) ** 2)
    return size / (left[0] + again[0]) if again.size else 1.0
