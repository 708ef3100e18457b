"""Priors and variances of the trends of a magnitude, learnt from a fleet.

Means, spreads and variances have weak priors; the logarithms of spreads and variances normal ones.
The likelihood of all actuators together gives the most probable values; other plausible ones are
drawn from their posterior (`weighted_draws`). A forecast averages over the draws, so that few
estimates, or few actuators, give a wide one.

All that for two laws of wear, an acceleration that fades and one that grows, as powers of time and
exponentials have them. Each has draws in proportion to its evidence, of the whole fleet.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from ematwin.fleet.trend import Draws, Series, Trend, Wear, trend

_FACTOR = 2.0  # standard deviation of the logarithm of a variance beforehand: of few estimates
# the likelihood alone makes variances nothing, and life left too certain
_DRAWS = 1000  # of means, spreads and variances: one for each path of a forecast


def learn(fleet: Sequence[Series], healthy: float, size: float) -> Wear:
    """Priors and variances of a magnitude from the series of all actuators.

    Each has an estimate; ``healthy`` is the value of a healthy one, ``size`` the range of the
    unknown.
    """
    known = [one.thinned() for one in fleet]
    # factors of e by which an acceleration falls over the record: of a power p of time 2 - p, in
    # the middle of powers between 0 and 2; or of an exponential, in the middle of growth up to e^4
    starts = [_first(fleet, healthy, size, falls) for falls in (1.0, -2.0)]
    wears, draws, weights = zip(*(_learnt(known, one) for one in starts), strict=True)
    share = np.cumsum(shares(np.concatenate(weights)))
    which = np.searchsorted(share, (np.arange(_DRAWS) + 0.5) / _DRAWS)  # systematic resampling
    count = weights[0].size
    parts = which[which < count], which[which >= count] - count
    others = [one.some(part) for one, part in zip(draws, parts, strict=True) if part.size]
    return replace(wears[parts[0].size < parts[1].size], others=tuple(others))


def _learnt(known: Sequence[Series], before: Wear) -> tuple[Wear, Draws, np.ndarray]:
    """The most probable wear with one law, from a start; draws of others, and their weights."""
    wear = before
    for _ in range(3):  # shocks and wear in turn
        posterior = _Posterior([trend(one, wear) for one in known], before)
        point = posterior.maximum(wear)
        wear = posterior.wear(point)
    points, weight = weighted_draws(posterior.density, point, posterior.root(point))
    return wear, _draws(points, wear.lasting), weight


def _point(wear: Wear) -> np.ndarray:
    """Logarithms of the four variances, the six means, logarithms of the squared spreads."""
    least = (1e-6 * wear.size) ** 2
    variances = [wear.q_level, wear.q_slope, wear.occasion**2, wear.scale**2]
    logs = np.log(np.maximum(variances, least))
    return np.concatenate([logs, wear.mean, 2.0 * np.log(wear.spread)])


def _draws(points: np.ndarray, lasting: float) -> Draws:
    """The wear at points (N, 16) as `_point` gives them."""
    q_level, q_slope, occasion, scale = np.exp(points[:, :4]).T
    mean, spread = np.ascontiguousarray(points[:, 4:10]), np.exp(0.5 * points[:, 10:])
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
        mean=np.array([healthy, 0.0, 0.0, 0.0, 0.0, 0.0]),
        spread=np.array([0.02 * size, slope, bend, 0.02 * size, 0.02 * size, slope]),
        q_level=(0.2 * slope) ** 2 * span, q_slope=(0.5 * slope) ** 2 / span, lasting=lasting,
        occasion=scatter, scale=0.5, size=size,
    )  # fmt: skip


class _Posterior:
    """Posterior of the wear at points (N, 16) of `_point`, given the shocks of some trends."""

    def __init__(self, trends: Sequence[Trend], before: Wear) -> None:
        self._trends, self._before, self._center = trends, before, _point(before)
        self._spread = np.concatenate([np.full(4, _FACTOR), before.spread, np.full(6, _FACTOR)])

    def density(self, points: np.ndarray) -> np.ndarray:
        """Logarithm of the density (N,), but for the evidence."""
        draws = _draws(points, self._before.lasting)
        told = np.zeros(len(points))
        for one in self._trends:
            told += one.ended(draws)[2] + one.shocks
        away = (points - self._center) / self._spread
        told -= (0.5 * away**2 + np.log(self._spread)).sum(axis=1)
        return np.nan_to_num(told, nan=-1e300, neginf=-1e300)

    def maximum(self, start: Wear) -> np.ndarray:
        """The point (16,) of the largest density."""
        begin = (_point(start) - self._center) / self._spread
        end = minimize(self._with_slope, begin, jac=True, method="L-BFGS-B", options={"ftol": 1e-7})
        return self._center + self._spread * end.x

    def wear(self, point: np.ndarray) -> Wear:
        """The wear at a point (16,)."""
        draws = _draws(point[None], self._before.lasting)
        found = {name: values[0] for name, values in zip(draws._fields, draws[:-1], strict=False)}
        return replace(self._before, **found)

    def root(self, point: np.ndarray) -> np.ndarray:
        """Root (16, 16) of about the covariance, by the curvature at the maximum."""
        away, step = (point - self._center) / self._spread, 1e-3
        slope = self._with_slope(away)[1]
        beside = np.array([self._with_slope(x)[1] for x in away + step * np.eye(away.size)])
        curvature = (beside - slope) / step
        values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
        # beyond what the prior says nothing is known less
        return np.asarray(self._spread[:, None] * vectors * np.maximum(values, 1.0) ** -0.5)

    def _with_slope(self, away: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the logarithm of the density, and its slope, in standard deviations beforehand."""
        step = 1e-5
        every = np.vstack([away, away + step * np.eye(away.size)])
        cost = -self.density(self._center + self._spread * every)
        return float(cost[0]), (cost[1:] - cost[0]) / step


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
