"""Priors and variances of the trends of a magnitude, learnt from a fleet.

Means and spreads by expectation and maximisation (Shumway and Stoffer 1982, J. Time Ser. Anal. 3,
253-264), the four variances by the slope of the likelihood, both with weak priors. Other
plausible values are drawn from a normal distribution (Laplace), of variances their logarithms. A
forecast averages over the draws, so that few estimates, or few actuators, give a wide one.

All that for two laws of wear, an acceleration that fades and one that grows, as powers of time and
exponentials have them. Each has draws in proportion to its evidence, of the whole fleet.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, wrightomega

from ematwin.fleet.trend import Pass, Series, Trend, Wear, again, trend

_ROUNDS, _CLIMB, _EM = 3, 12, 3  # iterations: variances by slopes, then means by EM
_FACTOR = 2.0  # standard deviation of the logarithm of a variance beforehand: of few estimates
# the likelihood alone makes variances nothing, and life left too certain
_OTHERS = 12  # draws of means, spreads and variances
# By how many factors of e an acceleration falls over the record: of a power p of time, 2 - p, in
# the middle of powers between 0 and 2; or of an exponential, in the middle of growth up to e^4.
_FADES, _GROWS = 1.0, -2.0
_SHORTEST = 0.1  # years: exponentials of shorter records are no numbers ten years ahead


def learn(fleet: Sequence[Series], healthy: float, size: float) -> Wear:
    """Priors and variances of a magnitude from all actuators, by maximum likelihood.

    Parameters
    ----------
    fleet : one series for each actuator
    healthy : value of a healthy one
    size : range of the unknown
    """
    known = [one.thinned() for one in fleet if one.time.size]
    fades, grows = (_learnt(known, _first(fleet, healthy, size, one)) for one in (_FADES, _GROWS))
    told = [sum(trend(one, wear).evidence for one in known) for wear in (fades, grows)]
    share = float(expit(told[1] - told[0]))  # of the second law
    n = 2 * round(0.5 * share * len(grows.others))  # draws come in pairs, each about its mean
    return replace(grows if share > 0.5 else fades, others=grows.others[:n] + fades.others[n:])


def _learnt(known: Sequence[Series], before: Wear) -> Wear:
    """The wear of greatest likelihood with one law, from a start; other plausible ones."""
    wear = before
    if not known:
        return wear
    for _ in range(_ROUNDS):
        shocks = [trend(one, wear) for one in known]
        likelihood = _Likelihood(known, shocks, wear, before)
        wear = likelihood.climbed()
        for _ in range(_EM):
            passes = [again(s, t, wear) for s, t in zip(known, shocks, strict=True)]
            wear = _maximised(passes, wear, before)
    passes = [again(s, t, wear) for s, t in zip(known, shocks, strict=True)]
    return replace(wear, others=_draws(_Likelihood(known, shocks, wear, before), passes, before))


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
    lasting = max(span, _SHORTEST) / falls
    bend = slope / (-lasting * math.expm1(-span / lasting))
    return Wear(
        np.array([healthy, 0.0, 0.0, 0.0, 0.0]),
        np.array([0.02 * size, slope, bend, *[0.02 * size] * 2]),
        np.array([0.0, slope]), (0.2 * slope) ** 2 * span, (0.5 * slope) ** 2 / span, lasting,
        scatter, 0.5, size,
    )  # fmt: skip


class _Likelihood:
    """Likelihood and prior of the four variances, as functions of their logarithms.

    The gradient comes from the scores of the smoother (Koopman and Shephard 1992, Biometrika 79,
    823-826).
    """

    def __init__(
        self, fleet: Sequence[Series], shocks: Sequence[Trend], wear: Wear, before: Wear
    ) -> None:
        self._fleet, self._shocks, self.wear = fleet, shocks, wear
        least = (1e-6 * wear.size) ** 2
        self._usual, self._begin = (
            np.log(np.maximum([one.q_level, one.q_slope, one.occasion**2, one.scale**2], least))
            for one in (before, wear)
        )
        self._bounds = np.array(
            [(math.log(least), math.log(10.0 * wear.size**2))] * 3 + [(-20.0, 5.0)]
        )

    def climbed(self) -> Wear:
        """The variances at the maximum."""
        end = minimize(
            self._told, np.clip(self._begin, *self._bounds.T), jac=True, method="L-BFGS-B",
            bounds=self._bounds, options={"maxiter": _CLIMB},
        )  # fmt: skip
        return self._with(end.x)

    def draws(self, random: np.ndarray) -> list[Wear]:
        """Other plausible variances, by normal deviates (N, 4), with the curvature at these."""
        step = 0.1
        slopes = [
            (self._told(self._begin + move)[1] - self._told(self._begin - move)[1]) / (2.0 * step)
            for move in step * np.eye(4)
        ]
        values, vectors = np.linalg.eigh(0.5 * (np.array(slopes) + np.transpose(slopes)))
        # beyond what the prior says nothing is known less
        spread = np.maximum(values, _FACTOR**-2) ** -0.5
        points = self._begin + random * spread @ vectors.T
        return [self._with(np.clip(one, *self._bounds.T)) for one in points]

    def _with(self, x: np.ndarray) -> Wear:
        q_level, q_slope, occasion, scale = np.exp(x).tolist()
        return replace(
            self.wear, q_level=q_level, q_slope=q_slope, occasion=occasion**0.5, scale=scale**0.5
        )

    def _told(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        tried, total, slopes = self._with(x), 0.0, np.zeros(4)
        for one, found in zip(self._fleet, self._shocks, strict=True):
            done = again(one, found, tried)
            total += done.told
            dt = np.diff(one.time)
            for place, free in ((0, ~done.reset[1:]), (1, ~done.reset[1:] & (done.jump[1:] == 0))):
                surprise = done.score[1:, place] ** 2 - done.weight[1:, place, place]
                slopes[place] += 0.5 * (dt * surprise)[free].sum()
            seen = done.precision > 0.0
            surprise = done.residual[seen] ** 2 - done.precision[seen]
            slopes[2] += 0.5 * surprise.sum()
            slopes[3] += 0.5 * (one.error[seen] ** 2 * surprise).sum()
        away = (x - self._usual) / _FACTOR
        return 0.5 * float(away @ away) - total, away / _FACTOR - slopes * np.exp(x)


def _draws(likelihood: _Likelihood, passes: Sequence[Pass], before: Wear) -> tuple[Wear, ...]:
    """Other plausible variances, means and spreads.

    An actuator whose own estimates leave the share 1 - r of the variance s^2 over the fleet tells
    r/s^2 of the mean, and r^2/2 of log s^2 (Fisher information of a normal distribution).
    """
    wear, half = likelihood.wear, np.random.default_rng(1).standard_normal((_OTHERS // 2, 14))
    random = np.stack([half, -half], axis=1).reshape(_OTHERS, 14)
    told = np.array([np.clip(1.0 - done.error[0] / wear.spread**2, 0.0, 1.0) for done in passes])
    mean = (before.spread**-2 + told.sum(axis=0) / wear.spread**2) ** -0.5
    factor = (_FACTOR**-2 + 0.5 * (told**2).sum(axis=0)) ** -0.5
    several = zip(
        likelihood.draws(random[:, :4]), wear.mean + mean * random[:, 4:9],
        wear.spread * np.exp(0.5 * factor * random[:, 9:]), strict=True,
    )  # fmt: skip
    return tuple(replace(one, mean=m, spread=s) for one, m, s in several)


def _maximised(passes: Sequence[Pass], wear: Wear, before: Wear) -> Wear:
    """Means and spreads after a step of expectation and maximisation (Shumway and Stoffer 1982)."""
    mean, spread = _moments(
        [done.smooth[0] for done in passes], [done.error[0] for done in passes],
        before.mean, before.spread,
    )  # fmt: skip
    after: list[np.ndarray] = []
    unsure: list[np.ndarray] = []
    for done in passes:
        jumps = np.flatnonzero(done.jump > 0.0)
        after += list(done.smooth[jumps, 1:2])
        unsure += list(done.error[jumps, 1:2])
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
