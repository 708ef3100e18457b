"""From where angles are counted: no two sensors of an actuator are mounted at the same zero.

docs/models.md, "Zeros of angles". The twin counts the motor's angle from where the EMF of phase a
rises through zero, and the output's from where the motor stands in the middle of the gap. The
phases that conduct tell the electrical angle. Commutation takes a while, which looks like an angle
to the one side or the other by the sense of rotation: the mean of both is right within 0.3 degrees,
and one alone within 5. One equivalent current tells the angle up to a sixth of a turn, where a
current loop lets it dip after each commutation.
"""

import math
from dataclasses import dataclass

import numpy as np

from ematwin.models.bldc.channels import phase_currents, projected, signed_current
from ematwin.models.bldc.commutations import commutations
from ematwin.models.bldc.faults import backlash_factor
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.comparison import Placed
from ematwin.numerics.signals import Remembered, white_noise
from ematwin.recordings.recording import Recording

_LOOKED_AT = 5_000  # samples
_COARSE = math.radians(1.0)
_SURE = math.radians(0.75)
_AGREE = 12.0  # logarithm of the odds that dips agree by chance, at least
MOST = math.radians(15.0)  # electrical: beyond, phases may be swapped, or another sixth is right
COHERENT = 0.85  # of the mean square current that lies on the right shapes
_FOUND = Remembered[list[float] | None]()


@dataclass(frozen=True)
class Zeros:
    """What angles of a recording lack."""

    motor: float  # rad, of the motor's angle
    output: float  # rad on the motor shaft, of command and output

    def corrected(self, recording: Recording, actuator: BldcActuator) -> Recording:
        """The recording counted as the twin counts."""
        shifts = {"motor_position": self.motor}
        for name in ("command", "output_position"):
            shifts[name] = self.output / actuator.transmission.ratio
        return recording.changed(**{
            name: recording.channels[name] + shift
            for name, shift in shifts.items() if shift and name in recording.channels
        })  # fmt: skip

    def said(self, actuator: BldcActuator) -> list[str]:
        """A sentence on each."""
        found = []
        if self.motor:
            electrical = math.degrees(self.motor * actuator.motor.pole_pairs)
            found.append(
                f"The motor position is counted from {-electrical:+.1f} deg electrical of phase a, "
                "as the currents show; this was corrected."
            )
        if self.output:
            found.append(
                f"Motor and output position lie {self.output:+.3g} rad (motor shaft) apart in the "
                "middle of the gap; this was corrected."
            )
        return found


def zeros(recording: Recording, actuator: BldcActuator) -> Zeros | None:
    """Offset of a recorded motor angle; None where there is none, or it cannot be determined."""
    motor, currents = recording.motor_position, phase_currents(recording)
    if motor is None:
        return None
    pole_pairs, electrical, found = actuator.motor.pole_pairs, 0.0, None
    every = slice(None, None, -(-len(recording) // _LOOKED_AT))
    angle = pole_pairs * motor[every]
    ways = _ways(angle)
    if currents is None:
        found = zero_by_dips(recording, actuator)
    elif len(ways) == 2:
        steps = np.arange(-MOST, MOST + 0.5 * _COARSE, _COARSE)
        if tops := _tops(currents[every], angle, steps, ways):
            found = sum(tops) / len(tops)
    if found is not None and _SURE <= abs(found) <= MOST:
        electrical = found / pole_pairs
    lacks = Zeros(electrical, _apart(recording, actuator, electrical) if len(ways) == 2 else 0.0)
    return lacks if lacks.motor or lacks.output else None


def zero_by_dips(recording: Recording, actuator: BldcActuator) -> float | None:
    """Offset (rad, electrical, within a sixth of a turn) of a motor angle beside one current.

    The current dips after each commutation, as the motor passes one of six angles. None where
    dips might agree by chance (Rayleigh's test; Mardia and Jupp 2000, Directional Statistics,
    section 6.3), as of a comparator, whose current hardly dips.
    """
    motor, current = recording.motor_position, signed_current(recording, actuator.motor.pole_pairs)
    if motor is None or current is None:
        return None
    seen = commutations(current, recording.sample_rate, actuator)
    away = seen.angle - np.interp(seen.when, np.arange(motor.size), motor)
    turned = np.exp(2j * np.pi / seen.turn * away)
    if abs(turned.sum()) ** 2 < _AGREE * turned.size:
        return None
    for _ in range(3):  # dips elsewhere are of something else
        turned = turned[np.abs(np.angle(turned / turned.sum())) < math.radians(30.0)]
    return float(np.angle(turned.sum())) / 6.0


def counted(recording: Recording, actuator: BldcActuator) -> Recording:
    """The recording counted as the twin counts; itself where it already is."""
    found = zeros(recording, actuator)
    return recording if found is None else found.corrected(recording, actuator)


@dataclass(frozen=True)
class Turned:
    """How a twin without a recorded angle stands beside its recording."""

    angle: float  # rad, electrical, by which it lags behind
    share: float  # of the mean square current that lies on the EMF shapes there
    one_way: bool  # the rotor turned one way alone

    def placed(self, recording: Recording, actuator: BldcActuator) -> Placed | None:
        """The recording counted from where the rotor stands; None where it already is."""
        if self.share < COHERENT:
            return Placed(
                None,
                f"No angle of the rotor explains which phases conduct ({100 * self.share:.0f} % of "
                "the current at the best), so no fault can be put to a phase: check their order "
                "and the number of pole pairs, or record motor_position.",
            )
        # a twin moves nearly as recorded; commutation takes a while, as seen from one side
        if abs(self.angle) < math.radians(6.0 if self.one_way else 2.0):
            return None
        if self.one_way:  # half of a wide gap looks alike
            degrees = math.degrees(abs(self.angle))
            return Placed(
                None,
                f"The rotor stands {degrees:.0f} deg electrical beside command and output, and "
                "turned one way alone: it may be counted from elsewhere, or the gap may be wide. "
                "Record motor_position, or a motion both ways.",
            )
        return Placed(
            Zeros(0.0, self.angle / actuator.motor.pole_pairs).corrected(recording, actuator),
            "No motor_position was recorded: where the rotor stands, and so which phase a fault is "
            "in, was told from the phases that conduct.",
        )


def turned(
    recording: Recording, actuator: BldcActuator, current: np.ndarray, motor: np.ndarray
) -> Turned | None:
    """Lag of an angle of the motor behind the phase currents of a recording.

    A twin shows the sign of the ``current`` (S,), A, and the angle ``motor`` (S,), rad. An output
    that was recorded shows it better, but for half of the gap to one side or the other. None
    without currents, or where the motor turned too little or the twin diverged.
    """
    currents = phase_currents(recording)
    if currents is None:
        return None
    within = math.radians(10.0)
    if recording.output_position is not None:
        motor = actuator.transmission.ratio * recording.output_position
        widest = actuator.transmission.backlash * backlash_factor(1.0)
        within = 0.5 * actuator.motor.pole_pairs * widest
    every = slice(1, None, -(-len(motor) // _LOOKED_AT))  # at first nothing has been simulated
    angle = actuator.motor.pole_pairs * motor[every]
    currents, current = currents[every], current[every]
    ways = _ways(angle)
    turning = np.any(ways, axis=0) if ways else np.zeros(len(angle), dtype=bool)
    whole = float(np.sum((0.5 * np.abs(currents[turning]).sum(axis=1)) ** 2))
    if whole == 0.0 or not np.isfinite(current).all():
        return None
    steps = np.arange(-np.pi, np.pi, 5.0 * _COARSE)
    alike = [float(current @ projected(currents, angle + step)) for step in steps]
    nearby = steps[int(np.argmax(alike))] + np.arange(-within, within + 0.5 * _COARSE, _COARSE)
    tops = _tops(currents, angle, nearby, ways)
    if tops is None:  # nothing fits
        tops = [float(nearby[nearby.size // 2])] * len(ways)
    pairs = zip(ways, tops, strict=True)
    seen = sum(np.sum(projected(currents[way], angle[way] + top) ** 2) for way, top in pairs)
    lag = math.remainder(sum(tops) / len(tops), 2.0 * math.pi)
    return Turned(lag, float(seen) / whole, len(ways) < 2)


def _ways(angle: np.ndarray) -> list[np.ndarray]:
    """Masks (S,) of where a rotor turned each way, by an electrical turn in all at least."""
    at, across = np.arange(len(angle)), 10  # samples to both sides
    after, before = np.minimum(at + across, len(angle) - 1), np.maximum(at - across, 0)
    moved = angle[after] - angle[before]
    least = 7.0 * white_noise(angle)  # five standard deviations of a difference
    ways = [moved > least, moved < -least]
    return [way for way in ways if np.abs(moved[way]).sum() >= 2.0 * across * 2.0 * np.pi]


def _tops(
    currents: np.ndarray, angle: np.ndarray, steps: np.ndarray, ways: list[np.ndarray]
) -> list[float] | None:
    """For each way the angle with most current, near ``steps``; None at their ends."""

    def look() -> list[float] | None:
        found = []
        for way in ways:
            best = int(np.argmax(_shares(currents[way], angle[way], steps)))
            if best in (0, len(steps) - 1):
                return None
            found.append(_refined(currents[way], angle[way], float(steps[best])))
        return found

    return _FOUND.of((currents, angle, steps, *ways), look)


def _shares(currents: np.ndarray, angle: np.ndarray, steps: np.ndarray) -> list[float]:
    """Mean square current on the EMF shapes at electrical angles (S,), each so much further."""
    return [float(np.mean(projected(currents, angle + step) ** 2)) for step in steps]


def _refined(currents: np.ndarray, angle: np.ndarray, zero: float) -> float:
    """The top of a parabola through the mean squares around an angle."""
    near, fine = math.radians(3.0), math.radians(0.25)
    steps = np.arange(-near, near + 0.5 * fine, fine)
    curved, slope, _ = np.polyfit(steps, _shares(currents, angle + zero, steps), 2)
    top = float(np.clip(-slope / (2.0 * curved), -near, near)) if curved < 0.0 else 0.0
    return zero + top


def _apart(recording: Recording, actuator: BldcActuator, motor: float) -> float:
    """Distance (rad, motor shaft) of the output from the middle of the gap; 0 if of no account."""
    output, shown = recording.output_position, recording.motor_position
    if output is None or shown is None:
        return 0.0
    apart = shown + motor - output * actuator.transmission.ratio
    low, high = np.quantile(apart, (0.01, 0.99))
    middle, reach = 0.5 * (low + high), high - low
    healthy = actuator.transmission.backlash
    load = 0.0 if recording.load is None else float(np.abs(recording.load).max())
    # a load that pushes one way twists a gear that gives to one side
    twist = load / (actuator.transmission.ratio * actuator.contact.stiffness)
    # the middle may be off by 2 % of the reach that is seen, and by a quarter of the gap
    beside = 0.02 * reach + 0.25 * healthy + twist
    crossed = reach >= 0.5 * healthy
    return float(middle) if crossed and abs(middle) >= beside else 0.0
