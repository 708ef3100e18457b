"""Priors and variances of the trends of a magnitude, learnt from a fleet.

Means and spreads by expectation and maximisation (Shumway and Stoffer 1982, J. Time Ser. Anal. 3,
253-264), the four variances by the slope of the likelihood, both with weak priors. Other
plausible values are drawn from their posterior (`weighted_draws`), of variances their logarithms.
A forecast averages over the draws, so that few estimates, or few actuators, give a wide one.

All that for two laws of wear, an acceleration that fades and one that grows, as powers of time and
exponentials have them. Each has draws in proportion to its evidence, of the whole fleet.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize
from scipy.special import logsumexp, wrightomega
from scipy.stats import multivariate_t

from ematwin.fleet.trend import Draws, Series, Trend, Wear, trend

_FACTOR = 2.0  # standard deviation of the logarithm of a variance beforehand: of few estimates
# the likelihood alone makes variances nothing, and life left too certain
_DRAWS = 1000  # of means, spreads and variances: one for each path of a forecast


def learn(fleet: Sequence[Series], healthy: float, size: float) -> Wear:
    """Priors and variances of a magnitude from the series of all actuators, by maximum likelihood.

    ``healthy`` is the value of a healthy one, ``size`` the range of the unknown.
    """
    known = [one.thinned() for one in fleet if one.time.size]
    # factors of e by which an acceleration falls over the record: of a power p of time 2 - p, in
    # the middle of powers between 0 and 2; or of an exponential, in the middle of growth up to e^4
    starts = [_first(fleet, healthy, size, falls) for falls in (1.0, -2.0)]
    if not known:
        return starts[0]
    wears, draws, weights = zip(*(_learnt(known, one) for one in starts), strict=True)
    share = np.cumsum(shares(np.concatenate(weights)))
    which = np.searchsorted(share, (np.arange(_DRAWS) + 0.5) / _DRAWS)  # systematic resampling
    count = weights[0].size
    parts = which[which < count], which[which >= count] - count
    others = [one.some(part) for one, part in zip(draws, parts, strict=True) if part.size]
    return replace(wears[parts[0].size < parts[1].size], others=tuple(others))


def _learnt(known: Sequence[Series], before: Wear) -> tuple[Wear, Draws, np.ndarray]:
    """The wear of greatest likelihood with one law, from a start; draws of others, and weights."""
    wear = before
    for _ in range(3):
        trends = [trend(one, wear) for one in known]
        wear = _Likelihood(trends, wear, before).climbed()
        for _ in range(3):
            wear = _maximised(_again(trends, wear), wear, before)
    likelihood = _Likelihood(trends, wear, before)
    points, weight = weighted_draws(likelihood.density, _point(wear), likelihood.root())
    return wear, _draws(points, wear.lasting), weight


def _again(trends: Sequence[Trend], wear: Wear) -> list[Trend]:
    """The trends with another wear, and the shocks that were found."""
    return [Trend(one.series, wear, one.outliers, one.jumps) for one in trends]


def _point(wear: Wear) -> np.ndarray:
    """Logarithms of the four variances, the five means, logarithms of the squared spreads."""
    least = (1e-6 * wear.size) ** 2
    variances = [wear.q_level, wear.q_slope, wear.occasion**2, wear.scale**2]
    logs = np.log(np.maximum(variances, least))
    return np.concatenate([logs, wear.mean, 2.0 * np.log(wear.spread)])


def _draws(points: np.ndarray, lasting: float) -> Draws:
    """The wear at points (N, 14) as `_point` gives them."""
    q_level, q_slope, occasion, scale = np.exp(points[:, :4]).T
    mean, spread = np.ascontiguousarray(points[:, 4:9]), np.exp(0.5 * points[:, 9:])
    return Draws(mean, spread, q_level, q_slope, occasion**0.5, scale**0.5, lasting)


def _first(fleet: Sequence[Series], healthy: float, size: float, falls: float) -> Wear:
    """A start of the iteration, and the centre of the priors.

    Scatter from differences of neighbours; slopes of the whole range in ten years, or as straight
    lines show them. Over the time of the record a slope changes steadily by as much as it is, as in
    powers of time between 0 and 2, and by half of it at random; a level wanders by a fifth of its
    wear. Its acceleration ``falls`` by so many factors of e.
    """
    steps = [np.diff(one.value) for one in fleet if one.time.size > 1]
    every = np.concatenate([*steps, np.zeros(0)])
    scatter = 1.4826 * float(np.median(np.abs(every))) / math.sqrt(2.0) if every.size else 0.0
    scatter = max(scatter, 1e-6 * size)
    lines = [one for one in fleet if one.time.size > 2 and np.ptp(one.time) > 0.0]
    span = float(np.median([np.ptp(one.time) for one in lines])) if lines else 1.0
    seen = [float(np.polyfit(one.time - one.time[0], one.value, 1)[0]) for one in lines]
    slope = math.sqrt((0.1 * size) ** 2 + float(np.mean(np.square(seen or [0.0]))))
    lasting = max(span, 0.1) / falls  # years: shorter exponentials are no numbers in ten years
    bend = slope / (-lasting * math.expm1(-span / lasting))
    return Wear(
        np.array([healthy, 0.0, 0.0, 0.0, 0.0]),
        np.array([0.02 * size, slope, bend, *[0.02 * size] * 2]),
        np.array([0.0, slope]), (0.2 * slope) ** 2 * span, (0.5 * slope) ** 2 / span, lasting,
        scatter, 0.5, size,
    )  # fmt: skip


class _Likelihood:
    """Likelihood and prior, as functions of the logarithms of the variances, and of `_point`.

    The gradient comes from the scores of the smoother (Koopman and Shephard 1992, Biometrika 79,
    823-826).
    """

    def __init__(self, trends: Sequence[Trend], wear: Wear, before: Wear) -> None:
        self._trends, self.wear = trends, wear
        self._before, least = before, (1e-6 * wear.size) ** 2
        self._usual, self._begin = (_point(one)[:4] for one in (before, wear))
        self._bounds = np.array(
            [(math.log(least), math.log(10.0 * wear.size**2))] * 3 + [(-20.0, 5.0)]
        )

    def climbed(self) -> Wear:
        """The variances at the maximum."""
        end = minimize(
            self._told, np.clip(self._begin, *self._bounds.T), jac=True, method="L-BFGS-B",
            bounds=self._bounds, options={"maxiter": 12},
        )  # fmt: skip
        return self._with(end.x)

    def density(self, points: np.ndarray) -> np.ndarray:
        """Logarithm of the posterior density (N,) at points (N, 14), but for the evidence."""
        draws = _draws(points, self.wear.lasting)
        told = np.zeros(len(points))
        for one in self._trends:
            told += one.ended(draws)[2] + one.shocks
        spread = np.concatenate([np.full(4, _FACTOR), self._before.spread, np.full(5, _FACTOR)])
        away = (points - _point(self._before)) / spread
        told -= (0.5 * away**2 + np.log(spread)).sum(axis=1)
        return np.nan_to_num(told, nan=-1e300, neginf=-1e300)

    def root(self) -> np.ndarray:
        """Root (14, 14) of about the covariance of the posterior.

        Of variances by the curvature. An actuator whose own estimates leave the share 1 - r of the
        variance s^2 over the fleet tells r/s^2 of the mean, and r^2/2 of log s^2 (Fisher
        information of a normal distribution).
        """
        step = 0.1
        slopes = [
            (self._told(self._begin + move)[1] - self._told(self._begin - move)[1]) / (2.0 * step)
            for move in step * np.eye(4)
        ]
        values, vectors = np.linalg.eigh(0.5 * (np.array(slopes) + np.transpose(slopes)))
        # beyond what the prior says nothing is known less
        known = np.maximum(values, _FACTOR**-2)
        spread = self.wear.spread
        left = np.array([one.error[0] for one in _again(self._trends, self.wear)])
        told = np.clip(1.0 - left / spread**2, 0.0, 1.0)
        mean = self._before.spread**-2 + told.sum(axis=0) / spread**2
        factor = _FACTOR**-2 + 0.5 * (told**2).sum(axis=0)
        return np.asarray(block_diag(vectors * known**-0.5, np.diag([*mean**-0.5, *factor**-0.5])))

    def _with(self, x: np.ndarray) -> Wear:
        q_level, q_slope, occasion, scale = np.exp(x).tolist()
        return replace(
            self.wear, q_level=q_level, q_slope=q_slope, occasion=occasion**0.5, scale=scale**0.5
        )

    def _told(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        tried, total, slopes = self._with(x), 0.0, np.zeros(4)
        for done in _again(self._trends, tried):
            total += done.told
            dt = np.diff(done.series.time)
            for place, free in ((0, ~done.reset[1:]), (1, ~done.reset[1:] & (done.jump[1:] == 0))):
                surprise = done.score[1:, place] ** 2 - done.weight[1:, place, place]
                slopes[place] += 0.5 * (dt * surprise)[free].sum()
            seen = done.precision > 0.0
            surprise = done.residual[seen] ** 2 - done.precision[seen]
            slopes[2] += 0.5 * surprise.sum()
            slopes[3] += 0.5 * (done.series.error[seen] ** 2 * surprise).sum()
        away = (x - self._usual) / _FACTOR
        return 0.5 * float(away @ away) - total, away / _FACTOR - slopes * np.exp(x)


def _maximised(trends: Sequence[Trend], wear: Wear, before: Wear) -> Wear:
    """Means and spreads after a step of expectation and maximisation (Shumway and Stoffer 1982)."""
    mean, spread = _moments(
        [one.smooth[0] for one in trends], [one.error[0] for one in trends],
        before.mean, before.spread,
    )  # fmt: skip
    after: list[np.ndarray] = []
    unsure: list[np.ndarray] = []
    for one in trends:
        after += list(one.smooth[list(one.jumps), 1:2])
        unsure += list(one.error[list(one.jumps), 1:2])
    least = 1e-6 * wear.size
    following = wear.after
    if after:
        following = np.concatenate(_moments(after, unsure, *np.reshape(before.after, (2, 1))))
    return replace(wear, mean=mean, spread=np.maximum(spread, least), after=following)


def _moments(
    means: Sequence[np.ndarray], variances: Sequence[np.ndarray], usual: np.ndarray,
    spread: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Mean and spread of N quantities that are known with some variance, with weak priors.

    The mean has a normal prior with mean ``usual`` and deviation ``spread``; the logarithm x of the
    squared spread one with the mean x0 = log spread^2 and the deviation F = `_FACTOR`, so that

        (x - x0) / F^2 = N (S exp(-x) - 1) / 2

    for the mean square S, which the Wright omega function solves.
    """
    count, found = len(means), np.mean(means, axis=0)
    square = np.mean(np.array(variances) + (np.array(means) - found) ** 2, axis=0)
    x0, weight = 2.0 * np.log(spread), 0.5 * count * _FACTOR**2
    x = x0 - weight + wrightomega(np.log(weight * np.maximum(square, 1e-300)) - x0 + weight).real
    share = spread**2 / (spread**2 + np.exp(x) / count)
    return usual + share * (found - usual), np.exp(0.5 * x)


def weighted_draws(
    density: Callable[[np.ndarray], np.ndarray], center: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Draws (N, D) of a density, and logarithms of their weights (N,), whose mean is the integral.

    Adaptive importance sampling (Cornuet, Marin, Mira and Robert 2012, Scand. J. Stat. 39,
    798-812). Draws come from t distributions; each next one has the mean and covariance of all
    draws so far. Departure: while few draws have all the weight, mean and covariance are those of
    the density to a power below 1.

    ``density`` gives logarithms (N,) at points (N, D); ``center`` (D,) and ``root`` (D, D) are mean
    and root of the covariance to begin with.
    """
    tail = 8.0  # degrees of freedom: further out than the density reaches
    random = np.random.default_rng(1)
    points, logs = np.zeros((0, center.size)), np.zeros(0)
    known: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(6):
        known.append((center, root))
        z = random.standard_normal((500, center.size))
        new = center + z / np.sqrt(random.chisquare(tail, (500, 1)) / tail) @ root.T
        points, logs = np.concatenate([points, new]), np.concatenate([logs, density(new)])
        parts = [multivariate_t.logpdf(points, at, r @ r.T, df=tail) for at, r in known]
        drawn = logsumexp(parts, axis=0) - np.log(len(known))
        weight = logs - drawn
        power = 1.0
        while 1.0 / ((part := shares(power * weight)) ** 2).sum() < 100.0:
            power *= 0.7  # until a mean and a covariance have enough effective draws
        center = part @ points
        root = np.linalg.cholesky((part[:, None] * (points - center)).T @ (points - center))
    return points, weight


def shares(weight: np.ndarray) -> np.ndarray:
    """Shares (N,) of draws, which sum to 1, by the logarithms of their weights."""
    found = np.exp(weight - weight.max())
    return np.asarray(found / found.sum())
