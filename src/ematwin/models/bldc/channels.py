"""Channels of a recording of a brushless actuator."""

import numpy as np

from ematwin.models.servo import COMMAND_AND_LOAD, star_channels
from ematwin.recordings.channel import TIME, Channel
from ematwin.recordings.recording import Recording

CHANNELS = (
    *COMMAND_AND_LOAD,
    *star_channels("current", "A", "current into phase {}", ("i_{}", "i{}"), is_mean=True),
    Channel("current", "A", "equivalent current", ("i", "i_eq"), is_mean=True),
    Channel("motor_position", "rad", "motor shaft angle", ("theta_m",), "motor"),
    Channel("motor_speed", "rad/s", "motor shaft speed", ("omega_m",), "motor"),
    Channel("output_position", "rad", "output angle", ("theta_o",), "output"),
    Channel("output_speed", "rad/s", "output speed", ("omega_o",), "output"),
    *(
        Channel(f"voltage_{x}", "V", f"voltage at terminal {x}, all against one point",
                (f"v_{x}", f"u_{x}"), is_mean=True)
        for x in "abc"
    ),
    Channel("bus_current", "A", "current out of the supply", ("i_bus", "i_dc"), is_mean=True),
    Channel("bus_voltage", "V", "voltage of the supply", ("v_bus", "v_dc", "u_dc"), is_mean=True),
)  # fmt: skip
PHASES = ("current_a", "current_b", "current_c")
CURRENTS = (*PHASES, "current")
VOLTAGES = ("voltage_a", "voltage_b", "voltage_c")
ON_REQUEST = (*VOLTAGES, "bus_current", "bus_voltage")  # of a simulation
UNITS = {channel.name: channel.unit for channel in (TIME, *CHANNELS)}


def phase_currents(recording: Recording) -> np.ndarray | None:
    """(S, 3) array of the phase currents, A; None where one of them was not recorded."""
    if not set(PHASES) <= recording.channels.keys():
        return None
    return np.column_stack([recording.channels[name] for name in PHASES])
