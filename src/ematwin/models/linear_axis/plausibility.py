"""Refuse recordings of a linear axis with wrong units or signs, or of another controller."""

from collections.abc import Mapping

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.base import Law
from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.models.plausibility import check_enough, check_travel_of
from ematwin.recordings.recording import Recording


def check_signals(recording: Recording, actuator: LinearAxis) -> list[str]:
    """Sentences on doubts about a recording; `RecordError` where it contradicts the actuator."""
    name, channels = recording.name, recording.channels
    check_interval(actuator, recording)
    check_enough(recording)
    reference, position, voltage = (channels[n] for n in ("reference", "position", "voltage"))
    check_travel_of(recording, "reference")
    check_travel_of(recording, "position")
    if np.ptp(voltage) == 0.0:
        raise RecordError(
            f"{name}: its voltage never changes from {voltage[0]:.3g} V; the channel is dead."
        )
    limit = actuator.drive.voltage_limit
    largest = float(np.abs(voltage).max())
    pulse = float(np.abs(channels.get("pulses", np.zeros(1))).max())
    if largest > 1.05 * (limit + pulse):
        raise RecordError(
            f"{name}: its voltage reaches {largest:.4g} V where {actuator.name} is limited to "
            f"{limit:g} V; its unit is wrong, or drive.voltage_limit."
        )
    travel = float(np.ptp(reference))
    if travel == 0.0:
        return [f"The reference of {name} never moves; little can be told from it."]
    largest = float(np.abs(reference - position).max())
    if largest > travel:
        raise RecordError(
            f"{name}: its position is up to {largest:.4g} m away from the reference, more than the "
            "travel; one of the two has another unit, sign or origin."
        )
    return _check_controller(recording, actuator)


def check_interval(actuator: LinearAxis, recording: Recording) -> None:
    """Raise `RecordError` unless a recording is sampled with the controller."""
    sample_time = actuator.controller.sample_time
    if abs(recording.interval - sample_time) > 0.01 * sample_time:
        raise RecordError(
            f"{recording.name} is sampled every {recording.interval:.6g} s and the controller of "
            f"{actuator.name} every {sample_time:.6g} s; the twin needs one sample for each update "
            "of the controller. Record at that rate, or correct controller.sample_time."
        )


def controller_voltage(recording: Recording, actuator: LinearAxis) -> np.ndarray:
    """Output of the controller for the recorded positions, from the third on, (S - 2,) array, V.

    k_v (k_p (q_ref - q) - dq_f/dt) + pulse, q_f the mean of the last two samples, within its limit.
    """
    channels, control = recording.channels, actuator.controller
    position, reference = channels["position"], channels["reference"]
    speed = (position[2:] - position[:-2]) / (2.0 * control.sample_time)
    demand = control.position_gain * (reference[2:] - position[2:])
    output = control.velocity_gain * (demand - speed)
    if "pulses" in channels:
        output = output + channels["pulses"][2:]
    return np.clip(output, -actuator.drive.voltage_limit, actuator.drive.voltage_limit)


def controller_law(recording: Recording, actuator: LinearAxis) -> Law:
    """The voltage is the output of the controller for the recorded positions, within its limit."""
    channels, control = recording.channels, actuator.controller
    position, voltage = channels["position"], channels["voltage"]
    slopes = (position[2:] - position[:-2]) / (2.0 * control.sample_time)
    speed = np.r_[slopes[:1], slopes[:1], slopes]
    limit = 0.99 * actuator.drive.voltage_limit

    def left(taken: Mapping[str, np.ndarray]) -> np.ndarray:
        (at, moves), put = taken["position"], taken["voltage"]
        inside = np.abs(put) < limit
        demand = control.velocity_gain * control.position_gain * (taken["reference"] - at)
        slowed = control.velocity_gain * moves
        added = put - taken.get("pulses", 0.0) + slowed
        return np.where(inside, np.stack([added, demand, slowed]), 0.0)

    sources = {"reference": channels["reference"], "voltage": voltage,
               "position": np.stack([position, speed])}  # fmt: skip
    if "pulses" in channels:
        sources["pulses"] = channels["pulses"]
    text = "the controller does not give the recorded voltage for the recorded positions"
    # twice what a real axis leaves (docs/real-recordings.md)
    return Law(text, sources, left, 0.005 * float(np.sqrt(np.mean(voltage**2))))


def _check_controller(recording: Recording, actuator: LinearAxis) -> list[str]:
    """Whether the recorded voltage is the output of the controller for the recorded positions."""
    voltage = recording.channels["voltage"][2:]
    expected = controller_voltage(recording, actuator)
    size = float(np.linalg.norm(voltage))
    share = float(np.linalg.norm(voltage - expected)) / size
    if float(voltage @ expected) < -0.5 * size * float(np.linalg.norm(expected)):
        raise RecordError(
            f"{recording.name}: its voltage is opposite to what the controller gives for the "
            "recorded positions; change its sign, or that of reference and position."
        )
    if share <= 0.05:
        return []
    return [
        f"The recorded voltage differs by {100.0 * share:.0f} % from what the controller of "
        f"{actuator.name} gives for the recorded positions: its gains, its filter, the unit of a "
        "channel or voltages added to it are not as assumed, and the twin in closed loop will not "
        "follow this recording."
    ]


def missing_motion(recording: Recording, actuator: LinearAxis) -> list[str]:
    """Sentences on directions whose friction does not show; each forbids a verdict."""
    steps = np.diff(recording.channels["reference"])
    travel = float(np.ptp(recording.channels["reference"]))
    ways = {"forward": steps[steps > 0.0].sum(), "backward": -steps[steps < 0.0].sum()}
    return [
        f"The reference never moves {way}, so that friction of that direction cannot be told. Use "
        "a command that goes there and back."
        for way, moved in ways.items()
        if moved <= 1e-3 * travel or travel == 0.0
    ]
