"""The twin of a linear axis on the samples of a recording: closed loop, open loop, first state."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.linear_axis.parameters import FIXED, LinearAxis
from ematwin.models.linear_axis.plausibility import check_interval
from ematwin.models.linear_axis.step import AxisConstants, AxisState, axis_at_rest, axis_traces
from ematwin.models.stepped import Stepped, stepped_of
from ematwin.recordings.recording import Recording

FIRST = 20  # samples from which the first state is taken; the published scores leave them out


def closed_loop(
    actuator: LinearAxis, recording: Recording, candidates: Mapping[str, np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Voltage (V) and position (m), (B, S), of candidates that follow the recorded reference.

    The first state is taken from the recording, or is rest at the reference where it has no
    position. Pulses are added where it has them.
    """
    constants = axis_constants(actuator, candidates)
    start = first_state(recording, actuator, constants, count)
    return _traces(actuator, recording, constants, start, count)


def open_loop(
    actuator: LinearAxis, recording: Recording, candidates: Mapping[str, np.ndarray] | None = None,
    count: int = 1,
) -> np.ndarray:  # fmt: skip
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
    constants = axis_constants(actuator, candidates or {})
    start = first_state(recording, actuator, constants, count)
    constants = constants._replace(closed=0.0)
    return _traces(actuator, recording, constants, start, count)[1]


def axis_constants(
    actuator: LinearAxis, candidates: Mapping[str, Any] | None = None
) -> AxisConstants:
    """Constants of candidates, numbers or (B,) arrays; all others are healthy.

    ``candidates`` are faults by name and parameters by place, (B,) each.
    """
    k = candidates or {}
    own = actuator.varied(k, FIXED)
    friction, drive, control = own.friction, own.drive, own.controller
    dry = friction.coulomb * k.get("friction", 1.0)
    dry_side = np.sqrt(friction.coulomb_ratio * k.get("dry_asymmetry", 1.0))
    viscous = friction.viscous * k.get("viscous", 1.0)
    viscous_side = np.sqrt(friction.viscous_ratio * k.get("viscous_asymmetry", 1.0))
    steps = actuator.controller.sample_time / substeps_of(actuator) / drive.response_time
    decay = np.exp(-steps)
    return AxisConstants(
        mobility=1.0 / own.carriage.mass,
        dry_forward=dry / dry_side,
        dry_backward=dry * dry_side,
        standstill=friction.standstill_ratio - 1.0,
        per_fading=1.0 / friction.fading_speed,
        viscous_forward=viscous / viscous_side,
        viscous_backward=viscous * viscous_side,
        gain=drive.gain * k.get("drive_gain", 1.0),
        offset=drive.offset,
        decay=decay,
        lagging=(1.0 - decay) / steps,
        limit=drive.voltage_limit,
        k_position=control.position_gain * k.get("position_gain", 1.0),
        k_velocity=control.velocity_gain,
        closed=1.0,
    )


def substeps_of(actuator: LinearAxis) -> int:
    """Steps from one sample to the next."""
    return max(1, math.ceil(actuator.controller.sample_time / actuator.steps.twin - 1e-9))


def stepped(actuator: LinearAxis) -> Stepped:
    """The axis in closed loop, sample by sample, from rest at the first reference."""
    return stepped_of(
        axis_traces, axis_at_rest, lambda candidates: axis_constants(actuator, candidates),
        inputs=("reference", "pulses"), interval=actuator.controller.sample_time,
        substeps=substeps_of(actuator),
    )  # fmt: skip


def first_state(
    recording: Recording, actuator: LinearAxis, constants: AxisConstants, count: int
) -> np.ndarray:
    """(3, B) position (m), speed (m/s) and lagging voltage (V) of candidates at the first sample.

    Position and speed are those from which the recorded voltage leads the candidate closest to the
    first 20 recorded positions; rest at the reference, or the first position, where a channel is
    missing.
    """
    channels = recording.channels
    state = np.zeros((3, count))
    if "position" not in channels:
        state[0] = channels["reference"][0]
        return state
    position = channels["position"][: FIRST + 1]
    state[0] = position[0]
    if "voltage" not in channels:
        return state
    state[2] = channels["voltage"][0]
    time = np.arange(position.size) * recording.interval
    straight = np.linalg.pinv(np.column_stack([np.ones_like(time), time]))
    driven = constants._replace(closed=0.0)
    # the first state changes the friction under which it is found
    for _ in range(3 if position.size > 2 else 0):
        found = _traces(actuator, recording, driven, state, count, 1, position.size)[1]
        state[:2] += straight @ (position - found).T
    return state


def _traces(
    actuator: LinearAxis, recording: Recording, constants: AxisConstants, start: np.ndarray,
    count: int, threads: int | None = None, samples: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    check_interval(actuator, recording)
    channels, interval = recording.channels, actuator.controller.sample_time
    command = channels["reference" if constants.closed else "voltage"][:samples]
    pulses = channels["pulses"][:samples] if "pulses" in channels else None
    x, v, u = start
    # it came at the same speed
    state = AxisState(x, v, u, x - interval * v, x - 2.0 * interval * v, 0.0)
    found = axis_traces(
        command, pulses, constants, state, interval, substeps_of(actuator), count=count,
        threads=threads,
    )  # fmt: skip
    return found["voltage"], found["position"]
