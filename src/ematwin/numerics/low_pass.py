"""The low-pass filter that both sides of a comparison pass."""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError


@dataclass(frozen=True)
class LowPass:
    """Second-order Butterworth low-pass, causal.

    Parameters
    ----------
    cutoff : float, Hz
    """

    cutoff: float = 500.0

    def coefficients(self, sample_rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Numerator and denominator, each (3,), of the digital filter at a sample rate (Hz).

        Raises
        ------
        InputError
            If the rate is below four times the cutoff, where the filter would not act as one.
        """
        from scipy.signal import butter

        if not (self.cutoff > 0.0 and sample_rate >= 4.0 * self.cutoff):
            raise InputError(
                f"A low-pass of {self.cutoff:g} Hz needs a sample rate of at least "
                f"{4.0 * self.cutoff:g} Hz; the record has {sample_rate:g} Hz. "
                "Sample faster or lower the cutoff."
            )
        b, a = butter(2, self.cutoff, fs=sample_rate)
        return b, a

    def taps(self, sample_rate: float, start: float) -> np.ndarray:
        """``b0 b1 b2 a1 a2 z1 z2``: the filter and its state after resting at ``start``."""
        from scipy.signal import lfilter_zi

        b, a = self.coefficients(sample_rate)
        return np.concatenate([b, a[1:], lfilter_zi(b, a) * start])

    def apply(self, signal: np.ndarray, sample_rate: float) -> np.ndarray:
        """The filtered signal (S,), as if it had rested at its first value before."""
        from scipy.signal import lfilter

        taps = self.taps(sample_rate, float(signal[0]))
        filtered, _ = lfilter(taps[:3], np.r_[1.0, taps[3:5]], signal, zi=taps[5:])
        return np.asarray(filtered)
