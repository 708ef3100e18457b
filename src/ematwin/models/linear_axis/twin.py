"""The twin of a linear axis on the samples of a recording: closed loop, open loop, first state."""

from collections.abc import Mapping

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.linear_axis.constants import constants_table, substeps_of
from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.numerics.side_by_side import side_by_side
from ematwin.recordings.recording import Recording

FIRST = 20  # samples from which the first state is taken; the published scores leave them out
_ROUNDS = 3  # of the first state: it changes the friction under which it is found
_AMISS = 0.01  # relative, of the sampling interval


def closed_loop(
    actuator: LinearAxis,
    recording: Recording,
    candidates: Mapping[str, np.ndarray],
    count: int,
    threads: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Voltage (V) and position (m), (B, S), of candidates that follow the recorded reference.

    The state at the first sample is that of the recording, or rest at the reference where it has
    no position. Pulses are added where it has them.

    Raises
    ------
    RecordError
        If it is not sampled with the controller.
    """
    table = constants_table(actuator, candidates, count)
    start = first_state(recording, actuator, table)
    reference = recording.channels["reference"]
    return _traces(actuator, recording, reference, True, start, table, threads)


def open_loop(
    actuator: LinearAxis,
    recording: Recording,
    candidates: Mapping[str, np.ndarray] | None = None,
    count: int = 1,
    threads: int | None = None,
) -> np.ndarray:
    """Position (B, S), m, of candidates that the recorded voltage drives from the first state on.

    Nothing brings it back, so that a force error adds up: 0.1 N on 190 N s/m of viscous friction
    is 13 mm after 25 s. The recorded voltage holds all pulses.

    Raises
    ------
    RecordError
        If it has no voltage or position, or is not sampled with the controller.
    """
    for name in ("voltage", "position"):
        if name not in recording.channels:
            raise RecordError(
                f"{recording.name} has no {name}, which an open-loop simulation needs; it has "
                f"{', '.join(recording.channels)}."
            )
    table = constants_table(actuator, candidates or {}, count)
    start = first_state(recording, actuator, table)
    voltage = recording.channels["voltage"]
    return _traces(actuator, recording, voltage, False, start, table, threads)[1]


def first_state(recording: Recording, actuator: LinearAxis, table: np.ndarray) -> np.ndarray:
    """(B, 3) position, speed and lagging voltage at the first sample, for each row of constants.

    Position and speed are those from which the recorded voltage leads the candidate closest to the
    first 20 recorded positions; rest at the reference, or the first position, where a channel is
    missing.
    """
    channels = recording.channels
    state = np.zeros((len(table), 3))
    if "position" not in channels:
        state[:, 0] = channels["reference"][0]
        return state
    position = channels["position"][: FIRST + 1]
    state[:, 0] = position[0]
    if "voltage" not in channels:
        return state
    voltage = channels["voltage"][: position.size]
    state[:, 2] = voltage[0]
    time = np.arange(position.size) * recording.interval
    straight = np.linalg.pinv(np.column_stack([np.ones_like(time), time]))
    for _ in range(_ROUNDS if position.size > 2 else 0):
        gap = position - _traces(actuator, recording, voltage, False, state, table, 1)[1]
        state[:, :2] += gap @ straight.T
    return state


def _traces(
    actuator: LinearAxis, recording: Recording, command: np.ndarray, closed: bool,
    start: np.ndarray, table: np.ndarray, threads: int | None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    from ematwin.models.linear_axis.batch import axis_traces
    from ematwin.numerics.lanes import LANES

    check_interval(actuator, recording)
    voltage, position = np.empty((2, len(table), command.size))
    pulses = recording.channels.get("pulses", np.zeros(command.size))[: command.size]
    interval, substeps = actuator.controller.sample_time, substeps_of(actuator)

    def simulate(part: slice) -> None:
        axis_traces(
            command, pulses, closed, start[part], table[part], interval, substeps, voltage[part],
            position[part],
        )  # fmt: skip

    parts = [slice(n, n + LANES) for n in range(0, len(table), LANES)]
    side_by_side(simulate, parts, threads)
    return voltage, position


def check_interval(actuator: LinearAxis, recording: Recording) -> None:
    """Raise `RecordError` unless a recording is sampled with the controller."""
    sample_time = actuator.controller.sample_time
    if abs(recording.interval - sample_time) > _AMISS * sample_time:
        raise RecordError(
            f"{recording.name} is sampled every {recording.interval:.6g} s and the controller of "
            f"{actuator.name} every {sample_time:.6g} s; the twin needs one sample for each update "
            "of the controller. Record at that rate, or correct controller.sample_time."
        )
