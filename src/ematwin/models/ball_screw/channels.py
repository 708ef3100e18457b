"""Channels of a recorded motion of a ball-screw actuator, and what they can span."""

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.channel import Channel, Derivation
from ematwin.recordings.recording import Recording

_LONGEST = 100.0  # m: no actuator travels further; a larger span is a wrong unit
_LARGEST = 2000.0  # A


def _error(set_point: np.ndarray, position: np.ndarray) -> np.ndarray:
    return set_point - position


CHANNELS = (
    Channel("set_point", "m", "commanded position of the nut",
            ("setpoint", "command", "demand", "reference")),
    Channel("position_error", "m", "set point less position", ("error", "following_error"),
            derived=Derivation("set_point - position", ("set_point", "position"), _error)),
    Channel("position", "m", "position of the nut", ("nut_position", "output_position"),
            stands_in_for="position_error"),
    Channel("current", "A", "current of the drive, a magnitude",
            ("motor_current", "drive_current")),
)  # fmt: skip
UNITS = {channel.name: channel.unit for channel in CHANNELS}


def check_spans(recording: Recording) -> None:
    """Raise `RecordError` if set point or current are so large that their unit must be wrong."""
    span = float(np.ptp(recording.set_point))
    if span > _LONGEST:
        raise RecordError(
            f"{recording.name}: set_point spans {span:.4g} m, which no actuator travels; its unit "
            "is probably mm. Name it set_point_mm or put [mm] into the name."
        )
    largest = float(np.abs(recording.current).max())
    if largest > _LARGEST:
        raise RecordError(
            f"{recording.name}: current reaches {largest:.4g} A, which no such drive takes; its "
            "unit is probably mA. Put [mA] into the name of the channel."
        )
