"""Coupling of the sensors: noise that current and position share at the same instant.

Fast noise that appears in both channels of one sample at once is electrical (a common ground or
supply), since an actuator needs time to answer. Its share can change, even its sign, when a rig
is rewired or taken apart, and then says something of the wiring and nothing of wear. So it is
measured on each motion, taken out of the current, and reported; no verdict rests on it.
"""

from functools import cache

import numpy as np

_FAST = 0.24  # of the Nyquist frequency: noise above it is taken out


def coupling(current: np.ndarray, position_error: np.ndarray, calm: np.ndarray) -> float:
    """Current per position error that their fast noise shares, A/m.

    Parameters
    ----------
    current, position_error : (S,) arrays, A and m
    calm : (S,) array of bool, whether the actuator is at rest or moves steadily
    """
    whole = calm[2:] & calm[1:-1] & calm[:-2]
    fast_current = np.diff(current, 2)[whole]
    fast_error = np.diff(position_error, 2)[whole]
    power = float(fast_error @ fast_error)
    return float(fast_current @ fast_error) / power if power > 0.0 else 0.0


def decoupled(current: np.ndarray, position_error: np.ndarray, share: float) -> np.ndarray:
    """The current (S,), A, without the fast noise that it shares with the position error."""
    if share == 0.0:
        return current
    from scipy.signal import sosfiltfilt  # takes longer to import than a motion to judge

    found: np.ndarray = current - share * sosfiltfilt(_high_pass(), position_error)
    return found


@cache
def _high_pass() -> np.ndarray:
    from scipy.signal import butter

    found: np.ndarray = butter(2, _FAST, "high", output="sos")
    return found
