"""The low-pass filter that both sides of a comparison pass."""

import math
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError

_NOISE_BANDWIDTH = (math.pi / 4.0) / math.sin(math.pi / 4.0)  # of the cutoff


@dataclass(frozen=True)
class LowPass:
    """Second-order Butterworth low-pass, causal.

    In closed form (bilinear transform with the cutoff prewarped; e.g. Oppenheim and Schafer 2010,
    Discrete-Time Signal Processing, section 7.3), as importing a package for it takes longer than
    a search.

    Parameters
    ----------
    cutoff : float, Hz
    """

    cutoff: float = 500.0

    def taps(self, sample_rate: float, start: float) -> np.ndarray:
        """``b0 b1 b2 a1 a2 z1 z2``: the filter and its state after resting at ``start``.

        Raises
        ------
        InputError
            If the rate (Hz) is below four times the cutoff, where the filter would not act as one.
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
        return min(1.0, 2.0 * _NOISE_BANDWIDTH * self.cutoff / sample_rate)

    def apply(self, signal: np.ndarray, sample_rate: float) -> np.ndarray:
        """The filtered signal (S,), as if it had rested at its first value before."""
        return filtered(self.taps(sample_rate, float(signal[0])), signal)[0]


def filtered(taps: np.ndarray, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A signal (S,) through a filter as `LowPass.taps` gives it, and its state (2,) afterwards."""
    from ematwin.numerics.filtering import second_order

    found = np.array(signal, dtype=float)
    state = np.array(taps[5:], dtype=float)
    second_order(taps, state, found)
    return found, state
