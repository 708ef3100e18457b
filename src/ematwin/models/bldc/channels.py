"""Channels of a recording of a brushless actuator, and its equivalent current.

That is the single current of the monitor model (docs/models.md, "The misfit"): the envelope of the
phase currents, or their projection on the EMF shapes.
"""

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.servo import COMMAND_AND_LOAD, star_channels
from ematwin.numerics.signals import LowPass
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


def trapezoid_shape(theta_e: np.ndarray) -> np.ndarray:
    """EMF shape f at electrical angles (rad): trapezoid with flats of 120 degrees."""
    turns = theta_e / (2.0 * np.pi) - 0.25
    return np.clip(3.0 - 12.0 * np.abs(turns - np.round(turns)), -1.0, 1.0)


def projected(currents: np.ndarray, theta_e: np.ndarray) -> np.ndarray:
    """(S,) array, A, phase currents (S, 3) on the EMF shapes at electrical angles (S,), rad."""
    lags, found = 2.0 * np.pi / 3.0 * np.arange(3), np.empty(len(theta_e))
    for start in range(0, len(theta_e), 65_536):  # long records take memory enough
        part = slice(start, start + 65_536)
        shapes = trapezoid_shape(theta_e[part, None] - lags)
        found[part] = 0.5 * (currents[part] * shapes).sum(axis=1)
    return found


def current_envelope(record: Recording) -> np.ndarray:
    """(S,) array, A, never negative: envelope of the phases, or magnitude of ``current``."""
    currents = phase_currents(record)
    if currents is not None:
        return np.asarray(0.5 * np.abs(currents).sum(axis=1))
    if record.current is None:
        raise RecordError(
            f"{record.name} has no current; give current_a, current_b and current_c, or current."
        )
    return np.abs(record.current)


def signed_current(record: Recording, pole_pairs: int) -> np.ndarray | None:
    """(S,) array, A, signed equivalent current; None where the record does not determine it."""
    currents = phase_currents(record)
    if record.motor_position is not None and currents is not None:
        return projected(currents, pole_pairs * record.motor_position)
    no_phases = not any(name in record.channels for name in PHASES)
    if no_phases and record.current is not None and (record.current < 0.0).any():
        return record.current
    return None


def equivalent_current(
    record: Recording, pole_pairs: int, rectify: bool = False
) -> tuple[np.ndarray, bool]:
    """Equivalent current (S,), A, and whether it is a magnitude: if asked for, or all there is."""
    signed = None if rectify else signed_current(record, pole_pairs)
    return (current_envelope(record), True) if signed is None else (signed, False)


def shown_current(recording: Recording, actuator: BldcActuator) -> np.ndarray:
    """Equivalent current (S,), A: signed if that can be told, low-passed if sampled fast enough."""
    current, _ = equivalent_current(recording, actuator.motor.pole_pairs)
    low_pass = LowPass()
    fast_enough = recording.sample_rate >= 4.0 * low_pass.cutoff
    return low_pass.apply(current, recording.sample_rate) if fast_enough else current
