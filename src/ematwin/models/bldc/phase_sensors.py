"""How far the current sensors of the phases are off, told by the recording itself.

Hall sensors are stated to 1 % of their range each, which can be a fifth of the current of a light
motion; and the envelope of three phases takes an offset of one of them for a torque that comes and
goes with the electrical angle. Two laws tell offsets and gains apart from anything that the motor
does (derived here):

- under six-step commutation one phase is open and carries nothing, so that its sensor shows its
  offset;
- the currents of a star winding add up to zero. Between the two conducting phases the sum
  shows the difference of their gains. Neither law shows the gain that all share.

Both hold with any fault of the actuator.
"""

from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from ematwin.models.bldc.channels import PHASES, phase_currents
from ematwin.numerics.remembered import Remembered
from ematwin.numerics.signals import spread_of, white_noise
from ematwin.recordings.recording import Recording

_LOOKED_AT = 5_000  # samples
_PASSES = 12
_LOUD = 0.15  # of the RMS: more noise looks like a gain
_OPEN = 0.25  # of the largest of the three currents: more is a commutation
_CONDUCTING = 0.2  # of their RMS: less tells nothing
_FEWEST = 30  # samples in which a phase must have been open
_AS_LIKELY = 2.0  # times what the best solution leaves: so does another
_LARGE = 0.2  # of the RMS: an offset that a held current may be mistaken for
_EVENLY = 0.1  # of all open samples: each phase in a motion through whole turns
_OUTLYING = 3.0  # standard deviations
_CERTAIN = 5.0  # standard errors
_OFFSET = 0.005  # of the RMS: what is less does not matter
_GAIN = 0.003
_LARGEST_GAIN = 0.1  # more is another scale, or a channel that is something else
_ADDS_UP = 1e-6  # of the RMS: the third current was made of the others


@dataclass(frozen=True)
class PhaseSensors:
    """Errors of the current sensors of phases a, b, c.

    Attributes
    ----------
    offsets : (3,) array, A
    gains : (3,) array, 1 in the mean
    """

    offsets: np.ndarray
    gains: np.ndarray

    def corrected(self, recording: Recording) -> Recording:
        """The recording as sensors alike would show it."""
        return recording.changed(**{
            name: (recording.channels[name] - offset) / gain
            for name, offset, gain in zip(PHASES, self.offsets, self.gains, strict=True)
        })  # fmt: skip

    def __str__(self) -> str:
        said = []
        if self.offsets.any():
            said.append(f"{_by_phase(1e3 * self.offsets, '+.0f')} mA")
        if (self.gains != 1.0).any():
            said.append(f"{_by_phase(100.0 * (self.gains - 1.0), '+.1f')} %")
        return (
            f"The current sensors of the phases are off ({'; '.join(said)}), as open phases and "
            "the sum of the currents show; this was corrected."
        )


_FOUND = Remembered[PhaseSensors | None]()


def phase_sensors(recording: Recording) -> PhaseSensors | None:
    """How far the sensors of three phases are off; None where it is nothing, or cannot be told."""
    currents = phase_currents(recording)
    if currents is None:
        return None
    return _FOUND.of([currents], partial(_looked_for, currents))


def _looked_for(currents: np.ndarray) -> PhaseSensors | None:
    shown = currents[:: -(-len(currents) // _LOOKED_AT)]
    rms = float(np.sqrt(np.mean(shown**2)))
    if rms == 0.0 or max(map(white_noise, currents.T)) > _LOUD * rms:
        return None
    solved = _solved(shown, rms)
    if solved is None:
        return None
    offsets, errors = solved
    if not (np.abs(offsets) > np.maximum(_CERTAIN * errors, _OFFSET * rms)).any():
        offsets = np.zeros(3)
    gains, errors = _gains(shown - offsets, rms)
    if np.abs(gains).max() > _LARGEST_GAIN:
        return None
    if not (np.abs(gains) > np.maximum(_CERTAIN * errors, _GAIN)).any():
        gains = np.zeros(3)
    if not (offsets.any() or gains.any()):
        return None
    return PhaseSensors(offsets, 1.0 + gains)


def balanced(recording: Recording) -> Recording:
    """The recording with errors of its phases' sensors corrected; itself where there are none."""
    sensors = phase_sensors(recording)
    return recording if sensors is None else sensors.corrected(recording)


def _solved(shown: np.ndarray, rms: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Offsets (3,) and their standard errors, from currents (S, 3) as shown.

    A phase that holds a current may pass for an open one. Of solutions that leave as little the one
    nearest to zero counts, and a large offset only where each phase was open for a good while and
    the currents as shown leave far more.
    """
    middle = map(np.median, shown.T)
    starts = product(*((0.0, x) if abs(x) > _OFFSET * rms else (0.0,) for x in middle))
    apart = np.diff(np.sort(shown, axis=0), axis=0)
    steps = np.where(apart > 0.0, apart, np.inf).min(axis=0, initial=np.inf)
    ends = [end for end in (_offsets(shown, np.array(start), steps) for start in starts) if end]
    if not ends:
        return None
    left = np.array([_left(shown - offsets) for offsets, _ in ends])
    near = [ends[n] for n in np.flatnonzero(left <= _AS_LIKELY * left.min())]
    offsets, errors = min(near, key=lambda end: float(np.abs(end[0]).max()))
    if np.abs(offsets).max() > _LARGE * rms:
        counts = _open(shown - offsets).sum(axis=0)
        unevenly = counts.min() < _EVENLY * counts.sum()
        if unevenly or _left(shown) <= _AS_LIKELY * _left(shown - offsets):
            return None
    return offsets, errors


def _left(currents: np.ndarray) -> float:
    """How much current, A, is left of (S, 3) where one phase should be open and the sum vanish."""
    smallest = np.abs(currents).min(axis=1).mean()
    return float(smallest + np.abs(currents.sum(axis=1).mean()))


def _offsets(
    shown: np.ndarray, start: np.ndarray, steps: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """A solution near a start (3,), by converters with ``steps`` (3,), A.

    None where a phase was hardly ever open.
    """
    offsets, errors = start, np.empty(3)
    for _ in range(_PASSES):
        before, offsets = offsets, offsets.copy()
        is_open = _open(shown - before)
        for n in range(3):
            seen = shown[is_open[:, n], n]
            if seen.size < _FEWEST:
                return None
            middle = float(np.median(seen))
            spread = max(float(spread_of(np.abs(seen - middle))), steps[n])
            inside = seen[np.abs(seen - middle) <= _OUTLYING * spread]
            offsets[n], errors[n] = inside.mean(), spread / np.sqrt(inside.size)
        if np.abs(offsets - before).max() <= 0.1 * errors.max():
            return offsets, errors
    return None


def _open(currents: np.ndarray) -> np.ndarray:
    """Where each phase is open, (S, 3), while the other two conduct."""
    sizes = np.abs(currents)
    largest = sizes.max(axis=1, keepdims=True)
    smallest = sizes.argmin(axis=1)[:, None] == np.arange(3)
    conducts = largest > _CONDUCTING * np.sqrt(np.mean(currents**2))
    return np.asarray(smallest & conducts & (sizes < _OPEN * largest))


def _gains(currents: np.ndarray, rms: float) -> tuple[np.ndarray, np.ndarray]:
    """What gains (3,) are above their mean, and their standard errors; of currents (S, 3)."""
    total = currents.sum(axis=1)
    if np.abs(total - total.mean()).max() <= _ADDS_UP * rms:
        return _gains_of_two(currents)
    # sum_k (1 - g_k) i_k = 0 with g_c = -g_a - g_b, beside what is left of the offsets
    slopes = np.column_stack([
        currents[:, 0] - currents[:, 2], currents[:, 1] - currents[:, 2], np.ones(len(total)),
    ])  # fmt: skip
    return _fitted(slopes, total, np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, -1.0, 0.0]]))


def _gains_of_two(currents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same where one current was made of the other two.

    It shows the difference of their gains while its phase is open, when both of their sensors see
    one current: i_n = (g_2 - g_1) i for the current i from the one to the other.
    """
    is_open, found = _open(currents), []
    for n in range(3):
        here = currents[is_open[:, n]]
        one, other = (n + 1) % 3, (n + 2) % 3
        through = (here[:, one] - here[:, other]) / 2.0
        to_gains = np.zeros((3, 2))
        to_gains[one, 0], to_gains[other, 0] = -0.5, 0.5
        slopes = np.column_stack([through, np.ones(len(here))])
        found.append(_fitted(slopes, here[:, n], to_gains))
    return max(found, key=lambda one: np.abs(one[0]).max() / max(one[1].max(), _GAIN / _CERTAIN))


def _fitted(
    slopes: np.ndarray, seen: np.ndarray, to_gains: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gains and their standard errors, by least squares without outliers."""
    inside = np.ones(len(seen), dtype=bool)
    for _ in range(_PASSES):
        squares = np.linalg.pinv(slopes[inside].T @ slopes[inside])
        best = squares @ (slopes[inside].T @ seen[inside])
        left = np.abs(seen - slopes @ best)
        before, spread = inside, float(spread_of(left))
        inside = left <= _OUTLYING * spread
        if (inside == before).all():
            break
    return to_gains @ best, spread * np.sqrt(np.diag(to_gains @ squares @ to_gains.T))


def _by_phase(values: np.ndarray, how: str) -> str:
    each = zip(PHASES, values.tolist(), strict=True)
    return ", ".join(f"{name[-1]} {value:{how}}" for name, value in each)
