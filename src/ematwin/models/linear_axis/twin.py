"""The twin of a linear axis on the samples of a recording: closed loop, open loop, first state."""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.linear_axis.constants import constants_table, substeps_of
from ematwin.models.linear_axis.parameters import LinearAxis
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
    return _traces(
        actuator, recording, recording.channels["reference"], True,
        first_state(actuator, recording), constants_table(actuator, candidates, count), threads,
    )  # fmt: skip


def open_loop(
    actuator: LinearAxis,
    recording: Recording,
    candidates: Mapping[str, np.ndarray] | None = None,
    count: int = 1,
    threads: int | None = None,
) -> np.ndarray:
    """Position (B, S), m, of candidates that the recorded voltage drives from the first state on.

    Force errors are integrated twice: a hundredth of the friction too much is half a metre in an
    hour. The recorded voltage holds all pulses.

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
    return _traces(
        actuator, recording, recording.channels["voltage"], False,
        first_state(actuator, recording), constants_table(actuator, candidates or {}, count),
        threads,
    )[1]  # fmt: skip


def first_state(actuator: LinearAxis, recording: Recording) -> np.ndarray:
    """(3,) position, speed and lagging voltage at the first sample.

    Position and speed are those from which the recorded voltage leads closest to the first 20
    recorded positions; rest at the reference, or the first position, where a channel is missing.
    """
    channels = recording.channels
    if "position" not in channels:
        return np.array([channels["reference"][0], 0.0, 0.0])
    position = channels["position"][: FIRST + 1]
    if "voltage" not in channels:
        return np.array([position[0], 0.0, 0.0])
    voltage = channels["voltage"][: position.size]
    state = np.array([position[0], 0.0, voltage[0]])
    table = constants_table(actuator, {}, 1)
    time = np.arange(position.size) * recording.interval
    base = np.column_stack([np.ones_like(time), time])
    for _ in range(_ROUNDS if position.size > 2 else 0):
        gap = position - _traces(actuator, recording, voltage, False, state, table, 1)[1][0]
        state[:2] += np.linalg.lstsq(base, gap, rcond=None)[0]
    return state


def _traces(
    actuator: LinearAxis, recording: Recording, command: np.ndarray, closed: bool,
    start: np.ndarray, table: np.ndarray, threads: int | None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    from ematwin.models.linear_axis.batch import LANES, axis_traces

    check_interval(actuator, recording)
    voltage, position = np.empty((2, len(table), command.size))
    pulses = recording.channels.get("pulses", np.zeros(command.size))[: command.size]
    interval, substeps = actuator.controller.sample_time, substeps_of(actuator)

    def simulate(part: slice) -> None:
        axis_traces(
            command, pulses, closed, start, table[part], interval, substeps, voltage[part],
            position[part],
        )  # fmt: skip

    parts = [slice(n, n + LANES) for n in range(0, len(table), LANES)]
    workers = min(threads or os.cpu_count() or 1, len(parts))
    if workers <= 1:
        simulate(slice(None))
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(simulate, parts))
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
