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

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.constants import DECIDES, TWO_SIGMA
from ematwin.estimation.equation_fit import EquationFit, energy, with_secant
from ematwin.estimation.first_sample import found_first_sample
from ematwin.estimation.prior import Prior
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison, correlation_time
from ematwin.models.optional import FIRST_SAMPLE, Choices, Equation, Form, Values
from ematwin.models.parameter_set import ParameterSet
from ematwin.numerics.side_by_side import side_by_side

_ROUNDS = 20  # of a fit, at most
_ENDS = 0.05  # relative fall of the cost at which a fit ends
_MATTERS = 0.1  # share of what is left that a form has to explain
_STEP = 0.01  # of a logarithm, or of a radian, that is differenced
_FRACTIONS = (1.0, 0.4, 0.1)  # of a step that are tried
_BEAM = 3  # choices of one form that are tried with those of the next
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
    first_samples : of the recordings of which it was found, by number, s
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
    first_samples: Mapping[int, float] = field(default_factory=dict)

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
    by_name: dict[str, dict[int, Equation]] = {}
    for n, one in enumerate(comparisons):
        for equation in model.equations(one.recording, template):
            if equation.size > 0.0:
                by_name.setdefault(equation.name, {})[n] = equation
    result, fits, first_samples = FoundForms(template), [], dict[int, float]()
    for n, some in enumerate(by_name.values()):
        selection = _Selection(result, list(some.values()))
        result, fit = selection.run()
        fits.append(fit)
        if any(selection.first_samples):
            first_samples |= zip(some, selection.first_samples, strict=True)
        progress((n + 1) / len(by_name))
    every = [form for some in by_name.values() for form in next(iter(some.values())).forms]
    has_forms = result.found or any(form.is_stated(template) for form in every)
    prior = _together(template, fits) if has_forms else None
    return replace(result, prior=prior, first_samples=first_samples)


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
        self.first_samples = [0.0] * len(equations)
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
        for choices in first.together if found else ():
            if fit.cost <= self._least(fit.actuator):
                break
            together, first_samples = self._together(fit, choices)
            if together.cost < fit.cost - DECIDES * fit.weight:
                new = [form for form in absent if form.is_stated(together.actuator)]
                share = (fit.cost - together.cost) / plain.cost
                gains += [Explained(first.name, len(new), share)] if new else []
                absent = [form for form in absent if form not in new]
                found, self.first_samples = [*found, *new], first_samples
                fit = self._chosen(together, found)
        if first.first_samples(fit.actuator) and not any(self.first_samples):
            other, first_samples = self._with_first_samples(fit, fit.actuator)
            if other.cost < fit.cost - DECIDES * fit.weight:
                fit, self.first_samples = other, first_samples
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
        ranked = self._ranked(fit, starts)
        if not ranked:
            return fit, []
        best = _set(fit.actuator, ranked[0])
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
            starts = [(one, False) for one in form.alternatives(fit.actuator)]
            for values in self._ranked(fit, starts)[:1]:
                other = self._fitted(_set(fit.actuator, values), fit.places, fit)
                fit = min(fit, other, key=lambda one: one.cost)
        return fit

    def _together(self, fit: EquationFit, choices: Choices) -> tuple[EquationFit, list[float]]:
        """The fit with what several forms hold chosen together, by beam search; first samples.

        The recording of which most is to be explained chooses.
        """
        main = int(np.argmax([one.size for one in self._equations]))
        kept: list[Values] = [{}]
        for some in choices:
            starts = [{**one, **more} for one in kept for more in some(_set(fit.actuator, one))]
            each = {tuple(sorted(one.items())): (one, False) for one in starts}
            kept = self._ranked(fit, list(each.values()), main)[:_BEAM] or kept
        ends = [self._with_first_samples(fit, _set(fit.actuator, one)) for one in kept]
        return min(ends, key=lambda end: end[0].cost)

    def _with_first_samples(
        self, fit: EquationFit, actuator: ParameterSet
    ) -> tuple[EquationFit, list[float]]:
        """The fit of an actuator with the first samples that suit it, of each recording."""
        other = copy.copy(self)

        def found(n: int) -> float:
            part, instants = fit.of(n), self._equations[n].first_samples(actuator)

            def cost(instant: float) -> float:
                left = self._left_of(n, actuator, {FIRST_SAMPLE: instant})
                return part.projected([left], scaled=False)

            return found_first_sample(cost, instants) if instants else self.first_samples[n]

        other.first_samples = [found(n) for n in range(len(self._equations))]
        return other._fitted(actuator, fit.places, fit), other.first_samples

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
        return [self._left_of(n, actuator, {}) for n in range(len(self._equations))]

    def _left_of(self, n: int, actuator: ParameterSet, values: Values) -> np.ndarray:
        """What an actuator leaves of a recording, as a share of all that is to be explained."""
        given = {FIRST_SAMPLE: values.get(FIRST_SAMPLE, self.first_samples[n])}
        return self._equations[n].left(actuator, given) / self._size

    def _least(self, actuator: ParameterSet) -> float:
        """Energy that noise and the errors of the equation leave."""
        return sum((one.least(actuator) * one.size / self._size) ** 2 for one in self._equations)

    def _ranked(
        self, fit: EquationFit, starts: Sequence[tuple[Values, bool]], only: int | None = None
    ) -> list[Values]:
        """Values by what they would leave if all else were fitted anew, without unstable ones.

        Of each it is said whether the change that they make may be of any size. ``only`` one
        recording is looked at, if it is given.
        """
        some = range(len(self._equations)) if only is None else [only]
        part = fit if only is None else fit.of(only)

        def tried(one: tuple[Values, bool]) -> float:
            values, scaled = one
            try:
                actuator = _set(fit.actuator, values)
                left = [self._left_of(n, actuator, values) for n in some]
            except EmatwinError:  # a loop that would be unstable
                return math.inf
            return part.projected(left, scaled=scaled)

        costs = np.array(side_by_side(tried, starts))
        return [starts[n][0] for n in np.argsort(costs, kind="stable") if np.isfinite(costs[n])]

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


def _set(actuator: ParameterSet, values: Values) -> ParameterSet:
    """The actuator with values by place; others are of a recording."""
    return actuator.changed({name: value for name, value in values.items() if "." in name})


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
