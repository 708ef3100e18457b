"""Signals of a comparison: low-pass, noise, means, and the weights of the misfit.

Loads no numba until a signal is filtered.
"""

import hashlib
import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from ematwin.errors import InputError

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class LowPass:
    """Second-order Butterworth low-pass, causal.

    In closed form (bilinear transform with the cutoff prewarped; e.g. Oppenheim and Schafer 2010,
    Discrete-Time Signal Processing, section 7.3), as importing a package for it takes longer than
    a search.
    """

    cutoff: float = 500.0  # Hz

    def taps(self, sample_rate: float, start: float) -> np.ndarray:
        """``b0 b1 b2 a1 a2 z1 z2``: the filter and its state after resting at ``start``.

        `InputError` for a rate (Hz) below four times the cutoff, where it would not act as one.
        """
        if not (self.cutoff > 0.0 and sample_rate >= 4.0 * self.cutoff):
            raise InputError(
                f"A low-pass of {self.cutoff:g} Hz needs a sample rate of at least "
                f"{4.0 * self.cutoff:g} Hz; the record has {sample_rate:g} Hz. "
                "Sample faster or lower the cutoff."
            )
        k = math.tan(math.pi * self.cutoff / sample_rate)
        scale = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
        b0 = k * k * scale
        a1, a2 = 2.0 * (k * k - 1.0) * scale, (1.0 - math.sqrt(2.0) * k + k * k) * scale
        return np.array([b0, 2.0 * b0, b0, a1, a2, (1.0 - b0) * start, (b0 - a2) * start])

    def noise_gain(self, sample_rate: float) -> float:
        """The share of the power of white noise that passes.

        A Butterworth filter of order two passes as much of it as a sharp edge at
        (pi/4)/sin(pi/4) = 1.11 times the cutoff would.
        """
        bandwidth = (math.pi / 4.0) / math.sin(math.pi / 4.0) * self.cutoff
        return min(1.0, 2.0 * bandwidth / sample_rate)

    def passed_noise(self, signal: np.ndarray, filtered: np.ndarray, sample_rate: float) -> float:
        """Variance of the white noise of a signal (S,) that is left in it as filtered (S,).

        It follows from the part that the filter removes.
        """
        passed = min(0.5, 2.0 * self.cutoff / sample_rate)
        return float(np.mean((signal - filtered) ** 2)) * passed / (1.0 - passed)

    def apply(self, signal: np.ndarray, sample_rate: float) -> np.ndarray:
        """The filtered signal (S,), as if it had rested at its first value before."""
        return filtered(self.taps(sample_rate, float(signal[0])), signal)[0]


def filtered(taps: np.ndarray, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A signal (S,) through a filter as `LowPass.taps` gives it, and its state (2,) afterwards."""
    from ematwin.numerics.filters import second_order

    found = np.array(signal, dtype=float)
    state = np.array(taps[5:], dtype=float)
    second_order(taps, state, found)
    return found, state


def means(trace: np.ndarray, stride: int) -> np.ndarray:
    """The first sample of a trace (S,), then the mean of each ``stride`` samples after it.

    ``(1 + (S - 1) // stride,)``: each stands at the last of its samples, as a current that was
    recorded as a mean does.
    """
    count = (trace.size - 1) // stride
    parts = trace[1 : 1 + count * stride].reshape(count, stride)
    return np.concatenate([trace[:1], parts.mean(axis=1)])


def rounding(signals: np.ndarray) -> float:
    """RMS of the rounding of a sum of signals (n, S), each to its smallest step.

    Widrow and Kollar (2008). None of so few values that they may be those of a sensor that is dead
    but for some false reads.
    """
    steps = (np.diff(np.unique(one)) for one in signals)
    found = [float(one.min()) for one in steps if one.size >= 5]
    return float(np.linalg.norm(found)) / math.sqrt(12.0)


def white_noise(trace: np.ndarray) -> float:
    """Standard deviation of the white noise on a trace (S,), in its unit.

    By differences of the fourth order, with 70 times the variance of the noise, and their
    median, so that corners and commutations do not count (von Neumann, Kent, Bellinson and Hart
    1941, Ann. Math. Stat. 12, 153-162; Hampel 1974, J. Am. Stat. Assoc. 69, 383-393). 0 for a trace
    of fewer than five samples.
    """
    order = 4  # a trace that is sampled well is a cubic over five samples
    if trace.size <= order:
        return 0.0
    gain = math.comb(2 * order, order)
    return float(spread_of(np.abs(np.diff(trace, order)))) / math.sqrt(gain)


def spread_of(sizes: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Standard deviation of normal values of these sizes, by their median (Hampel 1974)."""
    return np.asarray(1.4826 * np.median(sizes, axis=axis))


@dataclass(frozen=True)
class SlopeWeighting:
    """Weights ``1/sqrt((dI/dt)^2 + s^2)`` of squared differences from the measured current.

    Eq. 2 of the paper: err = sum_t (I_3eq - I_m)^2 / sqrt((dI_3eq/dt)^2 + s^2). A total least
    squares weighting: where the measured current is steep, a small shift in time makes a large
    difference, and counts for less.
    """

    slope_scale: float = 500.0  # A/s; 1 is the paper's, larger ones come closer to least squares

    def weights(self, measured: np.ndarray, interval: float) -> np.ndarray:
        """(S,) array, s/A, for a measured current (S,) in A sampled each ``interval`` s."""
        slope = np.gradient(measured, interval)
        return 1.0 / np.sqrt(slope**2 + self.slope_scale**2)


class Remembered(Generic[Answer]):
    """The latest answers to one question on arrays, kept by their content.

    A recording is looked at when it is checked, and again in each comparison with it.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[bytes, Answer]] = deque(maxlen=8)

    def of(self, arrays: Iterable[np.ndarray], answer: Callable[[], Answer]) -> Answer:
        """What ``answer`` gives, which depends on the arrays alone, and in their order."""
        digest = hashlib.sha256()
        for one in arrays:
            digest.update(np.ascontiguousarray(one).data)
        asked = digest.digest()
        for known, found in tuple(self._kept):
            if known == asked:
                return found
        found = answer()
        self._kept.append((asked, found))
        return found
