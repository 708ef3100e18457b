"""Positions that come in the counts of an encoder.

A position of n counts lies between n and n + 1 steps, evenly distributed, and at usual speeds one
sample errs independently of the next: white noise of the variance step^2/12 (Widrow and Kollar
2008, Quantization Noise, chapter 5). A cubic smoothing spline (Reinsch 1967, Numer. Math. 10,
177-183) removes it without delay: of a frequency f it passes the share 1/(1 + (f/f_c)^4).
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from ematwin.numerics.signals import LowPass, white_noise
from ematwin.recordings.recording import Recording

_FINEST = 2.0 * math.pi / 100_000  # rad on the motor shaft: finer steps leave < 0.1 % of a current
CUTOFF = 2000.0  # Hz, of smoothed counts: at 500 Hz, where currents are compared, 0.4 % are lost
_OFF = 0.05  # of a step, that readings may be off whole ones: digits of a file


def step_of(position: np.ndarray) -> float:
    """Step (rad) of an encoder whose counts a position (S,) on the motor shaft is; 0 if of none."""
    shown = np.unique(position)
    gaps = np.diff(shown)
    gaps = gaps[gaps > _OFF * _FINEST]
    if gaps.size < 2 or (size := float(gaps.min())) < _FINEST:
        return 0.0
    counts = np.cumsum(np.r_[0.0, np.round(np.diff(shown) / size)])
    size = float(np.polyfit(counts, shown, 1)[0])
    return size if np.abs(gaps / size - np.round(gaps / size)).max() < _OFF else 0.0


def steps_of(recording: Recording, actuator: Any) -> tuple[float, float]:
    """Steps (rad on the motor shaft) of the positions of motor and output; 0 if of no encoder."""
    motor, output = recording.motor_position, recording.output_position
    on_motor = None if output is None else output * actuator.transmission.ratio
    return 0.0 if motor is None else step_of(motor), 0.0 if on_motor is None else step_of(on_motor)


def step_by_noise(position: np.ndarray) -> float:
    """Step (rad) of counts as noisy as a position (S,) on the motor shaft; 0 if it hardly is."""
    size = math.sqrt(12.0) * white_noise(position)
    # noise of finer steps is none in an acceleration
    return size if size > 2.0 * math.pi / 1_000_000 else 0.0


def said_of_steps(recording: Recording, actuator: Any) -> list[str]:
    """A sentence on each position that comes in counts."""
    ratios = (("motor", 1.0), ("output", actuator.transmission.ratio))
    return [
        f"The {side} position comes in steps, {2.0 * math.pi * ratio / size:,.0f} in a turn (of an "
        "encoder, or digits of a file): it is smoothed where speeds are taken from it."
        for (side, ratio), size in zip(ratios, steps_of(recording, actuator), strict=True)
        if size > 0.0
    ]


class SmoothingSpline:
    """The natural cubic spline of a trace at uniform times, smoothed above a cutoff (Hz) if given.

    By Reinsch's equations. `scipy.interpolate` has them for any times; it takes a quarter of a
    second to import, and 30 times as long for a spline. ``values`` (S,) are those at its times.
    """

    def __init__(self, time: np.ndarray, trace: np.ndarray, cutoff: float = math.inf) -> None:
        from scipy.linalg import cho_solve_banded

        self._begins, self._rate = float(time[0]), (len(time) - 1) / float(time[-1] - time[0])
        weight = (self._rate / (2.0 * math.pi * cutoff)) ** 4
        bends = cho_solve_banded((_factor(len(time) - 2, weight), False), np.diff(trace, 2))
        self._bends = np.pad(bends, 1)  # second derivative, times the square of an interval
        self.values = np.asarray(trace - weight * np.diff(np.pad(bends, 2), 2))

    def __call__(self, time: np.ndarray, order: int = 0) -> np.ndarray:
        """Values (T,) of the spline, or of its first or second derivative, at times (T,), s."""
        place = (time - self._begins) * self._rate
        n = np.clip(place.astype(int), 0, len(self.values) - 2)
        weights = self._weights(place - n, order)
        each = zip(weights, self._ends(), strict=True)
        return np.asarray(sum(weight * end[n] for weight, end in each))

    def finely(self, samples: int, parts: int, order: int = 0) -> np.ndarray:
        """The same at so many parts of each interval, up to one of its samples."""
        ends = np.array(self._ends())[:, : samples - 1]
        weights = np.vstack(self._weights(np.arange(parts) / parts, order))
        last = (samples - 1) / self._rate + self._begins
        return np.append(ends.T @ weights, self(np.array([last]), order))

    def _ends(self) -> tuple[np.ndarray, ...]:
        """Of each interval (S - 1,): value and bend at its beginning, then at its end."""
        return self.values[:-1], self._bends[:-1], self.values[1:], self._bends[1:]

    def _weights(self, t: np.ndarray, order: int) -> tuple[np.ndarray, ...]:
        """Weights (T,) of `_ends` at shares ``t`` (T,) of an interval."""
        s = 1.0 - t
        if order == 2:
            return 0.0 * s, self._rate**2 * s, 0.0 * t, self._rate**2 * t
        if order == 1:
            pace = self._rate / 6.0
            bent = -pace * (3.0 * s * s - 1.0), pace * (3.0 * t * t - 1.0)
            return np.full_like(s, -self._rate), bent[0], np.full_like(t, self._rate), bent[1]
        return s, (s * s - 1.0) * s / 6.0, t, (t * t - 1.0) * t / 6.0


@lru_cache(maxsize=8)
def _factor(count: int, weight: float) -> np.ndarray:
    """(3, count), Cholesky factor of the equations of so many bends."""
    from scipy.linalg import cholesky_banded

    bands = np.empty((3, count))
    bands[0], bands[1], bands[2] = weight, 1.0 / 6.0 - 4.0 * weight, 2.0 / 3.0 + 6.0 * weight
    return np.asarray(cholesky_banded(bands))


def speed_noise(size: float, cutoff: float, rate: float) -> float:
    """Standard deviation (rad/s) of the slope of a smoothing spline, by steps of ``size`` (rad).

    White noise of size^2/12 through the share of a frequency that passes: the integral of
    (2 pi f)^2/(1 + (f/f_c)^4)^2.
    """
    passes = math.pi * (2.0 * math.pi) ** 2 * cutoff**3 / (8.0 * math.sqrt(2.0))
    return size * math.sqrt(passes / (6.0 * rate))


def comparable_cutoff(size: float) -> float:
    """Cutoff (Hz) for currents that follow from speeds by steps of ``size`` (rad)."""
    # coarse counts leave as much below it as 10,000 below the usual one, about 1 % of a current
    usual = 2.0 * math.pi / 10_000
    return LowPass().cutoff * min(1.0, (usual / max(size, _FINEST)) ** (2.0 / 3.0))


def recorded_anew(
    motion: np.ndarray, recorded: np.ndarray, size: float, counts: bool
) -> np.ndarray:
    """Positions (S,) of a motion in counts that begin elsewhere; without ``counts`` as noisy."""
    if size == 0.0:
        return motion
    if not counts:
        noise = np.random.default_rng(0).standard_normal(motion.size)
        return np.asarray(motion + size / math.sqrt(12.0) * noise)
    # a smoothed motion keeps near its own counts: those a little beside would hardly differ
    beside = recorded[0] + size / math.sqrt(12.0)  # root mean square of any
    return np.asarray(beside + size * np.round((motion - beside) / size))
