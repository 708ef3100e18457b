"""How far the current sensors of the phases are off, told by the recording itself.

docs/models.md, "Sensors of the phases": under six-step commutation one phase of a star winding is
open, and the other two carry one current i. Offsets and gains follow by maximum likelihood with all
i unknown: the squares that count are orthogonal to the direction of the current, in units of the
noise of each sensor (total least squares: Golub and Van Loan 1980, SIAM J. Numer. Anal. 17,
883-893), so that noise does not look like a gain. Of two sensors, with the third current made of
theirs, only these two are in the equation.
"""

from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from ematwin.models.bldc.channels import PHASES, phase_currents
from ematwin.numerics.signals import Remembered, spread_of, white_noise
from ematwin.recordings.recording import Recording

_OPEN = 0.25  # of the largest of the three currents: more is a commutation
_AS_LIKELY = 2.0  # times what the best solution leaves: so does another
_OUTLYING = 3.0  # standard deviations
_ADDS_UP = 1e-6  # of the RMS: the third current was made of the others
_CARRIED = np.array([[0.0, 1.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -1.0, 0.0]])  # by the open phase


@dataclass(frozen=True)
class PhaseSensors:
    """Errors of the current sensors of phases a, b, c."""

    offsets: np.ndarray  # (3,), A
    gains: np.ndarray  # (3,), 1 in the mean of the sensors that are there
    made: int | None = None  # index of a phase without a sensor, of the other two's currents

    def corrected(self, recording: Recording) -> Recording:
        """The recording as sensors alike would show it."""
        currents = {
            name: (recording.channels[name] - offset) / gain
            for name, offset, gain in zip(PHASES, self.offsets, self.gains, strict=True)
        }
        if self.made is not None:  # it shows the gain of the one while the other is open
            one, other = (currents[name] for n, name in enumerate(PHASES) if n != self.made)
            currents[PHASES[self.made]] = -(one + other)
        return recording.changed(**currents)

    def __str__(self) -> str:
        said = []
        if self.offsets.any():
            said.append(f"{_by_phase(1e3 * self.offsets, 0)} mA")
        if (self.gains != 1.0).any():
            said.append(f"{_by_phase(100.0 * (self.gains - 1.0), 1)} %")
        return (
            f"The current sensors of the phases are off ({'; '.join(said)}), as open phases and "
            "the sum of the currents show; this was corrected."
        )


_FOUND = Remembered[PhaseSensors | None]()


def phase_sensors(recording: Recording) -> PhaseSensors | None:
    """How far the sensors of three phases are off; None where they are not, or none can tell."""
    currents = phase_currents(recording)
    if currents is None:
        return None
    currents = currents[recording.measured]
    return _FOUND.of([currents], partial(_looked_for, currents))


def balanced(recording: Recording) -> Recording:
    """The recording with errors of its phases' sensors corrected; itself where there are none."""
    sensors = phase_sensors(recording)
    return recording if sensors is None else sensors.corrected(recording)


@dataclass(frozen=True)
class _Fit:
    """Offsets (3,), A, and gains (3,), if all are off."""

    offsets: np.ndarray
    gains: np.ndarray
    free: np.ndarray  # (3 + f,), offsets and free gains less one
    covariance: np.ndarray  # (3 + f, 3 + f), of these
    precision: np.ndarray  # the same beforehand; none of offsets and gains together
    left: float  # A, residual of the fit
    made: int | None

    @property
    def sensors(self) -> PhaseSensors | None:
        """Sensors whose offsets, and whose gains, are off where that is certain."""
        offsets = self.offsets if self._are_off(slice(3)) else np.zeros(3)
        gains = self.gains if self._are_off(slice(3, None)) else np.ones(3)
        if not offsets.any() and (gains == 1.0).all():
            return None
        return PhaseSensors(offsets, gains, self.made)

    def _are_off(self, part: slice) -> bool:
        """By the densities of zero before and after (Dickey 1971, Ann. Math. Stat. 42, 204-223)."""
        certain = 0.95  # probability, before anything is corrected
        free, after = self.free[part], self.covariance[part, part]
        distance = float(free @ np.linalg.solve(after, free))
        shrunk = np.linalg.slogdet(self.precision[part, part] @ after)[1]
        return bool(distance + shrunk > 2.0 * np.log(certain / (1.0 - certain)))


def _looked_for(currents: np.ndarray) -> PhaseSensors | None:
    shown = currents[:: -(-len(currents) // 5_000)]
    rms = float(np.sqrt(np.mean(shown**2)))
    if rms == 0.0:
        return None
    noise = np.maximum([white_noise(x) for x in currents.T], _ADDS_UP * rms)
    adds_up = np.abs(shown.sum(axis=1)).max() <= _ADDS_UP * rms
    fits = (
        _Sensors(shown, noise, rms, made).fitted() for made in ((0, 1, 2) if adds_up else (None,))
    )
    best = min((one for one in fits if one is not None), key=lambda one: one.left, default=None)
    # a larger gain is another scale, or a channel that is something else
    return best.sensors if best and np.abs(best.gains - 1.0).max() <= 0.1 else None


class _Sensors:
    """Currents (S, 3) as shown, the noise (3,) and RMS of them, A, and the phase without a sensor.

    A sensor that is not there has no offset, and a gain of one.
    """

    def __init__(self, shown: np.ndarray, noise: np.ndarray, rms: float, made: int | None) -> None:
        self._shown, self._noise, self._rms, self._made = shown, noise, rms, made
        self._floor = max(0.2 * rms, float(noise.max()) * _OUTLYING / _OPEN)  # less tells nothing
        self._there = [n for n in range(3) if n != made]
        first, *others = self._there
        self._to_gains = np.zeros((3, len(others)))
        self._to_gains[others], self._to_gains[first] = np.eye(len(others)), -1.0
        apart = np.diff(np.sort(shown, axis=0), axis=0)
        steps = np.where(apart > 0.0, apart, np.inf).min(axis=0, initial=rms)
        self._step_errors = steps**2 / 12.0  # of an offset, which no mean makes smaller
        self._precision = np.diag(np.full(3 + len(others), rms**-2))
        # data sheets state gains to 1 %
        self._precision[3:, 3:] = self._to_gains.T @ self._to_gains / 0.01**2

    def fitted(self) -> _Fit | None:
        """The fit with the smallest offsets, of those that leave as little."""
        # A phase that holds a current may pass for an open one: a large offset counts only where
        # each phase was open for a good while and the currents as shown leave far more.
        middle = np.median(self._shown, axis=0)
        large = [n for n in self._there if abs(middle[n]) > 0.005 * self._rms]
        fits = []
        for chosen in product((0.0, 1.0), repeat=len(large)):
            start = np.zeros(3)
            start[large] = middle[large] * chosen
            fits += self._near(start)
        if not fits:
            return None
        least = min(one.left for one in fits)
        near = (one for one in fits if one.left <= _AS_LIKELY * least)
        best = min(near, key=lambda one: float(np.abs(one.offsets).max()))
        if np.abs(best.offsets).max() > 0.2 * self._rms:
            counts = self._open(best.offsets, best.gains).sum(axis=0)
            as_shown = self._left(np.zeros(3), np.ones(3))
            if counts.min() < 0.1 * counts.sum() or as_shown <= _AS_LIKELY * best.left:
                return None
        return best

    def _near(self, offsets: np.ndarray) -> list[_Fit]:
        """The fit near offsets (3,); none where a phase was hardly ever open."""
        free = np.concatenate([offsets, np.zeros(self._to_gains.shape[1])])
        for _ in range(12):
            is_open = self._open(*self._errors(free))
            if is_open.sum(axis=0).min() < 30:  # samples
                return []
            before = free
            free, covariance = self._step(is_open, free)
            if (np.abs(free - before) <= 0.1 * np.sqrt(np.diag(covariance))).all():
                break
        covariance[range(3), range(3)] += self._step_errors
        offsets, gains = self._errors(free)
        left = self._left(offsets, gains)
        return [_Fit(offsets, gains, free, covariance, self._precision, left, self._made)]

    def _errors(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (3,), A, and gains (3,)."""
        return free[:3], 1.0 + self._to_gains @ free[3:]

    def _step(self, is_open: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets and free gains after a step of Gauss and Newton, and their covariance."""
        # residuals: what is orthogonal to the direction in which the current appears, by the noise
        noise, there = self._noise[self._there], self._there
        offsets, gains = self._errors(free)
        residuals, slopes = [], []
        for n, carried in enumerate(_CARRIED):
            away = (self._shown[is_open[:, n]] - offsets)[:, there] / noise
            along = (gains * carried)[there] / noise
            square = float(along @ along)
            across = np.eye(len(there)) - np.outer(along, along) / square
            found = np.zeros((len(away), len(there), len(free)))
            found[:, :, there] = across / noise
            turned = across @ (carried[:, None] * self._to_gains)[there] / noise[:, None]
            found[:, :, 3:] = (away @ along / square)[:, None, None] * turned
            residuals.append(away @ across)
            slopes.append(found)
        left, by = np.concatenate(residuals), np.concatenate(slopes)
        sizes = np.sqrt(np.sum(left**2, axis=1))
        inside = sizes <= _OUTLYING * max(float(spread_of(sizes)), 1.0)
        left, by = left[inside], by[inside].reshape(-1, len(free))
        variance = max(1.0, float(np.sum(left**2)) / ((len(there) - 1) * len(left)))
        covariance = np.linalg.inv(by.T @ by / variance + self._precision)
        return free + covariance @ (
            by.T @ left.ravel() / variance - self._precision @ free
        ), covariance

    def _true(self, offsets: np.ndarray, gains: np.ndarray) -> np.ndarray:
        """The currents (S, 3) themselves."""
        currents = (self._shown - offsets) / gains
        if self._made is not None:
            currents[:, self._made] = -currents[:, self._there].sum(axis=1)
        return currents

    def _open(self, offsets: np.ndarray, gains: np.ndarray) -> np.ndarray:
        """Where each phase is open, (S, 3), while the other two conduct."""
        sizes = np.abs(self._true(offsets, gains))
        largest = sizes.max(axis=1, keepdims=True)
        smallest = sizes.argmin(axis=1)[:, None] == np.arange(3)
        return np.asarray(smallest & (largest > self._floor) & (sizes < _OPEN * largest))

    def _left(self, offsets: np.ndarray, gains: np.ndarray) -> float:
        """How much current, A, is left where one phase should be open and the sum vanish."""
        currents = self._true(offsets, gains)
        smallest = np.abs(currents).min(axis=1).mean()
        return float(smallest + np.abs(currents.sum(axis=1).mean()))


def _by_phase(values: np.ndarray, digits: int) -> str:
    rounded = np.round(values, digits) + 0.0  # no minus before a zero
    each = zip(PHASES, rounded.tolist(), strict=True)
    return ", ".join(f"{name[-1]} {value:+.{digits}f}" for name, value in each)
