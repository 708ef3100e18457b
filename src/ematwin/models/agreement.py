"""Whether channels of a servo agree: what differs by a sign or a known factor is a mistake.

The currents of a star winding add up to zero, whatever the faults. The slope of a position is its
speed, the output follows the command, and motor and output turn with the ratio of the gear. Two
columns are compared at the delay at which they are most alike, because the output comes after the
command.
"""

from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.recording import Recording

_ALIKE = 0.8  # correlation from which two columns are held for the same motion
_OPPOSITE = 0.5  # correlation without delay from which two columns have opposite signs
_LATEST = 0.05  # of the record: the longest delay looked for
PHASES = ("current_a", "current_b", "current_c")
_CLOSE = 1.35  # a ratio is within this factor of that of the mistake
_DEGREES = 180.0 / np.pi
_SUM = 0.2  # of the RMS of the currents: the sum of three good channels is less
_FLIPPED = 0.5  # a flip explains the sum if it leaves less than this share of it


def check_agreement(record: Recording, actuator: Any) -> None:
    """Compare positions, speeds and the command of a record with one another.

    Raises
    ------
    RecordError
        If two of them differ by the factor of a known mistake.
    """
    for side in ("motor", "output"):
        _check_speed(record, side)
    if "output_position" not in record.channels:
        return
    gear, output = actuator.transmission.ratio, record.channels["output_position"]
    causes = {_DEGREES: "{} looks like degrees", gear: "{} looks like an angle of the motor side"}
    shown = {"command": record.channels["command"]}
    if "motor_position" in record.channels:
        shown["motor_position over the gear ratio"] = record.channels["motor_position"] / gear
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
    one: tuple[str, np.ndarray],
    other: tuple[str, np.ndarray],
    other_larger: dict[float, str],
    one_larger: dict[float, str],
) -> None:
    """Raise if two named columns differ by a sign or by one of the factors."""
    ratio = _ratio(one[1], other[1])
    if ratio is None:
        return
    size, larger, causes = abs(ratio), other[0], other_larger
    if size < 1.0:
        size, larger, causes = 1.0 / size, one[0], one_larger
    cause = next(
        (text.format(larger) for factor, text in causes.items() if _near(size, factor)), None
    )
    if cause is None and ratio < 0.0 and _near(size, 1.0):
        cause = "one of them has the wrong sign"
    if cause is not None:
        raise RecordError(
            f"{other[0]} is {ratio:.3g} times as large as {one[0]}, though both show the same "
            f"motion: {cause}. Correct it in the map."
        )


def _near(size: float, factor: float) -> bool:
    return factor / _CLOSE < size < factor * _CLOSE


def _ratio(one: np.ndarray, other: np.ndarray) -> float | None:
    """How many times as large ``other`` moves as ``one``; None if they do not move alike."""
    every = -(-one.size // 4096)  # samples looked at
    a, b = one[::every] - one.mean(), other[::every] - other.mean()
    norms = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(norms) == 0.0:
        return None
    size = 2 ** (2 * a.size - 1).bit_length()  # padded: no wrapping round
    spectrum = np.conj(np.fft.rfft(a / norms[0], size)) * np.fft.rfft(b / norms[1], size)
    alike = np.fft.irfft(spectrum, size)[: max(1, int(_LATEST * a.size))]
    if float(np.abs(alike).max()) < _ALIKE:
        return None
    # the sign without a delay: half a period later a sine is its own opposite
    return float(np.copysign(norms[1] / norms[0], -1.0 if alike[0] < -_OPPOSITE else 1.0))


def check_sum(record: Recording) -> list[str]:
    """Warnings if the phase currents do not sum to zero.

    Raises
    ------
    RecordError
        If turning the sign of one phase makes the sum vanish.
    """
    if not set(PHASES) <= record.channels.keys():
        return []
    currents = np.column_stack([record.channels[name] for name in PHASES])
    scale = _rms(currents)
    offset = currents.sum(axis=1).mean()
    total = _rms(currents.sum(axis=1) - offset)
    warnings = []
    if scale > 0.0 and abs(offset) > 0.5 * _SUM * scale:
        warnings.append(
            f"The phase currents sum to {offset:.3g} A on average instead of zero: a sensor has "
            "an offset; give it in the map."
        )
    if total <= _SUM * scale:
        return warnings
    left = {}
    for k, name in enumerate(PHASES):
        flipped = currents.sum(axis=1) - 2.0 * currents[:, k]
        left[name] = _rms(flipped - flipped.mean())
    best = min(left, key=left.__getitem__)
    if left[best] < _FLIPPED * total and left[best] <= _SUM * scale:
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
