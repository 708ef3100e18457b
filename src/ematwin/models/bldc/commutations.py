"""When a drive commutates, by its recorded currents: the motor stands at a known angle then.

Under six-step commutation one phase is open, and which one it is changes at known electrical angles
(`hall_sector`). The phase that carried the current until then goes on for a moment, through a diode
to a rail of the supply; its mean in the sample in which that happens tells at which share of it.
Which phases change is the same again after half an electrical turn. The next phase carries nothing
yet, so that one equivalent current dips, the same after each sixth of a turn.
"""

import math
from typing import NamedTuple

import numpy as np

from ematwin.models.bldc.channels import projected, trapezoid_shape
from ematwin.models.bldc.motor import SIXTH_TURN, hall_sector
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import plain
from ematwin.numerics.scalar import THIRD_TURN
from ematwin.numerics.signals import spread_of, white_noise

_CLEAR = 8.0  # standard deviations of the noise, of the current in both phases that carry one
_BEGUN = 4.0  # of these, of the current in the phase that follows
_OPEN = 0.35  # of it, at most, in the phase that is open
_LONGEST = 4  # samples, of a commutation
_DIP = 0.35  # of the current, by which it falls at least: by half or more behind a current loop
_STEADY = 0.15  # of that, the change from one sample to the next before, at most
_AT_ONCE = 0.3  # of that, the fall until the next sample, at least
_NEVER = 1e9  # rad: an angle that is known altogether
# of a sample, by which they came out off at 5 to 20 kHz, of a simulator of other make; and dips
_JITTER, _OF_DIPS = 0.16, 0.24
_OTHERS = 0.05  # of such falls, that are something else
_SHARP = 4.0  # standard deviations of such falls anywhere, at least


class Commutations(NamedTuple):
    """What currents of S samples tell of the angle of a motor."""

    when: np.ndarray  # (K,), samples from the first one
    angle: np.ndarray  # (K,), rad on its shaft, up to multiples of ``turn``
    near: np.ndarray  # (S,), rad, near which it stood up to such; NaN where that is unknown
    turn: float  # rad
    within: float  # rad, the furthest that it is from ``near``: a sector
    jitter: np.ndarray  # (K,), s, standard deviations of ``when``
    other: float = 0.0  # 1/rad, density of what is none

    def placed(self, motor: np.ndarray, near: np.ndarray) -> "Commutations":
        """The same at the multiple of ``turn`` that is nearest to the angle (S,) of a motor, rad.

        None of them where that is NaN, as in a loop that diverged; ``near`` is as of the result.
        """
        turns = (np.interp(self.when, np.arange(motor.size), motor) - self.angle) / self.turn
        angle, known = self.angle + np.round(turns) * self.turn, np.isfinite(turns)
        return self._replace(angle=angle, near=near, turn=_NEVER).rows(known)

    def rows(self, some: np.ndarray) -> "Commutations":
        """Some of them, by a mask or their numbers, in that order."""
        return self._replace(when=self.when[some], angle=self.angle[some], jitter=self.jitter[some])


def commutations(currents: np.ndarray, rate: float, actuator: BldcActuator) -> Commutations:
    """Commutations of recorded phase currents (S, 3), or of one equivalent current (S,), A."""
    if currents.ndim == 1:
        return _dips(currents, rate, actuator)
    noise = float(np.mean([white_noise(x) for x in currents.T]))
    sizes = np.sort(np.abs(currents), axis=1)
    clear = np.flatnonzero((sizes[:, 1] > _CLEAR * noise) & (sizes[:, 0] < _OPEN * sizes[:, 1]))
    idle = np.abs(currents).argmin(axis=1)
    before, after = clear[:-1], clear[1:]
    some = (idle[before] != idle[after]) & (after - before <= _LONGEST)
    before, after = before[some], after[some]
    # c and b change at 90 degrees, and so on; in the middle of two boundaries b is open
    ends, third = idle[after], 3 - idle[before] - idle[after]  # which carries on
    between = before[:, None] + np.arange(1, _LONGEST + 1)
    inside, between = between <= after[:, None], np.minimum(between, len(currents) - 1)
    # the current of a phase that ends, by the mean of two samples
    carried = 0.5 * (currents[before, ends] + currents[np.maximum(before - 1, 0), ends])
    shares = currents[between, ends[:, None]] / np.where(carried, carried, math.inf)[:, None]
    shares = np.where(inside, np.clip(shares, 0.0, 1.0), 0.0)
    falls = 0.5 * _falling_time(np.abs(carried), actuator) * rate
    when = before + shares.sum(axis=1) - falls
    # where the current had ended before the phase, at some time until the next phase carries one
    begun = np.abs(currents[between, idle[before, None]]) > _BEGUN * noise
    left = np.maximum(before + begun.argmax(axis=1) - when, 0.0)
    jitter = np.hypot(_JITTER, left / math.sqrt(12.0)) / rate
    when += 0.5 * left
    sector = SIXTH_TURN / actuator.motor.pole_pairs  # on the shaft
    near = np.full(len(currents), math.nan)
    near[clear] = sector * (2.0 * idle[clear])
    seen = Commutations(when, sector * (1.5 + 2.0 * third), near, 3.0 * sector, sector, jitter)
    return seen.rows(np.argsort(when, kind="stable"))


def _dips(current: np.ndarray, rate: float, actuator: BldcActuator) -> Commutations:
    """Commutations of an equivalent current (S,), A, by where it falls at once."""
    n = np.arange(_LONGEST, current.size - _LONGEST)
    rises = [0.5 * (current[n + side] - current[n + 3 * side]) for side in (-1, 1)]
    # by lines through three samples before and after each
    before, after = (
        (current[n + side] + current[n + 2 * side] + current[n + 3 * side]) / 3.0 + 2.0 * rise
        for side, rise in zip((-1, 1), rises, strict=True)
    )
    sign, sizes = np.sign(before), np.abs(before)
    falls = sign * (before - after)
    some = (falls > _DIP * sizes) & (falls < sizes)
    some &= falls > _SHARP * spread_of(np.abs(falls))  # that of counts in the loops, too
    # where the gear meets a face, a current rises or falls before, or for longer
    some &= np.abs(rises[0]) < _STEADY * falls
    some &= sign * (before - current[n + 1]) > _AT_ONCE * falls
    falls = np.where(some, falls, 0.0)
    # the sharpest of those near each other
    around = [np.roll(falls, shift) for shift in range(-_LONGEST + 1, _LONGEST)]
    sharpest = np.flatnonzero(some & (falls >= np.max(around, axis=0)))
    begun = sign * (before - current[n])
    shares = np.clip(begun[sharpest] / falls[sharpest], 0.0, 1.0)
    late = 0.5 * _falling_time(np.abs(before[sharpest]), actuator) * rate
    sector = SIXTH_TURN / actuator.motor.pole_pairs  # on the shaft
    return Commutations(
        n[sharpest] - shares - late, np.full(sharpest.size, 0.5 * sector),
        np.full(current.size, math.nan), sector, sector,
        np.full(sharpest.size, _OF_DIPS / rate), _OTHERS / sector,
    )  # fmt: skip


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
