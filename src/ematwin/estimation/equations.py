"""The least squares of one equation along the recorded motion, for all recordings."""

import copy
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.constants import TWO_SIGMA
from ematwin.estimation.equation_fit import EquationFit, energy, with_secant
from ematwin.estimation.first_sample import found_first_sample
from ematwin.estimation.prior import Prior
from ematwin.models.comparison import correlation_time
from ematwin.models.optional import FIRST_SAMPLE, Equation, Values
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

WIDE = 3.0  # standard deviation of the logarithm of what no file states
_ROUNDS = 20  # of a fit, at most
_CORRECTIONS = 5  # by the reference, at most
_ENDS = 0.05  # relative fall of the cost at which a fit ends
_STEP = 0.01  # of a logarithm, or of a radian, that is differenced
_FRACTIONS = (1.0, 0.4, 0.1)  # of a step that are tried
_LONGEST = 2.0  # of a step, in logarithms

Try = tuple[Callable[[], ParameterSet], Values]  # makes an actuator, with values of a recording


class Scatter(NamedTuple):
    """Covariance of residuals of one recording beside their noise, such as what answers scatter.

    Attributes
    ----------
    sizes : (m,) array, standard deviations along its principal parts, in those of the noise
    parts : (m, K) array, of length one
    """

    sizes: np.ndarray
    parts: np.ndarray

    @classmethod
    def of(cls, rest: np.ndarray, noise: float) -> "Scatter":
        """The sum over what each of some independent causes changes, (n, K).

        ``noise`` is the standard deviation of an independent residual.
        """
        _, sizes, parts = np.linalg.svd(rest, full_matrices=False)
        return cls(sizes / noise, parts)

    def whitened(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (B, K) as if they held noise alone."""
        less = 1.0 - 1.0 / np.sqrt(1.0 + self.sizes**2)
        return np.asarray(residuals - (residuals @ self.parts.T * less) @ self.parts)


class Equations:
    """One equation of several recordings, and its least squares.

    Parameters
    ----------
    template : whose tolerances hold the parameters
    equations : one for each recording
    known : what other equations tell of the parameters, in place of the tolerances
    beside : load, sensors and timing, which differ from recording to recording: the changes they
        may make (`Equation.changes`) count as noise, with their covariance

    Attributes
    ----------
    first_samples : when the loops sampled first in each recording, s
    """

    def __init__(
        self,
        template: ParameterSet,
        equations: Sequence[Equation],
        known: Prior | None = None,
        beside: Sequence[Unknown] = (),
    ) -> None:
        self.each, self._stated, self._known = equations, stated_values(template), known
        self.first_samples = [0.0] * len(equations)
        self._size = math.sqrt(sum(one.size**2 for one in equations))
        self._beside = [_changed_by(beside, one, template) for one in equations]

    def alike(self, actuator: ParameterSet) -> float:
        """Energy that the equation's own error leaves, alike throughout."""
        return sum((one.alike(actuator) * one.size / self._size) ** 2 for one in self.each)

    def _left(self, actuator: ParameterSet) -> list[np.ndarray]:
        return [self._left_of(n, actuator, {}) for n in range(len(self.each))]

    def _left_each(
        self, tries: Sequence[Try], some: Sequence[int]
    ) -> list[list[np.ndarray] | None]:
        """What each actuator leaves of some recordings; None of one that would be unstable."""
        each = [one for n in some if (one := self.each[n].each) is not None]
        together = len(each) == len(some)

        def of(one: Try) -> Any:
            make, values = one
            try:
                actuator = make()
                return actuator if together else [self._left_of(n, actuator, values) for n in some]
            except EmatwinError:
                return None

        found = side_by_side(of, tries)
        stable = [one for one in found if one is not None]
        if not (together and stable):
            return found
        both = zip(some, each, strict=True)
        lefts = [[self._share(n, left) for left in one(stable)] for n, one in both]
        rest = zip(*lefts, strict=True)
        return [None if one is None else list(next(rest)) for one in found]

    def _left_of(self, n: int, actuator: ParameterSet, values: Values) -> np.ndarray:
        """What an actuator leaves of a recording, as a share of all that is to be explained."""
        given = {FIRST_SAMPLE: values.get(FIRST_SAMPLE, self.first_samples[n])}
        return self._share(n, self.each[n].left(actuator, given))

    def _share(self, n: int, left: np.ndarray) -> np.ndarray:
        beside = self._beside[n]
        return (left if beside is None else beside.whitened(left[None])[0]) / self._size

    def least(self, actuator: ParameterSet) -> float:
        """Energy that noise and the errors of the equation leave."""
        return sum((one.least(actuator) * one.size / self._size) ** 2 for one in self.each)

    def ranked(
        self, fit: EquationFit, starts: Sequence[tuple[Values, bool]], only: int | None = None
    ) -> list[Values]:
        """Values in the order of what they leave after a fit of all else, without unstable ones.

        Parameters
        ----------
        starts : values, and whether the change that they make may be of any size
        only : the recording that is looked at; all if not given
        """
        some = range(len(self.each)) if only is None else [only]
        part = fit if only is None else fit.of(only)

        tries = [(partial(with_values, fit.actuator, values), values) for values, _ in starts]
        lefts = self._left_each(tries, some)
        pairs = zip(lefts, starts, strict=True)
        costs = np.array([np.inf if x is None else part.projected(x, y[1]) for x, y in pairs])
        return [starts[n][0] for n in np.argsort(costs, kind="stable") if np.isfinite(costs[n])]

    def near(self, actuator: ParameterSet) -> "Equations":
        """The same, corrected by the reference at an actuator; itself where none is."""
        if all(one.near is None for one in self.each):
            return self
        other = copy.copy(self)
        other.each = [one if one.near is None else one.near(actuator) for one in self.each]
        return other

    def fitted(
        self, actuator: ParameterSet, places: Sequence[str], like: EquationFit | None = None
    ) -> EquationFit:
        """Some parameters by Gauss-Newton steps, each held by its tolerance in the template.

        Slopes follow the residuals (`with_secant`). A fit begins with the slopes of one nearby
        (``like``), and ends with fresh ones. Equations that the reference corrects are corrected at
        its end, and fitted again, until that gains no more.
        """
        fit = self._minimum(actuator, places, like)
        for _ in range(_CORRECTIONS):
            other = self.near(fit.actuator)
            if other is self:
                break
            before, fit = (
                energy(other._left(fit.actuator)),
                other._minimum(fit.actuator, places, fit),
            )
            if fit.cost > (1.0 - _ENDS) * before:
                break
        return fit

    def _minimum(
        self, actuator: ParameterSet, places: Sequence[str], like: EquationFit | None
    ) -> EquationFit:
        here = self._linearised(actuator, places, self._left(actuator), like)
        fresh = like is None
        for _ in range(_ROUNDS):
            before, after = here, self._stepped(here)
            ends = after is None or after.cost > (1.0 - _ENDS) * before.cost
            here = after or before
            if ends and fresh:  # slopes of so short a step would be those of ripple
                return self._fit(here.actuator, places, here.left, before.slopes)
            if ends:
                here = self._linearised(here.actuator, places, here.left)
            fresh = ends
        return here

    def _stepped(self, here: EquationFit) -> EquationFit | None:
        """The fit after a step that lowers its cost, with slopes that agree; None without one."""
        for fraction in _FRACTIONS:
            step = np.clip(fraction * here.step, -_LONGEST, _LONGEST)
            try:
                tried = _moved(here.actuator, here.places, step)
            except EmatwinError:
                continue
            left = self._left(tried)
            if energy(left) < here.cost:
                slopes = [
                    with_secant(one, step, there - r)
                    for one, r, there in zip(here.slopes, here.left, left, strict=True)
                ]
                return self._fit(tried, here.places, left, slopes)
        return None

    def _linearised(
        self,
        actuator: ParameterSet,
        places: Sequence[str],
        here: list[np.ndarray],
        like: EquationFit | None = None,
    ) -> EquationFit:
        """The fit at an actuator with residuals ``here``; slopes that ``like`` has are taken."""
        known = {} if like is None else {place: n for n, place in enumerate(like.places)}
        columns = [
            [one[known[place]] for one in like.slopes] if like is not None and place in known
            else [np.zeros_like(r) for r in here]
            for place in places
        ]  # fmt: skip
        new, eye = [n for n, place in enumerate(places) if place not in known], np.eye(len(places))
        for step in (_STEP, -_STEP):  # at a border of stability, or of what a file may hold
            tries: list[Try] = [(partial(_moved, actuator, places, step * eye[n]), {}) for n in new]
            lefts = self._left_each(tries, range(len(here)))
            for n, left in zip(new, lefts, strict=True):
                if left is not None:
                    columns[n] = [(there - r) / step for there, r in zip(left, here, strict=True)]
            new = [n for n, left in zip(new, lefts, strict=True) if left is None]
        slopes = [np.array([column[n] for column in columns]) for n in range(len(here))]
        return self._fit(actuator, places, here, slopes)

    def _fit(
        self,
        actuator: ParameterSet,
        places: Sequence[str],
        left: list[np.ndarray],
        slopes: list[np.ndarray],
    ) -> EquationFit:
        """A fit with the prior that the template and other equations give."""
        weight = energy(left) / sum(r.size / correlation_time(r) for r in left)
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
            part, instants = fit.of(n), self.each[n].first_samples(actuator)

            def cost(instant: float) -> float:
                left = self._left_of(n, actuator, {FIRST_SAMPLE: instant})
                return part.projected([left], scaled=False)

            return found_first_sample(cost, instants) if instants else self.first_samples[n]

        other.first_samples = [found(n) for n in range(len(self.each))]
        return other.fitted(actuator, fit.places, fit)


def _changed_by(
    beside: Sequence[Unknown], equation: Equation, actuator: ParameterSet
) -> Scatter | None:
    """What load, sensors and timing of a recording may change in an equation, by their priors.

    None where they change nothing that may pass for a form.
    """
    slopes = equation.changes(actuator)
    changes = [
        one.spread * slopes[one.name]
        for one in beside
        if one.name in slopes and one.spread is not None
    ]
    if not changes:
        return None
    left, noise = equation.left(actuator, {}), equation.least(actuator) * equation.size
    independent = math.sqrt(left.size / correlation_time(left))
    return Scatter.of(np.array(changes), noise / independent)


def with_values(actuator: ParameterSet, values: Values) -> ParameterSet:
    """The actuator with values by place; others are of a recording."""
    return actuator.changed({name: value for name, value in values.items() if "." in name})


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


def _moved(actuator: ParameterSet, places: Sequence[str], step: np.ndarray) -> ParameterSet:
    """The actuator with parameters moved by steps (d,), of logarithms where they have a sign."""
    values = {}
    for place, one in zip(places, step.tolist(), strict=True):
        value = actuator.value(place)
        values[place] = value * math.exp(one) if has_sign(actuator, place) else value + one
    return actuator.changed(values)
