"""Equivalent current: three phase currents as the one that the monitor model knows.

Two forms. The envelope needs only the currents,

    I_3eq = (|i_a| + |i_b| + |i_c|)/2,

which is max |i_k| whenever they sum to zero. Where the rotor angle is recorded, the currents are
projected on the EMF shapes f instead,

    I_3eq = (f_a i_a + f_b i_b + f_c i_c)/2,

the current that makes the same torque in a healthy motor. It keeps the sign, it does not rectify
noise, and commutation leaves no trace in it.
"""

import math

import numpy as np

from ematwin.signals.record import Record


def trapezoid_shape(theta_e: np.ndarray) -> np.ndarray:
    """EMF shape f at electrical angles (rad): trapezoid with flats of 120 degrees."""
    turns = theta_e / (2.0 * math.pi) - 0.25
    return np.clip(3.0 - 12.0 * np.abs(turns - np.round(turns)), -1.0, 1.0)


def current_envelope(record: Record) -> np.ndarray:
    """(S,) array, A, never negative: envelope of the phases, or magnitude of ``current``."""
    phases = record.phase_currents
    if phases is not None:
        return 0.5 * np.abs(phases).sum(axis=1)
    assert record.current is not None
    return np.abs(record.current)


def signed_current(record: Record, pole_pairs: int) -> np.ndarray | None:
    """(S,) array, A, signed equivalent current; None where the record does not determine it."""
    phases = [record.current_a, record.current_b, record.current_c]
    if record.motor_position is not None and phases[0] is not None:
        projected = np.zeros(len(record))
        for n, phase in enumerate(phases):  # one at a time: long records take memory enough
            assert phase is not None  # a record has all three or none
            theta_e = pole_pairs * record.motor_position - n * 2.0 * math.pi / 3.0
            projected += 0.5 * phase * trapezoid_shape(theta_e)
        return projected
    if phases[0] is None and record.current is not None and (record.current < 0.0).any():
        return record.current
    return None
