"""A recording of a ball-screw actuator beside its twin: current and position error together.

Sensors may be coupled: fast noise that appears in both channels of one sample at once is electrical
(a common ground or supply), since an actuator needs time to answer. Its share can change, even its
sign, when a rig is rewired or taken apart, and then says something of the wiring and nothing of
wear. So it is measured on each motion, taken out of the current, and reported; no verdict rests on
it.
"""

from functools import cache
from typing import Any

import numpy as np

from ematwin.models.ball_screw.plausibility import position_error
from ematwin.models.comparison import TraceComparison
from ematwin.models.phases import calm
from ematwin.recordings.recording import Recording

_FAST = 0.24  # of the Nyquist frequency: noise above it is taken out


class BallScrewComparison(TraceComparison):
    """Residuals of current and position error, each weighed by its noise.

    The fast noise that the two sensors share is measured where the motion is steady
    (``statistics["sensor_coupling"]``, A/m) and taken out of the current.

    Parameters
    ----------
    model, recording, actuator : as in `TraceComparison`
    settling_time : s, from a change of the commanded speed to steady motion
    """

    def __init__(
        self, model: Any, recording: Recording, actuator: Any, *, settling_time: float
    ) -> None:
        error = position_error(recording)
        steady = calm(recording.set_point, recording.interval, settling_time)
        share = coupling(recording.current, error, steady) if steady.any() else 0.0
        current = decoupled(recording.current, error, share)
        super().__init__(model, recording, actuator, {"current": current, "position_error": error})
        self.statistics = {"sensor_coupling": share}


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
