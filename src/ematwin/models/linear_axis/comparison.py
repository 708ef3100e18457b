"""A recording of a linear axis beside its twin in closed loop: voltage and position error.

The error of the twin comes from the motion, not from the sensors: it is the same each time the
reference is repeated, and alike over tens of milliseconds. `LinearAxisComparison.independent`
counts residuals accordingly, so that intervals do not shrink with the number of samples.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from ematwin.models.comparison import Comparison, TraceComparison
from ematwin.recordings.recording import Recording

ALIKE = 0.065  # s; docs/linear-axis.md says how it was measured
_AS_LONG = 0.9  # of the longer of two references that are the same
_SAME = 1e-4  # of the travel: references that differ less are repeated


class LinearAxisComparison(TraceComparison):
    """Residuals of voltage and position error, each weighed by its noise.

    Parameters
    ----------
    model, recording, actuator : as in `TraceComparison`
    """

    def __init__(self, model: Any, recording: Recording, actuator: Any) -> None:
        channels = recording.channels
        error = channels["reference"] - channels["position"]
        super().__init__(model, recording.changed(position_error=error), actuator)
        self._once = len(recording) * recording.interval / ALIKE / repeats(channels["reference"])
        self.independent = max(1.0, self._once)

    def beside(self, others: Sequence[Comparison]) -> "LinearAxisComparison":
        """Recordings of one motion count as its repetitions: once together."""
        mine = self.recording.channels["reference"]
        same = sum(is_same(mine, one.recording.channels["reference"]) for one in others)
        if same < 2:
            return self
        other = copy.copy(self)
        other.independent = max(1.0, self._once / same)
        return other

    def reweighed(self, residuals: np.ndarray) -> "LinearAxisComparison":
        """Itself: `independent` counts the residuals."""
        return self


def is_same(command: np.ndarray, other: np.ndarray) -> bool:
    """Whether two references (S,) and (S',) are one motion, of about the same length."""
    size = min(command.size, other.size)
    apart = float(np.abs(command[:size] - other[:size]).max())
    longest = max(command.size, other.size)
    return size > _AS_LONG * longest and apart <= _SAME * float(np.ptp(command))


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
