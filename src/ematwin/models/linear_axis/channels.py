"""Channels of a recording of a linear axis."""

import numpy as np

from ematwin.recordings.channel import Channel, Derivation


def _error(reference: np.ndarray, position: np.ndarray) -> np.ndarray:
    return reference - position


CHANNELS = (
    Channel("reference", "m", "commanded position of the carriage",
            ("qg", "command", "set_point", "setpoint", "demand")),
    Channel("voltage", "V", "output of the controller and input of the drive",
            ("vir", "control", "controller_output")),
    Channel("position", "m", "position of the carriage", ("qm", "carriage_position")),
    Channel("position_error", "m", "reference less position", ("following_error", "error"),
            derived=Derivation("reference - position", ("reference", "position"), _error)),
    Channel("pulses", "V", "voltage that is added to the controller's output",
            ("pulses_n", "disturbance", "added_voltage"), may_rest=True),
)  # fmt: skip
