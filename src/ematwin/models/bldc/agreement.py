"""Whether columns that show one motion agree: what differs by a known factor is a mistake.

The slope of a position is its speed, the output follows the command, and motor and output turn
with the ratio of the gear. Two columns are compared at the delay at which they are most alike,
because the output comes after the command.
"""

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.recordings.recording import Recording

_ALIKE = 0.8  # correlation from which two columns are held for the same motion
_OPPOSITE = 0.5  # correlation without delay from which two columns have opposite signs
_LATEST = 0.05  # of the record: the longest delay looked for
_MOST = 4096  # samples looked at
_CLOSE = 1.35  # a ratio is within this factor of that of the mistake
_DEGREES = 180.0 / np.pi
_RPM = 30.0 / np.pi


def check_agreement(record: Recording, actuator: BldcActuator | None = None) -> None:
    """Compare positions, speeds and the command of a record with one another.

    Raises
    ------
    RecordError
        If two of them differ by the factor of a known mistake.
    """
    for side in ("motor", "output"):
        _check_speed(record, side)
    if record.output_position is not None:
        _refuse(
            ("command", record.command),
            ("output_position", record.output_position),
            *_angles(actuator),
        )
    if actuator is None or record.motor_position is None:
        return
    gear = actuator.transmission.ratio
    if record.output_position is not None:
        _refuse(
            ("motor_position over the gear ratio", record.motor_position / gear),
            ("output_position", record.output_position),
            *_angles(actuator),
        )


def _angles(actuator: BldcActuator | None) -> tuple[dict[float, str], dict[float, str]]:
    """Causes by factor, if the second column is too large, and if the first is."""
    larger = {_DEGREES: "{} looks like degrees"}
    if actuator is not None:
        larger[actuator.transmission.ratio] = "{} looks like an angle of the motor side"
    return larger, larger


def _check_speed(record: Recording, side: str) -> None:
    position, speed = getattr(record, f"{side}_position"), getattr(record, f"{side}_speed")
    if position is None or speed is None:
        return
    slope = f"the slope of {side}_position"
    _refuse(
        (slope, np.gradient(position, record.interval)),
        (f"{side}_speed", speed),
        {
            _RPM: "{} looks like rpm",
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
    every = -(-one.size // _MOST)
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
