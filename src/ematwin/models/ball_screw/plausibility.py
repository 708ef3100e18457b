"""Refuse recordings of a ball-screw actuator with negative magnitudes, wrong signs or units."""

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.sizes import check_travel_of
from ematwin.recordings.recording import Recording

_LARGEST = 2000.0  # A
_AHEAD = 0.3  # of the largest position error


def position_error(recording: Recording) -> np.ndarray:
    """Set point less position (S,), m, as recorded or from the position."""
    channels = recording.channels
    if "position_error" in channels:
        return channels["position_error"]
    found: np.ndarray = channels["set_point"] - channels["position"]
    return found


def check_spans(recording: Recording) -> None:
    """Raise `RecordError` if set point or current are so large that their unit must be wrong."""
    check_travel_of(recording, "set_point")
    largest = float(np.abs(recording.current).max())
    if largest > _LARGEST:
        raise RecordError(
            f"{recording.name}: current reaches {largest:.4g} A, which no such drive takes; its "
            "unit is probably mA. Put [mA] into the name of the channel."
        )


def check_signals(recording: Recording) -> None:
    """Raise `RecordError` if current or position error have a wrong sign or unit, or are dead."""
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
    if ahead > _AHEAD * largest:
        raise RecordError(
            f"{name}: the nut runs ahead of its set point by {ahead:.3g} m when it starts: the "
            "position error has the wrong sign (set point less position is needed). Change it."
        )
