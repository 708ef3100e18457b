"""Estimates along motions that were not recorded: the currents tell them, as the actuator does.

Such a motion, and so every residual, jumps where friction holds a mass at one point and not at the
next. So residuals are regressed on points around. Each regression begins with the motion of the
estimate before, and with less than the noise that is the likeliest there, a part of which is the
error of that estimate. Far off it is large, and so is what the regression looks at.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ematwin.estimation.constants import SMALLEST, WORTH
from ematwin.estimation.descent import TooFarError
from ematwin.estimation.laplace import principal
from ematwin.estimation.motion_fit import Along, MotionFit, nearer
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.optional import Candidate
from ematwin.models.parameter_set import ParameterSet
from ematwin.numerics.lanes import LANES
from ematwin.numerics.side_by_side import in_blocks

_REGRESSIONS = 30  # at most; mostly seven
_IN_VAIN = 3  # of them, in succession, that lead nowhere
_FIRST = 0.3  # of what is known beforehand: as far as the first one looks
_SHARES = (0.0, 1.0, 0.5, 0.25, 0.1)  # of a step to what a regression promises
_TELLS = 0.7  # of an equation, mean square weight: where jumps leave less, no fit ends
_STAYS = 0.5  # standard errors, root mean square of unknowns: adds 12 % to an error
_SHORTEST, _LONGEST = 1e-4, 0.2  # of a coordinate: within less, jumps and ripple decide


class Regression(MotionFit):
    """A fit by statistical linear regression, with what is known so far as ``information``."""

    promise: tuple[float, float]  # squared standard deviations before a step, and after it

    def regressed(
        self, z: np.ndarray, most: float = math.inf, last: tuple[float, float] | None = None
    ) -> tuple[np.ndarray, float]:
        """Coordinates (1, d) nearer to least squares, and how far those are.

        The latter in squared standard deviations; infinite where jumps hide much of an equation.
        Residuals and their slopes are regressed on points around, as far as the unknowns are known
        (statistical linear regression; Lefebvre, Bruyninckx and De Schutter 2002, IEEE Trans.
        Autom. Control 47(8), 1406-1408). Each point changes all of them, by an orthogonal design
        and its mirror image, so that jumps average over all points (Plackett and Burman 1946,
        Biometrika 33, 305-325). How far a residual is from its regression counts as its noise:
        where one jumps it tells little. `TooFarError` as of `descended`, where a step promises as
        much as the ``last`` one has kept.
        """
        chart, free = self._problem.chart, self._free
        here, (same, asked) = self.residuals(z), self._known_slopes(z)
        beside = self._around(z)
        points, moved = chart.to_values(beside), (beside - z)[:, free]
        lefts = self._lefts(points)
        slopes = np.zeros((free.size, here.size))
        scatters: list[np.ndarray | float] = [0.0] * len(self.every)
        for n, (part, mine, some) in enumerate(zip(self._parts, same, asked, strict=True)):
            changed = moved.copy()
            for pivot, one in mine.items():
                changed += np.outer(moved[:, np.searchsorted(free, pivot)], one.same[free])
            stable = [m for m, left in enumerate(lefts) if left[n] is not None]
            if len(stable) <= some.size + 1:  # beside this point a loop is unstable
                continue
            factors = np.column_stack([np.ones(len(stable)), changed[stable][:, some]])
            left = np.array([lefts[m][n] for m in stable])
            found = np.linalg.pinv(factors, rcond=1e-12) @ left
            here[part], slopes[some, part] = found[0], found[1:]
            freedom = max(1, len(stable) - len(found))
            rough = np.sum((left - factors @ found) ** 2, axis=0) / freedom
            scatters[n] = rough / self._scales[n] ** 2
        self._last = here, self._with_known(slopes, z, here, same)
        self._weigh()
        here, slopes = self._last
        weights = np.ones(here.size)
        for n, part in enumerate(self._parts):
            alike = self._counts[n] / self._remainders[n].independent
            weights[part] = 1.0 / np.sqrt(1.0 + alike * self._scales[n] ** 2 * scatters[n])
            if self._known[n] is None:  # else residuals are compared by those of another fit
                self._weights[n] = self._weights[n] * weights[part]
                here[part] *= weights[part]
                slopes[:, part] *= weights[part]
                weights[part] = 1.0
        self._learn(weights * slopes)
        step = self._least(z, weights * here, weights * slopes)
        change = step[free] @ slopes
        cost, least = self.promise = float(here @ here), float(np.sum((here + change) ** 2))
        kept = 1.0
        if last is not None and last[0] > last[1]:
            kept = min(1.0, max(0.0, (last[0] - cost) / (last[0] - last[1])))
        if cost - 2.0 * kept * (cost - least) > most:
            raise TooFarError
        tried = [chart.project(z + share * step) for share in _SHARES]
        points = chart.to_values(np.vstack(tried))
        found = zip(self._lefts(points), self._priors(points), strict=True)
        best = int(np.argmin([sum(_squares(x) for x in (*lefts, own)) for lefts, own in found]))
        if best == 0:  # slopes do not hold so far: the next look half as far
            self._learn(weights * slopes / _SHARES[2])
        self._last = here + _SHARES[best] * change, slopes
        jumps = min(float(np.mean(np.square(one))) for one in self._weights) < _TELLS
        return tried[best], math.inf if jumps else float(change @ change)

    def _lefts(self, points: np.ndarray) -> list[tuple[np.ndarray | None, ...]]:
        """What each equation leaves, in standard deviations, at each of some points (B, d)."""

        def of(some: Sequence[np.ndarray]) -> list[tuple[np.ndarray | None, ...]]:
            each: dict[Any, list[Candidate | None]] = {}
            found = []
            for n, along in enumerate(self.every):
                alike = along.recording, frozenset(self._given[n])
                if alike not in each:
                    each[alike] = [self.candidate(n, point) for point in some]
                found.append(self.scaled(n, each[alike]))
            return list(zip(*found, strict=True))

        return in_blocks(of, points, LANES)

    def _around(self, z: np.ndarray) -> np.ndarray:
        """(N, d), points around coordinates (1, d), as far as the information says."""
        assert self.information is not None
        chart, free = self._problem.chart, self._free
        ways = principal(
            self.information[np.ix_(free, free)], z[0, free], chart.lower[free], chart.upper[free],
            longest=_LONGEST, shortest=_SHORTEST,
        )  # fmt: skip
        count = free.size + 2
        random = np.random.default_rng(0).standard_normal((count, free.size))
        design = math.sqrt(count) * np.linalg.qr(random)[0]
        beside = np.tile(z, (2 * count, 1))
        beside[:, free] += np.vstack([design, -design]) @ ways
        return chart.project(beside)


def _squares(left: np.ndarray | None) -> float:
    return math.inf if left is None else float(left @ left)


def followed(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    z: np.ndarray,
    every: Sequence[Along],
    most: float,
    like: Problem | None,
) -> tuple[Problem, MotionFit, np.ndarray] | None:
    """The problem, a fit along motions that follow from estimates, and the last of these (1, d).

    From coordinates (1, d); arguments are else as of `ematwin.estimation.along_motion.informed`.
    None where loops would be unstable at the start.
    """
    remainders = {} if like is None or like.information is None else like.information.remainders
    aliases = partial(model.aliases, actuator)
    width = _known_so_far(model, actuator, problem, z, like) / _FIRST**2

    def fit_with(width: np.ndarray) -> Regression:
        return Regression(actuator, problem, z, every, remainders, aliases, (), width)

    before, last, ahead, settled, stayed = math.inf, None, like is None, False, 0
    for _ in range(_REGRESSIONS):
        every = every if settled else nearer(every, problem, z, remainders, ahead)
        fit = fit_with(width)
        if not np.isfinite(fit.residuals(z)).all():
            return None
        here = z
        z, moved = fit.regressed(here, most, last)
        stayed = stayed + 1 if np.array_equal(z, here) else 0
        assert fit.information is not None
        width, gained, last = fit.information, before - fit.cost, fit.promise
        # beside another problem noise is the same each time
        settled = moved < _STAYS**2 * len(fit.free) or (like is not None and gained < WORTH)
        settled |= stayed >= _IN_VAIN
        if settled and not ahead:
            break
        before = fit.cost
        if settled:  # no estimate will be nearer: what this one is wrong by counts as noise
            noise, ahead = [along.equation.noise for along in every], False
            every, found = nearer(every, problem, z, remainders), fit.finds_first_samples(z)
            if found:
                problem = problem.sampled_first(fit.first_samples)
            elif noise == [along.equation.noise for along in every]:
                break
    if ahead:  # they came to no end
        every = nearer(every, problem, z, remainders)
        fit = fit_with(width)
        z, _ = fit.regressed(z, most)
    if like is not None and fit.counts_more():
        z, _ = fit.regressed(z, most)
    return problem, fit, z


def _known_so_far(
    model: Model, actuator: ParameterSet, problem: Problem, z: np.ndarray, like: Problem | None
) -> np.ndarray:
    """(d, d), inverse covariance at coordinates (1, d): of priors, and of a search or ``like``."""
    step = 1e-3  # priors are smooth
    points = problem.chart.to_values(np.vstack([z, z + step * np.eye(z.shape[1])]))
    here, *beside = problem.prior_distances(points) / problem.noise
    slopes = (np.array(beside) - here) / step
    found = slopes @ slopes.T
    faults = {one.name for one in model.faults(actuator)}
    for n in range(len(problem.comparisons)):
        places = [place for name, place in problem.places(n).items() if name in faults]
        found[places, places] += SMALLEST**-2
    if like is not None and (known := like.information) is not None:
        names = [one.name for one in known.chart.unknowns]
        own = [n for n, name in enumerate(names) if name in problem.names]
        places = [problem.names.index(names[n]) for n in own]
        found[np.ix_(places, places)] += (known.root.T @ known.root)[np.ix_(own, own)]
    return np.asarray(found)
