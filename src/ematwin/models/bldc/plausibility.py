"""Plausibility of a record: units, limits, rate, length, wiring.

Each finding that makes the record useless is an error with the likely cause; each that merely
makes it doubtful is a warning. The criteria are stated where they are applied, and kept wide:
a faulty actuator must pass, a wrong unit must not.
"""

from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.bldc import channels as recorded
from ematwin.models.bldc.counts import said_of_steps
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.phase_sensors import phase_sensors
from ematwin.models.bldc.zeros import COHERENT, MOST, zero_by_dips, zeros
from ematwin.models.plausibility import FEWEST, check_agreement, check_sizes, check_sum
from ematwin.models.servo import check_motion
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording

_CUTOFF = LowPass().cutoff  # Hz, before the misfit
_DOUBTFUL = 1.03  # times the share as it is: another zero may explain the currents; faults 1.01


def check_plausible(record: Recording, actuator: BldcActuator) -> list[str]:
    """Sentences on doubts about a record; `RecordError` if it cannot be identified from."""
    check_agreement(record, actuator)  # first, as it tells the cause and not the consequence
    _check_rate(record)
    _check_length(record)
    warnings = _check_motion(record, actuator)
    limit = actuator.drive.current_limit
    said = f"{actuator.name} limits it to {limit:g} A"
    check_sizes(record.channels, (*recorded.CURRENTS, "bus_current"), limit, "A", said)
    warnings += _check_voltages(record, actuator)
    check_motion(record, actuator)
    sensors = phase_sensors(record)
    if sensors is not None:
        warnings.append(str(sensors))
        record = sensors.corrected(record)
    warnings += check_sum(record)
    if actuator.encoder is None:
        warnings += said_of_steps(record, actuator)
    angles = zeros(record, actuator)
    if angles is not None:
        warnings += angles.said(actuator)
        record = angles.corrected(record, actuator)
    return warnings + check_order(record, actuator)


def check_phases(recording: Recording) -> None:
    """Raise `RecordError` unless a recording has all three phases or the equivalent current."""
    what = recording.name if recording.source or recording.labels else "The record"
    phases = [name for name in recorded.PHASES if name in recording.channels]
    if phases and len(phases) < len(recorded.PHASES):
        missing = [name for name in recorded.PHASES if name not in phases]
        raise RecordError(
            f"{what} has {', '.join(phases)} but not {', '.join(missing)}; all three phases are "
            "needed, or the channel current in their place."
        )
    if not phases and "current" not in recording.channels:
        raise RecordError(
            f"{what} has no current; give current_a, current_b and current_c, or current."
        )


def _check_rate(record: Recording) -> None:
    rate, least = record.sample_rate, 4.0 * _CUTOFF
    fastest = 5e6  # Hz: no current of a motor is sampled faster
    if rate < least:
        hints = [
            f'"{unit}" (the rate would be {rate * factor:g} Hz)'
            for unit, factor in (("ms", 1e3), ("us", 1e6))
            if least <= rate * factor <= fastest / 10.0
        ]
        tail = f" If its time is not in s, give the unit: {' or '.join(hints)}." if hints else ""
        raise RecordError(
            f"The record is sampled at {rate:.6g} Hz; the comparison needs at least {least:g} Hz, "
            f"four times its low-pass of {_CUTOFF:g} Hz. Record faster.{tail}"
        )
    if rate > fastest:
        duration = record.time[-1] - record.time[0]
        raise RecordError(
            f"The record is sampled at {rate:.4g} Hz and lasts {duration:.3g} s, which no test "
            "bench does: its time looks like s read as ms or us. Correct the unit of "
            "time."
        )


def _check_length(record: Recording) -> None:
    duration, shortest = float(record.time[-1] - record.time[0]), 10.0 / _CUTOFF
    if duration < shortest or len(record) < FEWEST:
        raise RecordError(
            f"The record is too short: {len(record)} samples in {duration:.4g} s; at least "
            f"{FEWEST} samples and {shortest:g} s are needed. Record a whole movement."
        )


def _check_motion(record: Recording, actuator: BldcActuator) -> list[str]:
    envelope = recorded.current_envelope(record)
    inputs = (record.channels.get(name) for name in ("command", "load"))
    moves = any(np.ptp(values) > 0.0 for values in inputs if values is not None)
    # noise of a sensor is less
    idle = float(np.ptp(envelope)) <= 0.01 * actuator.drive.current_limit
    if float(envelope.max()) == 0.0:
        raise RecordError(
            "The current is zero throughout: the sensor was not connected, or another channel was "
            "meant. Map the right one."
        )
    if idle and not moves:
        raise RecordError(
            f"The record is constant: command {record.command[0]:.4g} rad, current "
            f"{envelope.mean():.4g} A. Nothing moved, so no fault can show; record a movement."
        )
    if idle:
        return [
            f"The command moves, but the current changes by only {np.ptp(envelope):.3g} A: check "
            "that the sensor was connected, and its unit."
        ]
    return []


def _check_voltages(record: Recording, actuator: BldcActuator) -> list[str]:
    """Sentences on voltages that cannot be used; refuses impossible ones."""
    supply = actuator.drive.supply_voltage
    known = [name for name in recorded.VOLTAGES if name in record.channels]
    values = record.channels
    between = {f"{a} to {b}": values[a] - values[b] for a, b in combinations(known, 2)}
    said = f"the supply of {actuator.name} has {supply:g} V"
    traces = {**between, **record.channels}
    check_sizes(traces, (*between, "bus_voltage"), supply, "V", said)
    if 0 < len(known) < len(recorded.VOLTAGES):
        missing = [name for name in recorded.VOLTAGES if name not in known]
        return [
            f"{', '.join(missing)} is missing, so the voltages are not used. Of two voltages "
            "against the third terminal, the third is zero."
        ]
    if known and not set(recorded.PHASES) <= record.channels.keys():
        return ["Voltages are not used without the currents of all three phases."]
    return []


def check_order(record: Recording, actuator: BldcActuator) -> list[str]:
    """A warning if the currents do not fit the motor angle and nothing explains it.

    Projected on the EMF shapes there they give the whole equivalent current if the order is right,
    and half of it or less if not. `RecordError` if another order, sign or zero fits far better.
    """
    currents = recorded.phase_currents(record)
    if currents is None:
        _check_zero_of_one_current(record, actuator)
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
    turned = actuator.motor.emf_constant * np.gradient(record.motor_position[::every])
    output = record.motor_position / actuator.transmission.ratio
    output = output if record.output_position is None else record.output_position
    load = 0.0 * output if record.load is None else record.load
    to_load = float(load[::every] @ np.gradient(output[::every]))  # work, J, by so many samples

    def fit(currents: np.ndarray, angle: np.ndarray) -> _Fit:
        signed = recorded.projected(currents, angle)
        work = float(signed @ turned)  # of the motor
        sign = int(work > to_load) - int(-work > to_load)
        return _Fit(float(np.mean(signed**2)) / whole, sign)

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
    reversed_ = "sign = -1 and " if sense < 0 else ""
    counted = (
        f"{100 * given.share:.0f} % of the current fits the EMF shapes at the recorded motor "
        f"angle, and {100 * zeros[sense, zero].share:.0f} % with {reversed_}offset = "
        f"{offset:.3g} rad for motor_position"
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


def _check_zero_of_one_current(record: Recording, actuator: BldcActuator) -> None:
    """Raise `RecordError` where its dips show commutations elsewhere than the motor's position."""
    found = zero_by_dips(record, actuator)
    if found is not None and abs(found) > MOST:
        raise RecordError(
            "The motor position is not counted from phase a: the current dips "
            f"{np.degrees(-found):.0f} deg electrical beside the commutations. Give offset = "
            f"{found / actuator.motor.pole_pairs:.3g} rad for motor_position in the map, or that "
            "and so many sixths of an electrical turn."
        )


class _Fit(NamedTuple):
    share: float  # of the mean square current that lies on the EMF shapes
    # Friction and windings only take: the work of the motor exceeds that given to the load. 1: it
    # does so as given; -1: only with the opposite sign; 0: with both, an aiding load hides it
    sign: int
