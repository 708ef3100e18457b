"""When a drive commutates, by recorded phase currents: its motor stands at a known angle then.

Under six-step commutation one phase is open, and which one it is changes at known electrical angles
(`hall_sector`). The phase that carried the current until then goes on for a moment, through a diode
to a rail of the supply; its mean in the sample in which that happens tells at which share of it.
Which phases change is the same again after half an electrical turn.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.parameters import BldcActuator
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
    # a third of the supply's voltage makes it fall
    winding = 0.5 * actuator.motor.inductance
    falls = 1.5 * np.abs(carried) * winding / actuator.drive.supply_voltage * rate
    # c and b change at 90 degrees, and so on; in the middle of two boundaries b is open
    third = 3 - idle[before] - idle[after]  # the phase that carries on
    sector = math.pi / 3.0 / actuator.motor.pole_pairs  # on the shaft
    near = np.full(len(currents), math.nan)
    near[clear] = sector * (2.0 * idle[clear])
    when = before + shares.sum(axis=1) - falls
    order = np.argsort(when, kind="stable")
    angle = sector * (1.5 + 2.0 * third)
    return Commutations(when[order], angle[order], near, 3.0 * sector)
