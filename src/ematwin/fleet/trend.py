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
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ematwin.fleet.kalman import filtered, smoothed

_MOST = 30  # shocks in one series
_TAUGHT = 200  # estimates of an actuator that teach the fleet: all of them teach no more
_LEVEL, _SLOPE, _EFFECTS = 0, 1, 3


@dataclass(frozen=True)
class Series:
    """Estimates of one magnitude of one actuator, ordered by time.

    Attributes
    ----------
    time : (n,) array, years
    value, error : (n,) arrays, estimate and its standard error
    covariates : (n, 2) array, standardised temperature and load; 0 where not recorded
    overhauls : times, years, from which on the actuator is as another one of the fleet
    """

    time: np.ndarray
    value: np.ndarray
    error: np.ndarray
    covariates: np.ndarray
    overhauls: tuple[float, ...] = ()

    def until(self, moment: float) -> "Series":
        """The series up to a moment, years."""
        n = int(np.searchsorted(self.time, moment, side="right"))
        return Series(
            self.time[:n], self.value[:n], self.error[:n], self.covariates[:n],
            tuple(at for at in self.overhauls if at <= moment),
        )  # fmt: skip

    def thinned(self) -> "Series":
        """At most `_TAUGHT` of its estimates, evenly."""
        every = -(-self.time.size // _TAUGHT) or 1
        return Series(
            self.time[::every], self.value[::every], self.error[::every],
            self.covariates[::every], self.overhauls,
        )  # fmt: skip


@dataclass(frozen=True)
class Wear:
    """Distribution of a magnitude over the whole fleet.

    Attributes
    ----------
    mean, spread : (5,) arrays, of level, slope, acceleration and two effects at the start
    after : (2,) array, mean and spread of the slope after a jump
    q_level, q_slope : variances per year
    lasting : years, in which an acceleration falls to 1/e; below 0 it grows by e in these
    occasion, scale : of the errors of estimates, see above
    size : standard deviation of jumps and of outliers, the range of the unknown
    jump_rate : jumps per actuator and year beforehand
    outlier_share : of estimates beforehand
    others : draws of other plausible values
    """

    mean: np.ndarray
    spread: np.ndarray
    after: np.ndarray
    q_level: float
    q_slope: float
    lasting: float
    occasion: float
    scale: float
    size: float
    jump_rate: float = 0.1
    outlier_share: float = 0.01
    others: tuple["Wear", ...] = ()

    def bend(self, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope and of level, after some years, by an acceleration of 1 per year^2."""
        rise = -self.lasting * np.expm1(-ahead / self.lasting)
        return rise, self.lasting * (ahead - rise)

    def variance(self, error: np.ndarray) -> np.ndarray:
        """Of the part of an estimate's error that differs between recordings."""
        return self.occasion**2 + (self.scale * error) ** 2

    def constant_variance(self, error: np.ndarray) -> float:
        """Of the part that is the same in all recordings of an actuator."""
        if not error.size:
            return 0.0
        return max(0.0, 1.0 - self.scale**2) * float(np.median(error)) ** 2


@dataclass(frozen=True)
class Trend:
    """Posterior of level and slope of a magnitude.

    Attributes
    ----------
    series : the data
    wear : the fleet's prior
    mean, covariance : (3,) and (3, 3) arrays, level, slope and acceleration at ``time``
    level, level_error : (n,) arrays, smoothed, and its standard error
    slope : (n,) array, smoothed, per year
    corrected : (n,) array, estimates less the effects of covariates
    outliers, jumps : indices of estimates that are outliers, and before which the level jumped
    evidence : logarithm of the probability density of the estimates, and of its jumps and outliers
    """

    series: Series
    wear: Wear
    mean: np.ndarray
    covariance: np.ndarray
    level: np.ndarray
    level_error: np.ndarray
    slope: np.ndarray
    corrected: np.ndarray
    outliers: tuple[int, ...]
    jumps: tuple[int, ...]
    evidence: float

    @cached_property
    def states(self) -> list[tuple[Wear, np.ndarray, np.ndarray]]:
        """Mean and covariance of the state at ``time``, for each draw of the wear."""
        if not self.wear.others:
            return [(self.wear, self.mean, self.covariance)]
        return [(one, *again(self.series, self, one).last()) for one in self.wear.others]

    @property
    def time(self) -> float:
        """Of the last estimate, or of an overhaul after it, years."""
        return max(float(self.series.time[-1]), *self.series.overhauls, -math.inf)

    @property
    def constant_variance(self) -> float:
        """Of the error that all estimates have in common."""
        return self.wear.constant_variance(self.series.error)

    def at(self, moment: float) -> tuple[float, float, float]:
        """Level, its standard error and the slope at a later moment, years."""
        ahead = max(0.0, moment - self.time)
        mean, cov = self._later(ahead, self.wear, self.mean, self.covariance)
        return float(mean[0]), math.sqrt(cov[0, 0]), float(mean[1])

    def later(self, ahead: float) -> list[tuple[Wear, np.ndarray, np.ndarray]]:
        """`states` some years after ``time``."""
        return [(one, *self._later(ahead, one, mean, cov)) for one, mean, cov in self.states]

    def _later(
        self, ahead: float, wear: Wear, mean: np.ndarray, cov: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        rise, climb = map(float, wear.bend(np.array(ahead)))
        left = math.exp(-ahead / wear.lasting)
        move = np.array([[1.0, ahead, climb], [0.0, 1.0, rise], [0.0, 0.0, left]])
        mean = move @ mean
        cov = move @ cov @ move.T
        cov[0, 0] += wear.q_level * ahead + wear.constant_variance(self.series.error)
        cov[0, 0] += wear.q_slope * ahead**3 / 3.0
        cov[0, 1] += wear.q_slope * ahead**2 / 2.0
        cov[1, 0] += wear.q_slope * ahead**2 / 2.0
        cov[1, 1] += wear.q_slope * ahead
        return mean, cov


class Pass:
    """One filter and smoother over a series, with shocks at given places."""

    def __init__(self, series: Series, wear: Wear, outliers: Sequence[int], jumps: Sequence[int]):
        n = series.time.size
        self.variance = wear.variance(series.error)
        used = self.variance.copy()
        used[list(outliers)] = np.inf
        self.jump = np.zeros(n)
        self.jump[list(jumps)] = wear.size**2
        self.reset = np.zeros(n, dtype=bool)
        starts = np.searchsorted(series.time, np.array(series.overhauls, dtype=float))
        self.reset[[i for i in starts if 0 < i < n]] = True
        self._renewed, self._wear = n in starts, wear
        self.mean, self.cov, gain = np.empty((n + 1, 5)), np.empty((n + 1, 5, 5)), np.empty((n, 5))
        innovation, power = np.empty(n), np.empty(n)
        # contiguous: filter and smoother are compiled for each layout of their arguments
        time, value, covariates = map(
            np.ascontiguousarray, (series.time, series.value, series.covariates)
        )
        self.told = filtered(
            time, value, used, covariates, wear.mean, wear.spread,
            wear.after, wear.q_level, wear.q_slope, wear.lasting, self.jump, self.reset,
            self.mean, self.cov, gain, innovation, power,
        )  # fmt: skip
        self.score, self.weight = np.empty((n, 5)), np.empty((n, 5, 5))
        self.residual, self.precision = np.empty(n), np.empty(n)
        self.smooth, self.error = np.empty((n, 5)), np.empty((n, 5))
        smoothed(
            time, covariates, wear.lasting, self.jump, self.reset, self.mean, self.cov, gain,
            innovation, power, self.score, self.weight, self.residual, self.precision,
            self.smooth, self.error,
        )  # fmt: skip

    def last(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of the state but for effects, after the last estimate or overhaul."""
        if self._renewed:
            return self._wear.mean[:3], np.diag(self._wear.spread[:3] ** 2)
        # copies: a view would keep all moments of the pass
        return self.mean[-1, :3].copy(), self.cov[-1, :3, :3].copy()

    def odds(self, series: Series, wear: Wear) -> tuple[np.ndarray, np.ndarray]:
        """Log odds, (n,) each, of an outlier at, and of a jump before, each estimate."""
        gap = np.diff(series.time, prepend=series.time[0])
        with np.errstate(divide="ignore"):
            apart = np.log(wear.outlier_share) + _factor(self.residual, self.precision, wear.size)
            jump = np.log(wear.jump_rate * gap)
        jump += _factor(self.score[:, _LEVEL], self.weight[:, _LEVEL, _LEVEL], wear.size)
        apart[self.precision == 0.0] = -np.inf
        jump[self.jump > 0.0] = -np.inf
        jump[self.reset] = -np.inf
        return apart, jump


def _factor(score: np.ndarray, weight: np.ndarray, size: float) -> np.ndarray:
    """Log Bayes factor of a normal shock with standard deviation ``size`` over none."""
    ratio = 1.0 + weight * size**2
    return np.asarray(0.5 * (score**2 * size**2 / ratio - np.log(ratio)))


def trend(series: Series, wear: Wear) -> Trend:
    """Posterior of a series, with the jumps and outliers that are more likely than not.

    Parameters
    ----------
    series : of at least one estimate
    wear : of the fleet, as `learn` gives
    """
    outliers: list[int] = []
    jumps: list[int] = []
    done = Pass(series, wear, outliers, jumps)
    for _ in range(_MOST):
        apart, jump = done.odds(series, wear)
        i, k = int(np.argmax(apart)), int(np.argmax(jump))
        if max(apart[i], jump[k]) <= 0.0:
            break
        if jump[k] >= apart[i]:
            jumps.append(k)
            # an outlier that the jump explains is none
            outliers = [one for one in outliers if one < k]
        else:
            outliers.append(i)
        done = Pass(series, wear, outliers, jumps)
    effect = (done.smooth[:, _EFFECTS:] * series.covariates).sum(axis=1)
    told = done.told + np.log(wear.jump_rate * np.diff(series.time, prepend=0.0)[jumps]).sum()
    told += len(outliers) * math.log(wear.outlier_share / wear.size / math.sqrt(2.0 * math.pi))
    return Trend(
        series, wear, *done.last(),
        done.smooth[:, _LEVEL], np.sqrt(np.maximum(done.error[:, _LEVEL], 0.0)),
        done.smooth[:, _SLOPE], series.value - effect,
        tuple(sorted(outliers)), tuple(sorted(jumps)), float(told),
    )  # fmt: skip


def again(series: Series, shocks: Trend, wear: Wear) -> Pass:
    """Filter and smoother with another wear, and the shocks of a trend."""
    return Pass(series, wear, shocks.outliers, shocks.jumps)
