"""Mistakes of wiring in a record: a phase of the wrong sign, phases swapped, a turned encoder.

The three currents of a star winding sum to zero, whatever the faults. Projected on the EMF
shapes at the recorded motor angle (`ematwin.models.bldc.envelope.signed_current`) they give the
whole equivalent current if the order is right, and half of it or less if it is not.
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.bldc.channels import phase_currents
from ematwin.models.bldc.envelope import projected
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.zeros import COHERENT
from ematwin.recordings.recording import Recording

_DOUBTFUL = 1.03  # times the share as it is: another zero may explain the currents; faults 1.01


def check_order(record: Recording, actuator: BldcActuator) -> list[str]:
    """A warning if the currents do not fit the motor angle and nothing explains it.

    Raises
    ------
    RecordError
        If another order of the phases, other signs, or another zero of the angle fits far better.
    """
    currents = phase_currents(record)
    if currents is None or record.motor_position is None:
        return []
    every = max(1, len(record) // 5_000)  # samples looked at
    currents = currents[::every]
    angle = actuator.motor.pole_pairs * record.motor_position[::every]
    if np.ptp(angle) < 2.0 * np.pi:  # too little of a turn to tell the phases apart
        return []
    whole = float(np.mean((0.5 * np.abs(currents).sum(axis=1)) ** 2))
    if whole == 0.0:
        return []
    work = _Work(record, actuator, every)

    def fit(currents: np.ndarray, angle: np.ndarray) -> _Fit:
        signed = projected(currents, angle)
        return _Fit(float(np.mean(signed**2)) / whole, work.sign(signed))

    given = fit(currents, angle)
    if given.share > 1.0 / _DOUBTFUL and given.sign >= 0:  # nothing can fit that much better
        return []
    zeros = {
        (sense, float(zero)): fit(currents, sense * angle + zero)
        for sense, zero in product((1, -1), np.arange(-np.pi, np.pi, np.pi / 36.0))
    }
    # half a turn more is a change of sign: of two equal fits the one that drives is right
    sense, zero = max(zeros, key=lambda key: (round(zeros[key].share, 3), zeros[key].sign))
    # the map turns the sign after the offset: angle = sign (number + offset)
    offset = sense * zero / actuator.motor.pole_pairs
    turned = "sign = -1 and " if sense < 0 else ""
    counted = (
        f"{100 * given.share:.0f} % of the current fits the EMF shapes at the recorded motor "
        f"angle, and {100 * zeros[sense, zero].share:.0f} % with {turned}offset = {offset:.3g} rad "
        "for motor_position"
    )
    gain = zeros[sense, zero].share / max(given.share, 1e-9)
    if given.share >= COHERENT and given.sign >= 0:
        doubtful = gain > _DOUBTFUL
        return [f"The motor position may have another zero: {counted}."] * doubtful
    if given.share >= COHERENT and gain <= _DOUBTFUL:
        raise RecordError(
            "All phase currents have the wrong sign against the motor angle: the motor would "
            "absorb more work than the load delivers. Give sign = -1 for the three currents, or "
            "for the motor position."
        )
    orders = {order: fit(currents[:, order], angle) for order in permutations(range(3))}
    order = max(orders, key=lambda key: orders[key].share)
    best = max(orders[order].share, zeros[sense, zero].share)
    if best < COHERENT or best < 1.05 * given.share:
        return [
            f"Only {100 * given.share:.0f} % of the current fits the EMF shapes at the recorded "
            "motor angle, and no other order of phases or zero of the angle explains it: check "
            "the motor position, its unit and the number of pole pairs."
        ]
    if orders[order].share >= 0.995 * best:  # of two causes the simpler one
        # phase_order names the phases that the given channels carry: the inverse of `order`
        carried = "".join("abc"[order.index(k)] for k in range(3))
        signs = " and sign = -1 for all three" if orders[order].sign < 0 else ""
        raise RecordError(
            f"The phases are swapped: at the recorded motor angle {100 * given.share:.0f} % of the "
            f"current fits the EMF shapes, and {100 * orders[order].share:.0f} % with phase_order "
            f'= "{carried}"{signs}. Give that in the map.'
        )
    raise RecordError(
        f"The motor position is not counted from phase a: {counted}. Give that in the map."
    )


@dataclass(frozen=True)
class _Fit:
    share: float  # of the mean square current that lies on the EMF shapes
    sign: int  # -1: the energy balance wants the opposite sign; 0: it cannot tell


class _Work:
    """The energy balance, which tells the sign of the currents.

    Friction and windings only take: the work of the motor exceeds that given to the load. If it
    does so with the opposite sign and not as given, the sign is wrong; if with both, an aiding
    load hides it.
    """

    def __init__(self, record: Recording, actuator: BldcActuator, every: int) -> None:
        assert record.motor_position is not None
        self._turned = np.gradient(record.motor_position[::every])
        self._torque_constant = actuator.motor.emf_constant  # N m/A of the equivalent current
        self._to_load = 0.0  # J
        if record.load is not None:
            output = record.output_position
            if output is None:
                output = record.motor_position / actuator.transmission.ratio
            self._to_load = float(record.load[::every] @ np.gradient(output[::every]))

    def sign(self, signed_current: np.ndarray) -> int:
        """+1, -1 or 0: whether this current can be right, only its opposite, or either."""
        motor = self._torque_constant * float(signed_current @ self._turned)
        as_given, opposite = motor > self._to_load, -motor > self._to_load
        return int(as_given) - int(opposite)
