"""Refuse recordings of wrong units, signs or sizes, too short ones, and those of no motion.

Channels of a servo agree: what differs by a sign or a known factor is a mistake.

The currents of a star winding add up to zero, whatever the faults. The slope of a position is its
speed, the output follows the command, and motor and output turn with the ratio of the gear. Two
columns are compared at the delay at which they are most alike, because the output comes after the
command.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.numerics.signals import rounding
from ematwin.recordings.channel import PHASES
from ematwin.recordings.recording import Recording

_DEGREES = 180.0 / np.pi
FEWEST = 100  # samples


def check_agreement(record: Recording, actuator: Any) -> None:
    """Raise `RecordError` if positions, speeds or the command differ by a known mistake."""
    for side in ("motor", "output"):
        _check_speed(record, side)
    gear, command = actuator.transmission.ratio, record.channels["command"]
    output, motor = (record.channels.get(f"{side}_position") for side in ("output", "motor"))
    degrees = {_DEGREES: "{} looks like degrees"}
    if output is None:
        if motor is not None:
            degrees[1.0] = ""  # of a wrong sign phases tell more (`check_order`)
            smaller = {**degrees, gear: "motor_position looks like an angle of the output"}
            turned = ("command times the gear ratio", gear * command)
            _refuse(turned, ("motor_position", motor), degrees, smaller)
        return
    causes = {**degrees, gear: "{} looks like an angle of the motor side"}
    shown = {"command": command}
    if motor is not None:
        shown["motor_position over the gear ratio"] = motor / gear
    for one in shown.items():
        _refuse(one, ("output_position", output), causes, causes)


def _check_speed(record: Recording, side: str) -> None:
    position, speed = (record.channels.get(f"{side}_{x}") for x in ("position", "speed"))
    if position is None or speed is None:
        return
    slope = f"the slope of {side}_position"
    _refuse(
        (slope, np.gradient(position, record.interval)),
        (f"{side}_speed", speed),
        {
            30.0 / np.pi: "{} looks like rpm",
            _DEGREES: "{} looks like degrees per second",
            1e3: "time looks like ms read as s",
            1e6: "time looks like us read as s",
        },
        {
            _DEGREES: f"{side}_position looks like degrees",
            1e3: "time looks like s read as ms",
            1e6: "time looks like s read as us",
        },
    )


def _refuse(
    one: tuple[str, np.ndarray], other: tuple[str, np.ndarray], other_larger: dict[float, str],
    one_larger: dict[float, str],
) -> None:  # fmt: skip
    """Raise if two named columns differ by a sign or by one of the factors."""
    ratio, close = _ratio(one[1], other[1]), 1.35  # of the factor of a mistake
    if ratio is None or 1.0 / close < ratio < close:
        return
    size, larger, causes = abs(ratio), other[0], other_larger
    if size < 1.0:
        size, larger, causes = 1.0 / size, one[0], one_larger
    if ratio < 0.0:
        causes = {1.0: "one of them has the wrong sign", **causes}
    near = (text for factor, text in causes.items() if factor / close < size < factor * close)
    cause = next(near, None)
    if cause:
        raise RecordError(
            f"{other[0]} is {ratio:.3g} times as large as {one[0]}, though both show the same "
            f"motion: {cause.format(larger)}. Correct it in the map."
        )


def _ratio(one: np.ndarray, other: np.ndarray) -> float | None:
    """How many times as large ``other`` moves as ``one``; None if they do not move alike."""
    every = -(-one.size // 4096)  # samples looked at
    a, b = one[::every] - one.mean(), other[::every] - other.mean()
    norms = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(norms) == 0.0:
        return None
    size = 2 ** (2 * a.size - 1).bit_length()  # padded: no wrapping round
    spectrum = np.conj(np.fft.rfft(a / norms[0], size)) * np.fft.rfft(b / norms[1], size)
    alike = np.fft.irfft(spectrum, size)[: max(1, int(0.05 * a.size))]  # correlation by delay
    if float(np.abs(alike).max()) < 0.8:
        return None
    # the sign without a delay: half a period later a sine is its own opposite
    return float(np.copysign(norms[1] / norms[0], -1.0 if alike[0] < -0.5 else 1.0))


def check_sum(record: Recording) -> list[str]:
    """Warnings if phase currents do not add up; `RecordError` if a changed sign explains it."""
    if not set(PHASES) <= record.channels.keys():
        return []
    currents = np.column_stack([record.channels[name] for name in PHASES])[record.measured]
    scale = _rms(currents)
    good = 0.2 * scale + rounding(currents.T)  # the sum of three good channels is less
    offset = currents.sum(axis=1).mean()
    total = _rms(currents.sum(axis=1) - offset)
    warnings = []
    if scale > 0.0 and abs(offset) > 0.5 * good:
        warnings.append(
            f"The phase currents sum to {offset:.3g} A on average instead of zero: a sensor has "
            "an offset; give it in the map."
        )
    if total <= good:
        return warnings
    flipped = currents.sum(axis=1)[:, None] - 2.0 * currents
    left = {name: _rms(one - one.mean()) for name, one in zip(PHASES, flipped.T, strict=True)}
    best = min(left, key=left.__getitem__)
    if left[best] < 0.5 * total and left[best] <= good:
        others = " and ".join(name for name in PHASES if name != best)
        raise RecordError(
            f"The phase currents sum to {total:.3g} A (RMS) instead of zero, and to "
            f"{left[best]:.3g} A with {best} inverted: {best} has the wrong sign (or both "
            f"{others}). Give sign = -1 in the map."
        )
    return [
        *warnings,
        f"The phase currents sum to {total:.3g} A (RMS) instead of zero, at {scale:.3g} A (RMS) in "
        "a phase, and no change of one sign explains it: check the scales of the three channels.",
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def check_sizes(
    traces: Mapping[str, np.ndarray], names: Iterable[str], limit: float, unit: str, said: str,
    times: float = 3.0,
) -> None:  # fmt: skip
    """Raise `RecordError` if one of some traces (S,), SI, by name, is ever ``times`` its limit.

    No fault does that. ``said`` names the actuator and its limit.
    """
    smaller, factor = {"A": ("mA", 1e-3), "V": ("mV", 1e-3), "rad/s": ("rpm", np.pi / 30.0)}[unit]
    for name in (name for name in names if name in traces):
        largest = float(np.abs(traces[name]).max())
        if largest <= times * limit:
            continue
        hint = (
            f'It looks like {smaller}: give unit = "{smaller}" in the map.'
            if largest * factor <= times * limit
            else "Check its unit and scale, or the actuator."
        )
        raise RecordError(f"{name} reaches {largest:.4g} {unit}; {said}. {hint}")


def check_enough(recording: Recording) -> None:
    """Raise `RecordError` unless a recording has samples enough to tell faults apart."""
    if len(recording) < FEWEST:
        raise RecordError(
            f"The record has {len(recording)} samples; at least {FEWEST} are needed to tell "
            "faults apart. Record longer or faster."
        )


def check_moves(current: np.ndarray) -> None:
    """Raise `RecordError` if a current (S,), A, never changes."""
    if np.ptp(current) == 0.0:
        raise RecordError(
            f"The current of the record is constant ({current[0]:g} A): nothing moved. Check the "
            "channel, or record a motion."
        )


def check_travel_of(recording: Recording, name: str) -> None:
    """Raise `RecordError` if a channel, m, spans more than anything travels."""
    span = float(np.ptp(recording.channels[name]))
    if span > 100.0:
        raise RecordError(
            f"{recording.name}: {name} spans {span:.4g} m, which no actuator travels; its unit is "
            f"probably mm. Name it {name}_mm or put [mm] into the name."
        )
