"""Plausibility of a record: units, limits, rate, length, wiring.

Each finding that makes the record useless is an error with the likely cause; each that merely
makes it doubtful is a warning. The criteria are stated where they are applied, and kept wide:
a faulty actuator must pass, a wrong unit must not.
"""

from itertools import combinations

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.bldc.channels import CURRENTS, PHASES, VOLTAGES
from ematwin.models.bldc.counts import said_of_steps
from ematwin.models.bldc.envelope import current_envelope
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.phase_sensors import phase_sensors
from ematwin.models.bldc.wiring import check_order
from ematwin.models.bldc.zeros import zeros
from ematwin.models.plausibility import FEWEST, check_agreement, check_sizes, check_sum
from ematwin.models.servo import check_motion
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording

_CUTOFF = LowPass().cutoff  # Hz, before the misfit


def check_plausible(record: Recording, actuator: BldcActuator) -> list[str]:
    """Sentences on doubts about a record.

    Raises
    ------
    RecordError
        If the record cannot be identified from, with the reason and the likely cause.
    """
    check_agreement(record, actuator)  # first, as it tells the cause and not the consequence
    _check_rate(record)
    _check_length(record)
    warnings = _check_motion(record, actuator)
    limit = actuator.drive.current_limit
    said = f"{actuator.name} limits it to {limit:g} A"
    check_sizes(record.channels, (*CURRENTS, "bus_current"), limit, "A", said)
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
    phases = [name for name in PHASES if name in recording.channels]
    if phases and len(phases) < len(PHASES):
        missing = [name for name in PHASES if name not in phases]
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
    envelope = current_envelope(record)
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
    known = [name for name in VOLTAGES if name in record.channels]
    values = [record.channels[name] for name in known]
    between = {f"{a} to {b}": x - y
               for (a, x), (b, y) in combinations(zip(known, values, strict=True), 2)}  # fmt: skip
    said = f"the supply of {actuator.name} has {supply:g} V"
    traces = {**between, **record.channels}
    check_sizes(traces, (*between, "bus_voltage"), supply, "V", said)
    if 0 < len(known) < len(VOLTAGES):
        missing = [name for name in VOLTAGES if name not in known]
        return [
            f"{', '.join(missing)} is missing, so the voltages are not used. Of two voltages "
            "against the third terminal, the third is zero."
        ]
    if known and not set(PHASES) <= record.channels.keys():
        return ["Voltages are not used without the currents of all three phases."]
    return []
