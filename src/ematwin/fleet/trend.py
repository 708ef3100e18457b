"""Trend of a magnitude: level and slope over time, given estimates with their errors.

Local linear trend in continuous time (Harvey 1989, Forecasting, Structural Time Series Models and
the Kalman Filter, sec. 2.3; Durbin and Koopman 2012, Time Series Analysis by State Space Methods):

    d level = slope dt + dW,  var dW = q_level dt
    d slope = acceleration dt + dV,  var dV = q_slope dt
    y = level + effects . covariates + e,              var e = occasion^2 + scale^2 s^2

``s`` is the standard error of an estimate, ``occasion`` the scatter between occasions that no
recording shows. ``scale`` below one says that a part of ``s`` is the same in each recording. Start
and slope of each actuator come from normal distributions of the fleet, learnt with all variances at
the maximum of likelihood and weak priors (empirical Bayes): a new actuator begins with the fleet's
(partial pooling). After a jump the slope starts anew, from the fleet's slopes after jumps.

Jumps and outliers are found by the auxiliary residuals of the smoother (de Jong and Penzer 1998,
J. Am. Stat. Assoc. 93, 796-806), here as Bayes factors of one normal shock.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from ematwin.fleet.kalman import filtered, smoothed

_ROUNDS, _CLIMB, _EM = 3, 12, 3  # iterations: variances by slopes, then means by EM
_FACTOR = 2.0  # standard deviation of the logarithm of a variance beforehand: of few estimates
# the likelihood alone makes variances nothing, and life left too certain
_FEW = 3  # jumps that say what slopes are after them; with fewer the start of the iteration does
_MOST = 30  # shocks in one series
_TAUGHT = 200  # estimates of an actuator that teach the fleet: all of them teach no more
_LEVEL, _SLOPE, _EFFECTS = 0, 1, 2


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
    mean, spread : (4,) arrays, of level, slope and two effects of covariates at the start
    after : (2,) array, mean and spread of the slope after a jump
    acceleration : drift of the slope per year
    q_level, q_slope : variances per year
    occasion, scale : of the errors of estimates, see above
    size : standard deviation of jumps and of outliers, the range of the unknown
    jump_rate : jumps per actuator and year beforehand
    outlier_share : of estimates beforehand
    """

    mean: np.ndarray
    spread: np.ndarray
    after: np.ndarray
    acceleration: float
    q_level: float
    q_slope: float
    occasion: float
    scale: float
    size: float
    jump_rate: float = 0.1
    outlier_share: float = 0.01

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
    mean, covariance : (2,) and (2, 2) arrays, level and slope after the last estimate
    level, level_error : (n,) arrays, smoothed, and its standard error
    slope : (n,) array, smoothed, per year
    corrected : (n,) array, estimates less the effects of covariates
    outliers, jumps : indices of estimates that are outliers, and before which the level jumped
    evidence : logarithm of the probability density of the estimates
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
    _pass: "_Pass" = field(repr=False)

    @property
    def time(self) -> float:
        """Of the last estimate, years."""
        return float(self.series.time[-1])

    @property
    def constant_variance(self) -> float:
        """Of the error that all estimates have in common."""
        return self.wear.constant_variance(self.series.error)

    def at(self, moment: float) -> tuple[float, float, float]:
        """Level, its standard error and the slope at a later moment, years."""
        ahead = max(0.0, moment - self.time)
        mean, cov = self.later(ahead)
        return float(mean[0]), math.sqrt(cov[0, 0]), float(mean[1])

    def later(self, ahead: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of level and slope some years after the last estimate."""
        wear = self.wear
        move = np.array([[1.0, ahead], [0.0, 1.0]])
        mean = move @ self.mean + wear.acceleration * np.array([0.5 * ahead**2, ahead])
        cov = move @ self.covariance @ move.T
        cov[0, 0] += wear.q_level * ahead + self.constant_variance
        cov[0, 0] += wear.q_slope * ahead**3 / 3.0
        cov[0, 1] += wear.q_slope * ahead**2 / 2.0
        cov[1, 0] = cov[0, 1]
        cov[1, 1] += wear.q_slope * ahead
        return mean, cov


class _Pass:
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
        self.mean, self.cov, gain = np.empty((n + 1, 4)), np.empty((n + 1, 4, 4)), np.empty((n, 4))
        innovation, power = np.empty(n), np.empty(n)
        # contiguous: filter and smoother are compiled for each layout of their arguments
        time, value, covariates = map(
            np.ascontiguousarray, (series.time, series.value, series.covariates)
        )
        self.told = filtered(
            time, value, used, covariates, wear.mean, wear.spread,
            wear.after, wear.acceleration, wear.q_level, wear.q_slope, self.jump, self.reset,
            self.mean, self.cov, gain, innovation, power,
        )  # fmt: skip
        self.score, self.weight = np.empty((n, 4)), np.empty((n, 4, 4))
        self.residual, self.precision = np.empty(n), np.empty(n)
        self.smooth, self.error = np.empty((n, 4)), np.empty((n, 4))
        smoothed(
            time, covariates, self.jump, self.reset, self.mean, self.cov, gain,
            innovation, power, self.score, self.weight, self.residual, self.precision,
            self.smooth, self.error,
        )  # fmt: skip

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
    done = _Pass(series, wear, outliers, jumps)
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
        done = _Pass(series, wear, outliers, jumps)
    effect = (done.smooth[:, _EFFECTS:] * series.covariates).sum(axis=1)
    return Trend(
        series, wear, done.mean[-1, :2], done.cov[-1, :2, :2],
        done.smooth[:, _LEVEL], np.sqrt(np.maximum(done.error[:, _LEVEL], 0.0)),
        done.smooth[:, _SLOPE], series.value - effect,
        tuple(sorted(outliers)), tuple(sorted(jumps)), done.told, done,
    )  # fmt: skip


def learn(fleet: Sequence[Series], healthy: float, size: float) -> Wear:
    """Priors and variances of a magnitude from all actuators, by maximum likelihood.

    Parameters
    ----------
    fleet : one series for each actuator
    healthy : value of a healthy one
    size : range of the unknown
    """
    wear = before = _first(fleet, healthy, size)
    known = [one.thinned() for one in fleet if one.time.size]
    if not known:
        return wear
    for _ in range(_ROUNDS):
        shocks = [trend(one, wear) for one in known]
        wear = _climbed(known, shocks, wear, before)
        for _ in range(_EM):
            passes = [_again(s, t, wear) for s, t in zip(known, shocks, strict=True)]
            wear = _maximised(known, passes, wear)
    return wear


def _again(series: Series, shocks: Trend, wear: Wear) -> _Pass:
    return _Pass(series, wear, shocks.outliers, shocks.jumps)


def _first(fleet: Sequence[Series], healthy: float, size: float) -> Wear:
    """A start of the iteration: scatter from differences of neighbours, rates of a whole range."""
    steps = [np.diff(one.value) for one in fleet if one.time.size > 1]
    every = np.concatenate([*steps, np.zeros(0)])
    scatter = 1.4826 * float(np.median(np.abs(every))) / math.sqrt(2.0) if every.size else 0.0
    scatter = max(scatter, 1e-6 * size)
    return Wear(
        np.array([healthy, 0.0, 0.0, 0.0]), size * np.array([0.02, 0.1, 0.02, 0.02]),
        size * np.array([0.0, 0.1]), 0.0, (0.02 * size) ** 2, (0.05 * size) ** 2, scatter, 0.5,
        size,
    )  # fmt: skip


def _climbed(fleet: Sequence[Series], shocks: Sequence[Trend], wear: Wear, before: Wear) -> Wear:
    """The four variances at the maximum of likelihood and prior.

    The gradient comes from the scores of the smoother (Koopman and Shephard 1992, Biometrika 79,
    823-826).
    """
    least = (1e-6 * wear.size) ** 2

    def with_logs(x: np.ndarray) -> Wear:
        q_level, q_slope, occasion, scale = np.exp(x).tolist()
        return replace(
            wear, q_level=q_level, q_slope=q_slope, occasion=occasion**0.5, scale=scale**0.5
        )

    def told(x: np.ndarray) -> tuple[float, np.ndarray]:
        tried, total, slopes = with_logs(x), 0.0, np.zeros(4)
        for one, found in zip(fleet, shocks, strict=True):
            done = _again(one, found, tried)
            total += done.told
            dt = np.diff(one.time)
            for place, free in ((0, ~done.reset[1:]), (1, ~done.reset[1:] & (done.jump[1:] == 0))):
                surprise = done.score[1:, place] ** 2 - done.weight[1:, place, place]
                slopes[place] += 0.5 * (dt * surprise)[free].sum()
            seen = done.precision > 0.0
            surprise = done.residual[seen] ** 2 - done.precision[seen]
            slopes[2] += 0.5 * surprise.sum()
            slopes[3] += 0.5 * (one.error[seen] ** 2 * surprise).sum()
        away = (x - usual) / _FACTOR
        return 0.5 * away @ away - total, away / _FACTOR - slopes * np.exp(x)

    def logs(of: Wear) -> np.ndarray:
        return np.log(np.maximum([of.q_level, of.q_slope, of.occasion**2, of.scale**2], least))

    usual, begin = logs(before), logs(wear)
    bounds = [(math.log(least), math.log(10.0 * wear.size**2))] * 3 + [(-20.0, 5.0)]
    end = minimize(
        told, np.clip(begin, *np.transpose(bounds)), jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": _CLIMB},
    )  # fmt: skip
    return with_logs(end.x)


def _maximised(fleet: Sequence[Series], passes: Sequence[_Pass], wear: Wear) -> Wear:
    """Means and spreads after a step of expectation and maximisation (Shumway and Stoffer 1982)."""
    mean, spread = _moments(
        [done.smooth[0] for done in passes], [done.error[0] for done in passes]
    )  # fmt: skip
    pushed, lasted = 0.0, 1.0  # a year speaks against an acceleration
    after: list[np.ndarray] = []
    unsure: list[np.ndarray] = []
    for one, done in zip(fleet, passes, strict=True):
        jumps = np.flatnonzero(done.jump > 0.0)
        after += list(done.smooth[jumps, 1:2])
        unsure += list(done.error[jumps, 1:2])
        dt = np.diff(one.time)
        free = ~done.reset[1:] & (done.jump[1:] == 0.0)
        moved = wear.acceleration + wear.q_slope * done.score[1:, _SLOPE]
        pushed += float((dt * moved)[free].sum())
        lasted += float(dt[free].sum())
    least = 1e-6 * wear.size
    following = wear.after
    if len(after) >= _FEW:
        following = np.concatenate(_moments(after, unsure))
    return replace(
        wear, mean=mean, spread=np.maximum(spread, least), after=following,
        # one actuator cannot tell what its kind does from how its own slope wanders
        acceleration=pushed / lasted * (1.0 - 1.0 / len(fleet)),
    )  # fmt: skip


def _moments(
    means: Sequence[np.ndarray], variances: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and spread of quantities that are known with some variance."""
    mean = np.mean(means, axis=0)
    return mean, np.sqrt(np.mean(np.array(variances) + (np.array(means) - mean) ** 2, axis=0))
