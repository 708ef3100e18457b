"""Coupling of the sensors: noise that current and position share at the same instant.

Fast noise that appears in both channels of one sample at once is electrical (a common ground or
supply), since an actuator needs time to answer. Its share can change, even its sign, when a rig
is rewired or taken apart, and then says something of the wiring and nothing of wear. So it is
measured on each motion, taken out of the current, and reported; no verdict rests on it.
"""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ematwin.signals.motion import Motion

_FAST = 0.24  # of the Nyquist frequency: noise above it is taken out


def coupling(motion: Motion, calm: np.ndarray) -> float:
    """Current per position error that their fast noise shares, A/m.

    ``calm`` (S,) marks the samples in which the actuator is at rest or moves steadily.
    """
    whole = calm[2:] & calm[1:-1] & calm[:-2]
    fast_current = np.diff(motion.current, 2)[whole]
    fast_error = np.diff(motion.position_error, 2)[whole]
    power = float(fast_error @ fast_error)
    return float(fast_current @ fast_error) / power if power > 0.0 else 0.0


def decoupled_current(motion: Motion, share: float) -> np.ndarray:
    """The current (S,), A, without the fast noise that it shares with the position error."""
    high_pass = butter(2, _FAST, "high", output="sos")
    return motion.current - share * sosfiltfilt(high_pass, motion.position_error)
