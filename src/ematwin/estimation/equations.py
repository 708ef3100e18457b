"""The least squares of one equation along the recorded motion, for all recordings.

The linearised residuals of a fit tell what other residuals would leave after a fit of their own,
and what is left of stretches that the fit has not seen (cross-validation).
"""

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.constants import TWO_SIGMA
from ematwin.estimation.prior import Prior
from ematwin.models.comparison import correlation_time
from ematwin.models.optional import FIRST_SAMPLE, Candidate, Equation, Values, with_values
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.lanes import LANES
from ematwin.numerics.side_by_side import in_blocks, side_by_side

WIDE = 3.0  # standard deviation of the logarithm of what no file states
_ENDS = 0.05  # relative fall of the cost at which a fit ends
_STEP = 0.01  # of a logarithm, or of a radian, that is differenced
_LONGEST = 2.0  # of a step, in logarithms


@dataclass(frozen=True)
class EquationFit:
    """A fit of one equation to all recordings."""

    equations: "Equations"  # that were fitted
    actuator: ParameterSet  # with the values found
    places: tuple[str, ...]  # of the d fitted parameters
    left: np.ndarray  # (K,), recording after recording, as shares of the norm to be explained
    slopes: np.ndarray  # (d, K), by the coordinates of the fit
    pull: np.ndarray  # (d,), gradient of the prior, in the unit of the cost
    prior: np.ndarray  # (d, d), its curvature
    weight: float  # the cost of an independent residual
    alike: float = 0.0  # of the idealisation error of the equations, one sample in all

    def at(self, some: Any) -> "EquationFit":
        """The same of some of the residuals alone."""
        return replace(self, left=self.left[some], slopes=self.slopes[:, some])

    @property
    def cost(self) -> float:
        """Share of the energy that is left."""
        return float(self.left @ self.left)

    @property
    def step(self) -> np.ndarray:
        """(d,) step to the least squares of the linearised residuals."""
        curvature = self.prior + self.slopes @ self.slopes.T
        return _least(curvature, self.pull + self.slopes @ self.left)

    @property
    def information(self) -> tuple[np.ndarray, np.ndarray]:
        """Inverse covariance (d, d) and its gradient (d,) here, by the recordings alone."""
        unit = self.weight + self.alike
        return self.slopes @ self.slopes.T / unit, self.slopes @ self.left / unit

    def projected(self, left: np.ndarray, scaled: bool) -> float:
        """What would be left of other residuals (K,) if all that is fitted were fitted anew.

        With ``scaled`` the change from this fit's residuals to them may be of any size, as that by
        a parameter of a form is; infinite where the size would be negative, which no form has.
        """
        slopes, prior, pull = self.slopes, self.prior, self.pull
        if scaled:
            slopes = np.vstack([slopes, left - self.left])
            prior, pull = np.pad(prior, (0, 1)), np.pad(pull, (0, 1))
        moments, slope = slopes @ slopes.T, slopes @ left
        step = _least(prior + moments, pull + slope)
        if scaled and step[-1] < -1.0:
            return math.inf
        return float(left @ left + step @ (2.0 * slope + moments @ step))

    def held_back(self) -> np.ndarray:
        """Energy left in each stretch by a fit that has not seen its recording, or its stretch."""
        parts = self.equations.parts
        stretches = [np.array_split(np.arange(part.start, part.stop), 6) for part in parts]
        groups = stretches if len(parts) > 1 else [[one] for one in stretches[0]]
        found = []
        for group in groups:
            unseen = np.zeros(self.left.size, dtype=bool)
            unseen[np.concatenate(group)] = True
            step = self.at(~unseen).step
            lefts = (self.left[some] + step @ self.slopes[:, some] for some in group)
            found += [float(left @ left) for left in lefts]
        return np.array(found)

    def beats(self, other: "EquationFit", noise: float) -> bool:
        """Whether held-out data are explained better, by more than the scatter of the gain.

        Noise leaves a ``noise`` of the energy: stretches with less tell nothing.
        """
        own, others = self.held_back(), other.held_back()
        gain = np.log((others + noise / own.size) / (own + noise / own.size))
        return bool(gain.mean() > TWO_SIGMA * gain.std(ddof=1) / math.sqrt(gain.size))


def candidate(actuator: ParameterSet, values: Values) -> Candidate | None:
    """An actuator with values by place, and those by name; None where a loop would be unstable."""
    beside = {name: value for name, value in values.items() if "." not in name}
    try:
        return with_values(actuator, values), beside
    except EmatwinError:
        return None


def lefts_of(equation: Equation, candidates: Sequence[Candidate | None]) -> list[np.ndarray | None]:
    """What an equation leaves of the recording, (K,), with each of some candidates."""
    stable = [one for one in candidates if one is not None]
    each = equation.each or (lambda some: [equation.left(*one) for one in some])
    lefts = iter(each(stable))
    return [None if one is None else next(lefts) for one in candidates]


def _least(curvature: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """(d,) step to the minimum of a quadratic form."""
    return np.asarray(-np.linalg.lstsq(curvature, gradient, rcond=1e-12)[0])


def with_secant(slopes: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Slopes (d, K) of residuals that changed by ``change`` (K,) on a step (d,).

    Broyden's update (1965, Math. Comp. 19, 577-593), the least one by which slopes agree with it.
    """
    return slopes + np.outer(step / (step @ step), change - step @ slopes)


class Equations:
    """One equation of several recordings, and its least squares.

    Parameters are held by the tolerances of a template, or in their place by what other equations
    tell of them, ``known``. Load, sensors and timing, which differ from recording to recording, are
    ``beside``: the changes they may make (`Equation.changes`) count as noise.
    """

    def __init__(
        self,
        template: ParameterSet,
        equations: Sequence[Equation],
        known: Prior | None = None,
        beside: Sequence[Unknown] = (),
    ) -> None:
        self.each, self._stated, self._known = equations, stated_values(template), known
        self.first_samples = [0.0] * len(equations)  # of the loops in each recording, s
        lefts = side_by_side(lambda one: one.left(template, {}), equations)
        ends = np.cumsum([left.size for left in lefts]).tolist()
        # of the residuals, those of each recording
        self.parts = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
        self._size = math.sqrt(sum(one.size**2 for one in equations))
        pairs = zip(equations, lefts, strict=True)
        self._beside = [_changed_by(beside, one, left, template) for one, left in pairs]

    def least(self, actuator: ParameterSet) -> float:
        """Energy that noise and the errors of the equation leave."""
        return sum((one.least(actuator) * one.size / self._size) ** 2 for one in self.each)

    def alike(self, actuator: ParameterSet) -> float:
        """Energy that the equation's own error leaves, alike throughout."""
        return sum((one.alike(actuator) * one.size / self._size) ** 2 for one in self.each)

    def _left(self, actuator: ParameterSet) -> np.ndarray:
        """(K,) of all recordings."""
        each = zip(self.each, self.first_samples, strict=True)
        lefts = [one.left(actuator, {FIRST_SAMPLE: first}) for one, first in each]
        return np.concatenate([self._share(n, left) for n, left in enumerate(lefts)])

    def _share(self, n: int, left: np.ndarray) -> np.ndarray:
        """Residuals of a recording as shares of all that is to be explained, whitened."""
        parts, shares = self._beside[n]
        return np.asarray(left - (shares * (parts @ left)) @ parts) / self._size

    def _left_each(
        self, actuator: ParameterSet, tries: Sequence[Values], only: int | None = None
    ) -> list[np.ndarray | None]:
        """(K,) with each of some values by place; None of those with which it would be unstable."""
        some = [one for one in enumerate(self.each) if only in (None, one[0])]

        def of(block: Sequence[Values]) -> list[np.ndarray | None]:
            tried, shares = [candidate(actuator, values) for values in block], []
            for n, one in some:
                first = {FIRST_SAMPLE: self.first_samples[n]}
                lefts = lefts_of(one, [x and (x[0], {**first, **x[1]}) for x in tried])
                shares.append([None if left is None else self._share(n, left) for left in lefts])
            return [None if x[0] is None else np.concatenate(x) for x in zip(*shares, strict=True)]

        return in_blocks(of, tries, LANES if all(one.each for _, one in some) else 1)

    def ranked(
        self, fit: EquationFit, starts: Sequence[tuple[Values, bool]], only: int | None = None
    ) -> list[Values]:
        """Values in the order of what they leave after a fit of all else, without unstable ones.

        ``starts`` also say whether the change that values make may be of any size.
        """
        part = fit if only is None else fit.at(self.parts[only])
        lefts = self._left_each(fit.actuator, [values for values, _ in starts], only)
        pairs = zip(lefts, starts, strict=True)
        costs = np.array([np.inf if x is None else part.projected(x, y[1]) for x, y in pairs])
        return [starts[n][0] for n in np.argsort(costs, kind="stable") if np.isfinite(costs[n])]

    def fitted(
        self, actuator: ParameterSet, places: Sequence[str], like: EquationFit | None = None
    ) -> EquationFit:
        """Some parameters by Gauss-Newton steps, each held by its tolerance in the template.

        Slopes follow the residuals (`with_secant`). A fit begins with the slopes of one nearby
        (``like``), and ends with fresh ones. Equations that the reference corrects are corrected at
        its end, and fitted again, until that gains no more.
        """
        fit = self._minimum(actuator, places, like)
        for _ in range(5):  # by the reference, at most
            if all(one.near is None for one in self.each):
                break
            other = copy.copy(self)
            other.each = [one.near(fit.actuator) if one.near else one for one in self.each]
            left = other._left(fit.actuator)
            fit = other._minimum(fit.actuator, places, fit)
            if fit.cost > (1.0 - _ENDS) * float(left @ left):
                break
        return fit

    def _minimum(
        self, actuator: ParameterSet, places: Sequence[str], like: EquationFit | None
    ) -> EquationFit:
        here = self._linearised(actuator, places, self._left(actuator), like)
        fresh = like is None
        for _ in range(20):  # at most
            before, after = here, self._stepped(here)
            ends = after is None or after.cost > (1.0 - _ENDS) * before.cost
            here = after or before
            if ends and fresh:  # slopes of so short a step would be those of ripple
                return self._fit(here.actuator, places, here.left, before.slopes)
            if ends:
                here = self._linearised(here.actuator, places, here.left)
            fresh = ends
        return self._linearised(here.actuator, places, here.left)

    def _stepped(self, here: EquationFit) -> EquationFit | None:
        """The fit after a step that lowers its cost, with slopes that agree; None without one."""
        for fraction in (1.0, 0.4, 0.1):
            step = np.clip(fraction * here.step, -_LONGEST, _LONGEST)
            try:
                steps = dict(zip(here.places, step.tolist(), strict=True))
                tried = with_values(here.actuator, _moved(here.actuator, steps))
            except EmatwinError:
                continue
            left = self._left(tried)
            if left @ left < here.cost:
                slopes = with_secant(here.slopes, step, left - here.left)
                return self._fit(tried, here.places, left, slopes)
        return None

    def _linearised(
        self,
        actuator: ParameterSet,
        places: Sequence[str],
        here: np.ndarray,
        like: EquationFit | None = None,
    ) -> EquationFit:
        """The fit at an actuator with residuals ``here``; slopes that ``like`` has are taken."""
        known = {} if like is None else dict(zip(like.places, like.slopes, strict=True))
        slopes = np.array([known.get(place, np.zeros_like(here)) for place in places])
        new = [n for n, place in enumerate(places) if place not in known]
        for step in (_STEP, -_STEP):  # at a border of stability, or of what a file may hold
            lefts = self._left_each(actuator, [_moved(actuator, {places[n]: step}) for n in new])
            for n, left in zip(new, lefts, strict=True):
                if left is not None:
                    slopes[n] = (left - here) / step
            new = [n for n, left in zip(new, lefts, strict=True) if left is None]
        return self._fit(actuator, places, here, slopes)

    def _fit(
        self, actuator: ParameterSet, places: Sequence[str], left: np.ndarray, slopes: np.ndarray
    ) -> EquationFit:
        """A fit with the prior that the template and other equations give."""
        each = [left[part] for part in self.parts]
        weight = float(left @ left) / sum(r.size / correlation_time(r) for r in each)
        away, precision = np.zeros(len(places)), np.eye(len(places)) / WIDE**2
        for n, place in enumerate(places):
            if place in self._stated:
                value, spread = self._stated[place]
                away[n], precision[n, n] = math.log(actuator.value(place) / value), spread**-2
        if self._known is not None:
            known = self._known.of(places)
            own = [places.index(place) for place in known.names]
            here = [coordinate(actuator, one, actuator.value(one)) for one in known.names]
            away[own] = here - known.mean
            precision[np.ix_(own, own)] = np.linalg.inv(known.covariance)
        prior = weight * precision
        return EquationFit(self, actuator, tuple(places), left, slopes, prior @ away, prior, weight)

    def with_first_samples(self, fit: EquationFit, actuator: ParameterSet) -> EquationFit:
        """The fit with the first samples that suit an actuator."""
        other = copy.copy(self)

        def found(n: int) -> float:
            part, instants = fit.at(self.parts[n]), self.each[n].first_samples(actuator)

            def costs(some: Sequence[float]) -> list[float]:
                lefts = self._left_each(actuator, [{FIRST_SAMPLE: one} for one in some], n)
                return [part.projected(x, scaled=False) for x in lefts if x is not None]

            return found_first_sample(costs, instants) if instants else self.first_samples[n]

        other.first_samples = [found(n) for n in range(len(self.each))]
        return other.fitted(actuator, fit.places, fit)


def found_first_sample(
    costs: Callable[[Sequence[float]], Sequence[float]], instants: Sequence[Sequence[float]]
) -> float:
    """The instant at which the sampled loops of a drive sampled first in a recording.

    A voltage between two samples stays as it is, so the current after a commutation depends on how
    long before it the loop had sampled. The share of commutations on the wrong side of a sample,
    and the cost, grow with the error of the instant, to both sides. The cost hardly depends on
    which sample of the current is the first of the speed as well. So the first row is compared,
    then the best column, then nearer instants, with steps that are halved. Rows are the same
    instants (s) in one sample time after the other, evenly spaced.
    """

    def best_of(some: Sequence[float]) -> tuple[float, float]:
        return min(zip(costs(some), some, strict=True))

    _, share = best_of(instants[0])
    column = instants[0].index(share)
    least, best = best_of([row[column] for row in instants])
    step = instants[0][1] - instants[0][0]
    for _ in range(3):  # to a 64th of a sample time
        step *= 0.5
        least, best = min((least, best), best_of([best - step, best + step]))
    return best


def _changed_by(
    beside: Sequence[Unknown], equation: Equation, left: np.ndarray, actuator: ParameterSet
) -> tuple[np.ndarray, np.ndarray]:
    """What load, sensors and timing of a recording may change in an equation, by their priors.

    Directions (m, K) of length one, and the shares (m,) of residuals along them that whitening
    takes off.
    """
    slopes = equation.changes(actuator)
    changes = [
        one.spread * slopes[one.name]
        for one in beside
        if one.name in slopes and one.spread is not None
    ]
    _, sizes, parts = np.linalg.svd(
        np.reshape(changes, (len(changes), left.size)), full_matrices=False
    )
    noise = equation.least(actuator) * equation.size / math.sqrt(left.size / correlation_time(left))
    return parts, 1.0 - 1.0 / np.sqrt(1.0 + (sizes / noise) ** 2)


def stated_values(template: ParameterSet) -> dict[str, tuple[float, float]]:
    """Values of a file that are positive, and the spreads of their logarithms, by place."""
    stated = ((place, x, template.tolerance(place)) for place, x, *_ in template.parameters())
    return {
        place: (value, math.log1p(tolerance) / TWO_SIGMA)
        for place, value, tolerance in stated
        if value > 0.0 and tolerance is not None
    }


def coordinate(actuator: ParameterSet, place: str, value: float) -> float:
    """The logarithm of what has a sign; else the value."""
    return math.log(value) if has_sign(actuator, place) else value


def has_sign(actuator: ParameterSet, place: str) -> bool:
    """Whether a parameter has one sign: its logarithm is fitted."""
    return actuator.limits(place)[0] >= 0.0


def _moved(actuator: ParameterSet, steps: Values) -> Values:
    """Values of parameters moved by steps, of logarithms where they have a sign."""
    return {
        place: actuator.value(place) * math.exp(step) if has_sign(actuator, place)
        else actuator.value(place) + step
        for place, step in steps.items()
    }  # fmt: skip
