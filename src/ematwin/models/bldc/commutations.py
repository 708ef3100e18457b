"""When a drive commutates, by recorded phase currents: its motor stands at a known angle then.

Under six-step commutation one phase is open, and which one it is changes at known electrical angles
(`hall_sector`). The phase that carried the current until then goes on for a moment, through a diode
to a rail of the supply; its mean in the sample in which that happens tells at which share of it.
Which phases change is the same again after half an electrical turn.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.channels import projected, trapezoid_shape
from ematwin.models.bldc.motor import SIXTH_TURN, hall_sector
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import plain
from ematwin.numerics.scalar import THIRD_TURN
from ematwin.numerics.signals import white_noise

_CLEAR = 8.0  # standard deviations of the noise, of the current in both phases that carry one
_OPEN = 0.35  # of it, at most, in the phase that is open
_LONGEST = 4  # samples, of a commutation


class Commutations(NamedTuple):
    """What phase currents (S, 3) tell of the angle of a motor."""

    when: np.ndarray  # (K,), samples from the first one
    angle: np.ndarray  # (K,), rad on its shaft, up to multiples of ``turn``
    near: np.ndarray  # (S,), the middle of the sector in which it stood; NaN where that is unknown
    turn: float  # rad


def commutations(currents: np.ndarray, rate: float, actuator: BldcActuator) -> Commutations:
    """Commutations of recorded phase currents (S, 3), A."""
    noise = float(np.mean([white_noise(x) for x in currents.T]))
    sizes = np.sort(np.abs(currents), axis=1)
    clear = np.flatnonzero((sizes[:, 1] > _CLEAR * noise) & (sizes[:, 0] < _OPEN * sizes[:, 1]))
    idle = np.abs(currents).argmin(axis=1)
    before, after = clear[:-1], clear[1:]
    some = (idle[before] != idle[after]) & (after - before <= _LONGEST)
    before, after = before[some], after[some]
    # the current of a phase that ends, by the mean of two samples
    ends = idle[after]
    carried = 0.5 * (currents[before, ends] + currents[np.maximum(before - 1, 0), ends])
    between = before[:, None] + np.arange(1, _LONGEST + 1)
    shares = currents[np.minimum(between, len(currents) - 1), ends[:, None]] / carried[:, None]
    shares = np.where(between <= after[:, None], np.clip(shares, 0.0, 1.0), 0.0)
    falls = 0.5 * _falling_time(np.abs(carried), actuator) * rate
    # c and b change at 90 degrees, and so on; in the middle of two boundaries b is open
    third = 3 - idle[before] - idle[after]  # the phase that carries on
    sector = SIXTH_TURN / actuator.motor.pole_pairs  # on the shaft
    near = np.full(len(currents), math.nan)
    near[clear] = sector * (2.0 * idle[clear])
    when = before + shares.sum(axis=1) - falls
    order = np.argsort(when, kind="stable")
    angle = sector * (1.5 + 2.0 * third)
    return Commutations(when[order], angle[order], near, 3.0 * sector)


def divided(
    current: np.ndarray, motor: np.ndarray, rate: float, actuator: BldcActuator
) -> np.ndarray:
    """Phase currents (S, 3), A, that make an equivalent ``current`` (S,) at angles ``motor``, rad.

    Of two phases that conduct: the third one's ends linearly after it has commutated.
    """
    parts, samples = 4, np.arange(current.size)
    within = (np.arange(parts * current.size) + 0.5) / parts - 1.0  # a mean ends at its sample
    electrical = actuator.motor.pole_pairs * np.interp(within, samples, motor)
    sector, every = np.array(plain(hall_sector)(electrical), dtype=int), np.arange(within.size)
    middles = SIXTH_TURN * (np.arange(6.0) + 1.0)
    pairs = trapezoid_shape(middles[:, None] - THIRD_TURN * np.arange(3))
    commutated = np.r_[False, np.diff(sector) != 0]
    last = np.maximum.accumulate(np.where(commutated, every, 0))
    before = sector[np.maximum(last - 1, 0)]
    falls = np.repeat(_falling_time(np.abs(current), actuator), parts) * rate * parts
    left = np.clip(1.0 - (every - last + 0.5) / np.maximum(falls, 1e-9), 0.0, 1.0)[:, None]
    carried = left * pairs[before] + (1.0 - left) * pairs[sector]
    carried = carried.reshape(-1, parts, 3).mean(axis=1)
    shown = projected(carried, electrical.reshape(-1, parts).mean(axis=1))
    return np.asarray(carried * (current / shown)[:, None])


def _falling_time(current: np.ndarray, actuator: BldcActuator) -> np.ndarray:
    """Time, s, in which a phase that has ended loses its ``current``, A."""
    # a third of the supply's voltage makes it fall
    winding = 0.5 * actuator.motor.inductance
    return np.asarray(3.0 * current * winding / actuator.drive.supply_voltage)
