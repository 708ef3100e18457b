"""A recording of a ball-screw actuator beside its twin: current and position error together.

Sensors may be coupled: fast noise that appears in both channels of one sample at once is
electrical, since an actuator needs time to answer. Its share changes when a rig is rewired. So it
is measured on each motion, taken out of the current, and reported; no verdict rests on it.
"""

from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.comparison import TraceComparison
from ematwin.models.phases import calm
from ematwin.models.plausibility import check_travel_of
from ematwin.recordings.recording import Recording


def position_error(recording: Recording) -> np.ndarray:
    """Set point less position (S,), m, as recorded or from the position."""
    channels = recording.channels
    if "position_error" in channels:
        return channels["position_error"]
    return channels["set_point"] - channels["position"]


def check_signals(recording: Recording) -> None:
    """Raise `RecordError` if a channel has a wrong sign or unit, or is dead."""
    check_travel_of(recording, "set_point")
    largest = float(np.abs(recording.current).max())
    if largest > 2000.0:
        raise RecordError(
            f"{recording.name}: current reaches {largest:.4g} A, which no such drive takes; its "
            "unit is probably mA. Put [mA] into the name of the channel."
        )
    name, set_point, current = recording.name, recording.set_point, recording.current
    error = position_error(recording)
    travel = float(np.ptp(set_point))
    mean = float(current.mean())
    if mean < 0.0:
        raise RecordError(
            f"{name}: its current is negative on average ({mean:.3g} A), where the magnitude that "
            "the drive takes is needed; change its sign."
        )
    if np.ptp(current) == 0.0:
        raise RecordError(
            f"{name}: its current never changes from {mean:.3g} A; the channel is dead."
        )
    if travel == 0.0:
        return
    largest = float(np.abs(error).max())
    if largest > travel:
        raise RecordError(
            f"{name}: its position error reaches {largest:.4g} m, more than the travel; its unit "
            "is probably wrong, or a position was taken for an error."
        )
    start = int(np.argmax(np.abs(np.diff(set_point)) > 0.0))
    first = slice(start, start + max(8, error.size // 16))
    ahead = -float(error[first].mean() * np.sign(set_point[first][-1] - set_point[first][0]))
    if ahead > 0.3 * largest:
        raise RecordError(
            f"{name}: the nut runs ahead of its set point by {ahead:.3g} m when it starts: the "
            "position error has the wrong sign (set point less position is needed). Change it."
        )


class BallScrewComparison(TraceComparison):
    """Residuals of current and position error, each weighed by its noise.

    The fast noise that the two sensors share is measured where the motion is steady
    (``statistics["sensor_coupling"]``, A/m) and taken out of the current.
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
    """Current (S,), A, per position error (S,), m, that their fast noise shares where ``calm``."""
    whole = calm[2:] & calm[1:-1] & calm[:-2]
    fast_current = np.diff(current, 2)[whole]
    fast_error = np.diff(position_error, 2)[whole]
    power = float(fast_error @ fast_error)
    return float(fast_current @ fast_error) / power if power > 0.0 else 0.0


def decoupled(current: np.ndarray, position_error: np.ndarray, share: float) -> np.ndarray:
    """The current (S,), A, without the fast noise that it shares with the position error."""
    if share == 0.0:
        return current
    from scipy.signal import butter, sosfiltfilt  # takes longer to import than a motion to judge

    high_pass = butter(2, 0.24, "high", output="sos")  # of the Nyquist frequency
    return np.asarray(current - share * sosfiltfilt(high_pass, position_error))
