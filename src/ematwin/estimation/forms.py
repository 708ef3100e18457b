"""Which forms an actuator has that its parameter file leaves out, from healthy recordings.

A kind gives equations that hold along a recorded motion (`Model.equations`), and of each the forms
that may be in it. A form is added where recordings that it was not fitted to are explained better.
The form that explains most comes first (forward selection; Miller 2002, Subset Selection in
Regression, section 3.2). Cross-validation judges it (Stone 1974, J. R. Statist. Soc. B 36,
111-147): recordings in turn, or stretches of a single one, are left out of the fit by its
linearisation, and their residual has to fall by more than its scatter.

Near their least squares the equations are linear in the logarithms of their parameters, so that
all of them together give a normal distribution (`FoundForms.prior`), in which a parameter of two
equations has one value. What an equation idealises (`Equation.alike`) may resemble the effect of a
parameter throughout, and counts as one sample.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.constants import TWO_SIGMA
from ematwin.estimation.equation_fit import EquationFit, energy, with_secant
from ematwin.estimation.prior import Prior
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison, correlation_time
from ematwin.models.optional import Equation, Form, Values
from ematwin.models.parameter_set import ParameterSet
from ematwin.numerics.side_by_side import side_by_side

_ROUNDS = 20  # of a fit, at most
_ENDS = 0.05  # relative fall of the cost at which a fit ends
_MATTERS = 0.1  # share of what is left that a form has to explain
_STEP = 0.01  # of a logarithm, or of a radian, that is differenced
_FRACTIONS = (1.0, 0.4, 0.1)  # of a step that are tried
_LONGEST = 2.0  # of a step, in logarithms
_SURE = 0.004  # least standard error: simulators of other make differ by so much of a parameter
_WIDE = 3.0  # standard deviation of the logarithm of what no file states


class Explained(NamedTuple):
    """Forms of an equation that joined together, such as two loops that pass for one another.

    Attributes
    ----------
    equation : its name
    forms : how many, the next ones of `FoundForms.found`
    share : of the residual of that equation without forms, by which they lower it
    """

    equation: str
    forms: int
    share: float


@dataclass(frozen=True)
class FoundForms:
    """Forms that recordings show.

    Attributes
    ----------
    actuator : template with their sections
    found : the forms found, a phrase each
    explained : how much of the residual they explain, in their order
    absent : names of those that were tried and explain nothing
    before, after : share of the recordings' energy that the equations leave without and with them
    prior : of all that the equations hold, forms and parameters of the file, by logarithms; None of
        an actuator without any form
    """

    actuator: ParameterSet
    found: tuple[str, ...] = ()
    explained: tuple[Explained, ...] = ()
    absent: tuple[str, ...] = ()
    before: float = 0.0
    after: float = 0.0
    prior: Prior | None = None

    @property
    def said(self) -> str:
        """A sentence on the forms found; "" if there are none."""
        if not self.found:
            return ""
        listed = "; ".join(self.found)
        share = min(100.0 * (1.0 - self.after / self.before), 99.9)
        does = "Together these explain" if len(self.found) > 1 else "This explains"
        return (
            f"{listed[:1].upper()}{listed[1:]}. {does} {share:.3g} % of the residual of "
            "the current along the recorded motion."
        )


def find_forms(
    model: Model,
    template: ParameterSet,
    comparisons: Sequence[Comparison],
    progress: Callable[[float], None] = lambda share: None,
) -> FoundForms:
    """Forms that the file leaves out and that healthy recordings show, equation by equation."""
    by_name: dict[str, list[Equation]] = {}
    for one in comparisons:
        for equation in model.equations(one.recording, template):
            if equation.size > 0.0:
                by_name.setdefault(equation.name, []).append(equation)
    result, fits = FoundForms(template), []
    for n, equations in enumerate(by_name.values()):
        result, fit = _Selection(result, equations).run()
        fits.append(fit)
        progress((n + 1) / len(by_name))
    stated = (form.is_stated(template) for some in by_name.values() for form in some[0].forms)
    has_forms = result.found or any(stated)
    return replace(result, prior=_together(template, fits)) if has_forms else result


def _together(template: ParameterSet, fits: Sequence[EquationFit]) -> Prior:
    """Combine the tolerances of a template with the fits of several equations."""
    places = list(dict.fromkeys(place for fit in fits for place in fit.places))
    known = _known(template)
    spreads = np.array([known[one][1] if one in known else _WIDE for one in places])
    ends = {place: fit.actuator.value(place) for fit in fits for place in fit.places}
    centre = np.array([
        _coordinate(template, one, known[one][0] if one in known else ends[one]) for one in places
    ])  # fmt: skip
    curvature = np.diag(1.0 / spreads**2)
    gradient = np.zeros(len(places))  # at the centre
    for fit in fits:
        own = [places.index(place) for place in fit.places]
        end = [_coordinate(template, one, fit.actuator.value(one)) for one in fit.places]
        data, slope = fit.information
        curvature[np.ix_(own, own)] += data
        gradient[own] += slope + data @ (centre[own] - end)
    covariance = np.linalg.inv(curvature)
    mean = centre - covariance @ gradient
    return Prior(tuple(places), mean, covariance + _SURE**2 * np.eye(len(places)))


def _known(template: ParameterSet) -> dict[str, tuple[float, float]]:
    """Values of a file that are positive, and the spreads of their logarithms, by place."""
    stated = ((place, x, template.tolerance(place)) for place, x, *_ in template.parameters())
    return {
        place: (value, math.log1p(tolerance) / TWO_SIGMA)
        for place, value, tolerance in stated
        if value > 0.0 and tolerance is not None
    }


def _coordinate(actuator: ParameterSet, place: str, value: float) -> float:
    """The logarithm of what has a sign; else the value."""
    return math.log(value) if _has_sign(actuator, place) else value


def _has_sign(actuator: ParameterSet, place: str) -> bool:
    return actuator.limits(place)[0] >= 0.0


class _Selection:
    """Forward selection of the forms of one equation, given for each recording."""

    def __init__(self, known: FoundForms, equations: Sequence[Equation]) -> None:
        self._known, self._equations = known, equations
        self._size = math.sqrt(sum(one.size**2 for one in equations))
        self._stated = _known(known.actuator)

    def run(self) -> tuple[FoundForms, EquationFit]:
        """Add the forms of this equation; return the forms so far and its fit."""
        known, first = self._known, self._equations[0]
        stated = [form for form in first.forms if form.is_stated(known.actuator)]
        wanted = (*first.fitted, *(place for form in stated for place in form.fitted))
        places = [
            one
            for one in wanted
            if known.actuator.value(one) > 0.0 or not _has_sign(known.actuator, one)
        ]
        fit = plain = self._fitted(known.actuator, places)
        rest = [form for form in first.forms if form not in stated]
        found: list[Form] = []
        gains: list[Explained] = []
        absent: list[Form] = []
        while rest and fit.cost > self._least(fit.actuator):
            more, new = self._with_more(fit, found, rest, len(rest))
            if len(new) > 1:  # each has to explain something, and not another's part
                alone, one = self._with_more(fit, found, rest, 1)
                if one and not self._matters(more, alone):
                    more, new = alone, one
            if not new:
                break
            if self._matters(more, fit):
                share = (fit.cost - more.cost) / plain.cost
                gains.append(Explained(first.name, len(new), share))
                fit = more
                found += new
                rest, absent = [*rest, *absent], []
            else:
                absent += new
            rest = [form for form in rest if form not in new]
        if found and fit.cost > self._least(fit.actuator):
            fit = self._together(fit)
        told = self._told(plain, fit, found, absent)
        told = replace(told, explained=(*self._known.explained, *gains))
        alike = sum((one.alike(fit.actuator) * one.size) ** 2 for one in self._equations)
        return told, replace(fit, alike=alike / self._size**2)

    def _with_more(
        self, fit: EquationFit, found: Sequence[Form], rest: Sequence[Form], most: int
    ) -> tuple[EquationFit, list[Form]]:
        """The fit with the best start that adds at most so many forms, and these; or none."""
        starts = [
            (one, bool(form.fitted))
            for form in rest
            for one in form.starts(fit.actuator)
            if _count(rest, one) <= most
        ]
        best = self._best(fit, starts)
        if best is None:
            return fit, []
        new = [form for form in rest if form.is_stated(best)]
        places = (*fit.places, *(place for form in new for place in form.fitted))
        return self._chosen(self._fitted(best, places, fit), [*found, *new]), new

    def _matters(self, more: EquationFit, fit: EquationFit) -> bool:
        """Whether forms explain a share of the residual beyond noise, and held-back data better."""
        noise = min(self._least(more.actuator), more.cost)
        return more.cost - noise < (1.0 - _MATTERS) * (fit.cost - noise) and more.beats(fit)

    def _chosen(self, fit: EquationFit, forms: Sequence[Form]) -> EquationFit:
        """The fit with the alternatives chosen from lists, form by form."""
        for form in forms:
            other = self._best(fit, [(one, False) for one in form.alternatives(fit.actuator)])
            if other is not None:
                fit = min(fit, self._fitted(other, fit.places, fit), key=lambda one: one.cost)
        return fit

    def _together(self, fit: EquationFit) -> EquationFit:
        """The fit with what several forms hold chosen together."""
        fits = [fit]
        for values in self._equations[0].together(fit.actuator):
            try:
                actuator = fit.actuator.changed(dict(values))
            except EmatwinError:  # a loop that would be unstable
                continue
            fits.append(self._fitted(actuator, fit.places, fit))
        return min(fits, key=lambda one: one.cost)

    def _told(
        self, plain: EquationFit, fit: EquationFit, found: Sequence[Form], absent: Sequence[Form]
    ) -> FoundForms:
        """The result, with the sections of the forms found in the actuator."""
        known = self._known
        every = (*known.absent, *(form.name for form in absent))
        if not found:
            return replace(known, absent=every)
        sections = {place.partition(".")[0] for form in found for place in form.places}
        values = {
            place: value
            for place, value, *_ in fit.actuator.parameters()
            if place.partition(".")[0] in sections
        }
        try:
            actuator = known.actuator.changed(values)
        except EmatwinError:  # unstable with the file's gains, and not with those fitted beside
            fitted = {place: fit.actuator.value(place) for place in fit.places}
            actuator = known.actuator.changed({**values, **fitted})
        return replace(
            known,
            actuator=actuator,
            found=(*known.found, *(form.said(fit.actuator) for form in found)),
            absent=every,
            before=known.before + plain.cost,
            after=known.after + fit.cost,
        )

    def _left(self, actuator: ParameterSet) -> list[np.ndarray]:
        return [one.left(actuator, {}) / self._size for one in self._equations]

    def _least(self, actuator: ParameterSet) -> float:
        """Energy that noise and the errors of the equation leave."""
        return sum((one.least(actuator) * one.size / self._size) ** 2 for one in self._equations)

    def _best(self, fit: EquationFit, starts: Sequence[tuple[Values, bool]]) -> ParameterSet | None:
        """The actuator that would leave least if all else were fitted; None without any.

        Of each start it is said whether the change that it makes may be of any size.
        """

        def tried(one: tuple[Values, bool]) -> float:
            try:
                left = self._left(fit.actuator.changed(dict(one[0])))
            except EmatwinError:  # a loop that would be unstable
                return math.inf
            cost = fit.projected(left, scaled=one[1])
            return cost if math.isfinite(cost) else math.inf

        costs = side_by_side(tried, starts)
        if not costs or math.isinf(min(costs)):
            return None
        return fit.actuator.changed(dict(starts[int(np.argmin(costs))][0]))

    def _fitted(
        self, actuator: ParameterSet, places: Sequence[str], like: EquationFit | None = None
    ) -> EquationFit:
        """Some parameters by Gauss-Newton steps, each held by its tolerance in the template.

        Slopes follow the residuals (`with_secant`). A fit begins with the slopes of one nearby
        (``like``), and ends with fresh ones.
        """
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

        def beside(n: int) -> list[np.ndarray]:
            if like is not None and places[n] in known:
                return [one[known[places[n]]] for one in like.slopes]
            for step in (_STEP, -_STEP):
                try:
                    moved = self._left(_moved(actuator, places, step * np.eye(len(places))[n]))
                except EmatwinError:  # at the border of stability, or of what a file may hold
                    continue
                return [(there - r) / step for there, r in zip(moved, here, strict=True)]
            return [np.zeros_like(r) for r in here]

        columns = side_by_side(beside, range(len(places)))
        slopes = [np.array([column[n] for column in columns]) for n in range(len(here))]
        return self._fit(actuator, places, here, slopes)

    def _fit(
        self,
        actuator: ParameterSet,
        places: Sequence[str],
        left: list[np.ndarray],
        slopes: list[np.ndarray],
    ) -> EquationFit:
        """A fit with the prior that the template gives."""
        weight = energy(left) / sum(r.size / correlation_time(r) for r in left)
        away, spread = np.zeros(len(places)), np.full(len(places), _WIDE)
        for n, place in enumerate(places):
            if place in self._stated:
                value, spread[n] = self._stated[place]
                away[n] = math.log(actuator.value(place) / value)
        prior = weight * np.diag(1.0 / spread**2)
        return EquationFit(actuator, tuple(places), left, slopes, prior @ away, prior, weight)


def _count(forms: Sequence[Form], values: Values) -> int:
    """How many of the forms a start sets."""
    return sum(any(place in values for place in form.places) for form in forms)


def _moved(actuator: ParameterSet, places: Sequence[str], step: np.ndarray) -> ParameterSet:
    """The actuator with parameters moved by steps (d,), of logarithms where they have a sign."""
    values = {}
    for place, one in zip(places, step.tolist(), strict=True):
        value = actuator.value(place)
        values[place] = value * math.exp(one) if _has_sign(actuator, place) else value + one
    return actuator.changed(values)
