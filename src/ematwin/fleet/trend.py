"""Trend of a magnitude: level and slope over time, given estimates with their errors.

Local linear trend in continuous time (Harvey 1989, Forecasting, Structural Time Series Models and
the Kalman Filter, sec. 2.3; Durbin and Koopman 2012, Time Series Analysis by State Space Methods):

    d level = slope dt + dW,  var dW = q_level dt
    d slope = acceleration dt + dV,  var dV = q_slope dt
    d acceleration = -acceleration / lasting dt
    y = level + effects . covariates + e,              var e = occasion^2 + scale^2 s^2

``s`` is the standard error of an estimate, ``occasion`` the scatter between occasions that no
recording shows. ``scale`` below one says that a part of ``s`` is the same in each recording. An
acceleration fades, as of wear that goes with a power of time below 2 (damped trend; Gardner and
McKenzie 1985, Manage. Sci. 31, 1237-1246), or grows (``lasting`` below 0), as of wear that feeds
itself: an exponential of time. Start, slope and acceleration of each actuator come from normal
distributions of the fleet, learnt by `ematwin.fleet.learning` (empirical Bayes): a new actuator
begins with the fleet's (partial pooling). After a jump slope and acceleration start anew, the slope
from the fleet's after jumps.

Jumps and outliers are found by the auxiliary residuals of the smoother (de Jong and Penzer 1998,
J. Am. Stat. Assoc. 93, 796-806), here as Bayes factors of one normal shock.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ematwin.fleet.kalman import filtered, smoothed


@dataclass(frozen=True)
class Series:
    """Estimates of one magnitude of one actuator, one at least, ordered by time."""

    time: np.ndarray  # (n,) array, years
    value: np.ndarray  # value, error: (n,) arrays, estimate and its standard error
    error: np.ndarray
    covariates: np.ndarray  # (n, 2) array, standardised temperature and load; 0 where not recorded
    # times, years, from which on the actuator is as another one of the fleet
    overhauls: tuple[float, ...] = ()

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Contiguous, as filter and smoother are compiled for each layout of their arguments."""
        several = self.time, self.value, self.error, self.covariates
        return tuple(map(np.ascontiguousarray, several))

    def part(self, which: slice) -> "Series":
        """Some of the estimates."""
        return Series(
            self.time[which], self.value[which], self.error[which], self.covariates[which],
            self.overhauls,
        )  # fmt: skip

    def thinned(self) -> "Series":
        """At most 200 of its estimates, evenly: all of them teach a fleet no more."""
        return self.part(slice(None, None, -(-self.time.size // 200)))


@dataclass(frozen=True)
class Wear:
    """Distribution of a magnitude over the whole fleet."""

    # mean, spread: (6,) arrays, of level, slope, acceleration and two effects at the start, and of
    # the slope after a jump
    mean: np.ndarray
    spread: np.ndarray
    q_level: float  # q_level, q_slope: variances per year
    q_slope: float
    lasting: float  # years, in which an acceleration falls to 1/e; below 0 it grows by e in these
    occasion: float  # occasion, scale: of the errors of estimates, see above
    scale: float
    size: float  # standard deviation of jumps and of outliers, the range of the unknown
    jump_rate: float = 0.1  # jumps per actuator and year beforehand
    outlier_share: float = 0.01  # of estimates beforehand
    others: tuple["Draws", ...] = ()  # draws of other plausible values, for each law of wear some

    def variance(self, error: np.ndarray) -> np.ndarray:
        """Of the part of an estimate's error that differs between recordings."""
        return self.occasion**2 + (self.scale * error) ** 2

    @property
    def alone(self) -> "Draws":
        """These values as one draw."""
        several = (self.mean, self.spread, self.q_level, self.q_slope, self.occasion, self.scale)
        return Draws._make((*(np.array([one]) for one in several), self.lasting))


class Draws(NamedTuple):
    """N draws of the values of `Wear` with one law: (N, 6) and (N,) arrays."""

    mean: np.ndarray
    spread: np.ndarray
    q_level: np.ndarray
    q_slope: np.ndarray
    occasion: np.ndarray
    scale: np.ndarray
    lasting: float

    def some(self, part: np.ndarray) -> "Draws":
        """Some of them."""
        return Draws._make((*(one[part] for one in self[:-1]), self.lasting))

    def bend(self, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope and of level, after some years, by an acceleration of 1 per year^2."""
        rise = -self.lasting * np.expm1(-ahead / self.lasting)
        return rise, self.lasting * (ahead - rise)

    def constant_variance(self, error: np.ndarray) -> np.ndarray:
        """Of the part of an error that is the same in all recordings of an actuator, (N,)."""
        return np.maximum(0.0, 1.0 - self.scale**2) * float(np.median(error)) ** 2


class Trend:
    """Posterior of level and slope of a magnitude: a filter and a smoother, with given shocks.

    ``outliers`` and ``jumps`` are indices of estimates that are outliers, and before which the
    level jumped.
    """

    def __init__(
        self, series: Series, wear: Wear, outliers: Iterable[int] = (), jumps: Iterable[int] = ()
    ) -> None:
        n = series.time.size
        self.series, self.wear = series, wear
        self.outliers, self.jumps = tuple(sorted(outliers)), tuple(sorted(jumps))
        # (n,), variance of the jump before each estimate, and whether an overhaul lies before it
        self.jump, self.reset = np.zeros(n), np.zeros(n, dtype=bool)
        self.jump[list(self.jumps)] = wear.size**2
        starts = np.searchsorted(series.time, np.array(series.overhauls, dtype=float))
        self.reset[[i for i in starts if 0 < i < n]] = True
        moments = _moments(n)
        # (3,) and (3, 3), level, slope and acceleration at `time`; log density of the estimates
        (self.mean,), (self.covariance,), (told,) = self.ended(wear.alone, moments)
        self.told = float(told)
        # auxiliary residuals of the smoother, variance of the level; smoothed states
        several, self.smooth = np.empty((5, n)), np.empty((n, 5))
        self.score, self.weight, self.residual, self.precision, variance = several
        time, _, _, covariates = series.arrays
        smoothed(
            time, covariates, wear.lasting, self.jump, self.reset, *moments, *several, self.smooth
        )
        self.level = self.smooth[:, 0]  # (n,) array
        self.level_error = np.sqrt(np.maximum(variance, 0.0))  # (n,) array, its standard error

    def ended(
        self, draws: Draws, moments: tuple[np.ndarray, ...] | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (N, 3) at `time`, covariances, and log likelihoods (N,) of draws.

        For one draw ``moments`` are filled as the smoother needs them.
        """
        used = np.ones(self.series.time.size, dtype=bool)
        used[list(self.outliers)] = False
        count = len(draws.mean)
        found = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty(count)
        filtered(
            *self.series.arrays, used, self.jump, self.reset, draws, *found,
            *(_moments(0) if moments is None else moments),
        )  # fmt: skip
        if self.time > self.series.time[-1]:  # overhauled since
            mean, covariance, _ = found
            mean[:] = draws.mean[:, :3]
            covariance[:] = draws.spread[:, :3, None] ** 2 * np.eye(3)
        return found

    @property
    def time(self) -> float:
        """Of the last estimate, or of an overhaul after it, years."""
        return max(float(self.series.time[-1]), *self.series.overhauls, -math.inf)

    @property
    def corrected(self) -> np.ndarray:
        """(n,) array, estimates less the effects of covariates."""
        effects = self.smooth[:, 3:] * self.series.covariates
        return self.series.value - effects.sum(axis=1)

    @property
    def constant_variance(self) -> float:
        """Of the error that all estimates have in common."""
        return float(self.wear.alone.constant_variance(self.series.error)[0])

    @property
    def shocks(self) -> float:
        """Logarithm of the probability density of its jumps and outliers beforehand."""
        wear, gap = self.wear, np.diff(self.series.time, prepend=0.0)
        apart = math.log(wear.outlier_share / wear.size / math.sqrt(2.0 * math.pi))
        jumps = np.log(wear.jump_rate * gap[list(self.jumps)]).sum()
        return float(jumps + len(self.outliers) * apart)

    def odds(self) -> tuple[np.ndarray, np.ndarray]:
        """Log odds, (n,) each, of an outlier at, and of a jump before, each estimate."""
        wear, gap = self.wear, np.diff(self.series.time, prepend=self.series.time[0])
        with np.errstate(divide="ignore"):
            apart = np.log(wear.outlier_share) + _factor(self.residual, self.precision, wear.size)
            jump = np.log(wear.jump_rate * gap)
        jump += _factor(self.score, self.weight, wear.size)
        apart[self.precision == 0.0] = -np.inf
        jump[(self.jump > 0.0) | self.reset] = -np.inf
        return apart, jump

    @cached_property
    def states(self) -> list[tuple[Draws, np.ndarray, np.ndarray]]:
        """Draws of the wear, by law, with mean (N, 3) and covariance (N, 3, 3) at ``time``."""
        if not self.wear.others:
            return [(self.wear.alone, self.mean[None], self.covariance[None])]
        return [(one, *self.ended(one)[:2]) for one in self.wear.others]

    def at(self, moment: float) -> tuple[float, float, float]:
        """Level, its standard error and the slope at a later moment, years."""
        ahead = max(0.0, moment - self.time)
        (mean,), (cov,) = self._later(
            ahead, self.wear.alone, self.mean[None], self.covariance[None]
        )
        return float(mean[0]), math.sqrt(cov[0, 0]), float(mean[1])

    def later(self, ahead: float) -> list[tuple[Draws, np.ndarray, np.ndarray]]:
        """`states` some years after ``time``."""
        return [(one, *self._later(ahead, one, mean, cov)) for one, mean, cov in self.states]

    def _later(
        self, ahead: float, draws: Draws, mean: np.ndarray, cov: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        rise, climb = map(float, draws.bend(np.array(ahead)))
        left = math.exp(-ahead / draws.lasting)
        move = np.array([[1.0, ahead, climb], [0.0, 1.0, rise], [0.0, 0.0, left]])
        cov = move @ cov @ move.T
        cov[:, 0, 0] += draws.q_level * ahead + draws.constant_variance(self.series.error)
        powers = np.array([[ahead**3 / 3.0, ahead**2 / 2.0], [ahead**2 / 2.0, ahead]])
        cov[:, :2, :2] += draws.q_slope[:, None, None] * powers
        return mean @ move.T, cov


def _moments(n: int) -> tuple[np.ndarray, ...]:
    """Predicted states and covariances, gains, innovations and their variances, not filled."""
    return tuple(np.empty(shape) for shape in ((n, 5), (n, 5, 5), (n, 5), (n,), (n,)))


def _factor(score: np.ndarray, weight: np.ndarray, size: float) -> np.ndarray:
    """Log Bayes factor of a normal shock with standard deviation ``size`` over none."""
    ratio = 1.0 + weight * size**2
    return np.asarray(0.5 * (score**2 * size**2 / ratio - np.log(ratio)))


def trend(series: Series, wear: Wear) -> Trend:
    """Posterior of a series, with the jumps and outliers that are more likely than not."""
    found = Trend(series, wear)
    for _ in range(30):  # shocks at most
        apart, jump = found.odds()
        i, k = int(np.argmax(apart)), int(np.argmax(jump))
        if max(apart[i], jump[k]) <= 0.0:
            break
        if jump[k] >= apart[i]:
            # an outlier that the jump explains is none
            before = [one for one in found.outliers if one < k]
            found = Trend(series, wear, before, [*found.jumps, k])
        else:
            found = Trend(series, wear, [*found.outliers, i], found.jumps)
    return found
