"""Which forms an actuator has that its parameter file leaves out, from healthy recordings.

A kind gives equations that hold along a recorded motion (`Model.equations`), and of each the forms
that may be in it. A form is added where recordings that it was not fitted to are explained better.
The form that explains most comes first (forward selection; Miller 2002, Subset Selection in
Regression, section 3.2). Cross-validation judges it (Stone 1974, J. R. Statist. Soc. B 36,
111-147): recordings in turn, or stretches of a single one, are left out of the fit by its
linearisation, and their residual has to fall by more than its scatter.

Near their least squares the equations are linear in the logarithms of their parameters, so that
all of them together give a normal distribution, in which a parameter of two equations has one
value; each is fitted with what those before it tell. What an equation idealises
(`Equation.alike`) may resemble the effect of a parameter throughout, and counts as one sample.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.constants import DECIDES
from ematwin.estimation.equations import (
    WIDE,
    EquationFit,
    Equations,
    coordinate,
    has_sign,
    stated_values,
)
from ematwin.estimation.prior import Prior
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.optional import Choices, Equation, Form, Values, with_values
from ematwin.models.parameter_set import ParameterSet
from ematwin.showing.text import capital

SURE = 0.004  # least standard error: simulators of other make differ by so much of a parameter
# the same of gains and filters that were fitted beside a sample time from a list: it may be another
# one, which recordings hardly tell, and they with it; tuned on drives of another simulator
CHOSEN = 0.2


class Explained(NamedTuple):
    """Forms of an equation that joined together, such as two loops that pass for one another."""

    equation: str  # its name
    forms: int  # how many, the next ones of `FoundForms.found`
    share: float  # of the residual of that equation without forms, by which they lower it


@dataclass(frozen=True)
class FoundForms:
    """Forms that recordings show."""

    actuator: ParameterSet  # template with their sections
    found: tuple[str, ...] = ()  # a phrase on each
    explained: tuple[Explained, ...] = ()  # how much of the residual they explain, in their order
    absent: tuple[str, ...] = ()  # names of those that were tried and explain nothing
    # places of what was fitted beside values from a list, such as gains beside a sample time
    chosen: tuple[str, ...] = ()
    # share of the recordings' energy that the equations leave without and with them
    before: float = 0.0
    after: float = 0.0
    # of all that the equations hold, forms and parameters of the file, by place
    values: Mapping[str, float] = field(default_factory=dict)
    # of the loops that were found, s, by number of the recording
    first_samples: Mapping[int, float] = field(default_factory=dict)

    @property
    def said(self) -> str:
        """A sentence on the forms found; "" if there are none."""
        if not self.found:
            return ""
        listed = capital("; ".join(self.found))
        if self.before == 0.0:  # only how likely the motion is shows them
            return f"{listed}."
        share = min(100.0 * (1.0 - self.after / self.before), 99.9)
        does = "Together these explain" if len(self.found) > 1 else "This explains"
        return f"{listed}. {does} {share:.3g} % of the simple twin's residual."


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
    result, fits, first_samples = FoundForms(template), list[EquationFit](), dict[int, float]()
    known: Prior | None = None
    # also those that matter to a form alone, which the file may lack
    beside = model.marginal(template)
    for n, some in enumerate(by_name.values()):
        equations = Equations(result.actuator, list(some.values()), known, beside)
        result, fit = _selected(result, equations)
        fits.append(fit)
        known = _all_fits(template, fits)
        if any(fit.equations.first_samples):
            first_samples |= zip(some, fit.equations.first_samples, strict=True)
        progress((n + 1) / len(by_name))
    if known is None:
        return result
    values = {
        place: math.exp(x) if has_sign(template, place) else float(x)
        for place, x in zip(known.names, known.mean, strict=True)
    }
    return replace(result, values=values, first_samples=first_samples)


def _all_fits(template: ParameterSet, fits: Sequence[EquationFit]) -> Prior:
    """Combine the tolerances of a template with the fits of several equations."""
    places = list(dict.fromkeys(place for fit in fits for place in fit.places))
    known = stated_values(template)
    spreads = np.array([known[one][1] if one in known else WIDE for one in places])
    ends = {place: fit.actuator.value(place) for fit in fits for place in fit.places}
    centre = np.array([
        coordinate(template, one, known[one][0] if one in known else ends[one]) for one in places
    ])  # fmt: skip
    curvature = np.diag(1.0 / spreads**2)
    gradient = np.zeros(len(places))  # at the centre
    for fit in fits:
        own = [places.index(place) for place in fit.places]
        end = [coordinate(template, one, fit.actuator.value(one)) for one in fit.places]
        data, slope = fit.information
        curvature[np.ix_(own, own)] += data
        gradient[own] += slope + data @ (centre[own] - end)
    covariance = np.linalg.inv(curvature)
    mean = centre - covariance @ gradient
    return Prior(tuple(places), mean, covariance + SURE**2 * np.eye(len(places)))


def _selected(known: FoundForms, equations: Equations) -> tuple[FoundForms, EquationFit]:
    """Forward selection of the forms of one equation: all forms so far, and its fit."""
    first = equations.each[0]
    stated = [form for form in first.forms if form.is_stated(known.actuator)]
    wanted = dict.fromkeys((*first.fitted, *(p for form in stated for p in form.fitted)))
    places = [
        one
        for one in wanted
        if known.actuator.value(one) > 0.0 or not has_sign(known.actuator, one)
    ]
    fit = plain = equations.fitted(known.actuator, places)
    rest = [form for form in first.forms if form not in stated]
    found, absent, gains = list[Form](), list[Form](), list[Explained]()

    def gained(more: EquationFit, new: Sequence[Form]) -> None:
        nonlocal fit, absent
        gains.append(Explained(first.name, len(new), (fit.cost - more.cost) / plain.cost))
        fit, absent = more, [form for form in absent if form not in new]
        found.extend(new)

    while rest:
        more, new = _with_more(fit, found, rest, len(rest))
        if len(new) > 1:  # each has to explain something, and not another's part
            alone, one = _with_more(fit, found, rest, 1)
            if one and not _matters(more, alone):
                more, new = alone, one
        if not new:
            absent += rest
            break
        matters = _matters(more, fit)
        if not matters:  # two may explain together what neither does alone
            others = [form for form in rest if form not in new]
            both, second = _with_more(more, [*found, *new], others, len(others))
            if second and _matters(both, fit) and _matters(both, more):
                more, new, matters = both, [*new, *second], True
        if found and matters:  # or is it other choices of those found before?
            fit = _chosen(fit, found)
            matters = _matters(more, fit)
        rest = [form for form in rest if form not in new]
        if matters and all(form.is_sound(more.actuator) for form in new):
            gained(more, new)
            rest, absent = [*rest, *absent], []
        else:
            absent += new
    for choices in first.together if found else ():
        together = _together(fit, choices)
        if together.cost < fit.cost - DECIDES * fit.weight:
            if new := [form for form in absent if form.is_stated(together.actuator)]:
                gained(together, new)
            fit = together
    if first.first_samples(fit.actuator) and not any(fit.equations.first_samples):
        other = fit.equations.with_first_samples(fit, fit.actuator)
        if other.cost < fit.cost - DECIDES * fit.weight:
            fit = other
    if any(fit.equations.first_samples):  # which other choices suit, now that these are known
        fit = _chosen(fit, found)
    told = replace(known, absent=(*known.absent, *(form.name for form in absent)))
    if found:
        told = replace(
            told,
            actuator=_with_sections(known.actuator, fit, found),
            found=(*known.found, *(form.said(fit.actuator) for form in found)),
            chosen=(
                *known.chosen,
                *(one for form in found if form.alternatives(fit.actuator) for one in form.fitted),
            ),
            explained=(*known.explained, *gains),
            before=known.before + plain.cost,
            after=known.after + fit.cost,
        )
    # what noise does not explain is a discrepancy, alike throughout
    beyond = max(0.0, fit.cost - _least(fit))
    return told, replace(fit, alike=fit.equations.alike(fit.actuator) + beyond)


def _with_more(
    fit: EquationFit, found: Sequence[Form], rest: Sequence[Form], most: int
) -> tuple[EquationFit, list[Form]]:
    """The fit with the best start that adds at most so many forms, and these; or none."""
    starts = [
        (one, bool(form.fitted))
        for form in rest
        for one in form.starts(fit.actuator)
        if sum(any(place in one for place in other.places) for other in rest) <= most
    ]
    ranked = fit.equations.ranked(fit, starts)
    if not ranked:
        return fit, []
    best = with_values(fit.actuator, ranked[0])
    new = [form for form in rest if form.is_stated(best)]
    places = dict.fromkeys((*fit.places, *(place for form in new for place in form.fitted)))
    return _chosen(fit.equations.fitted(best, [*places], fit), [*found, *new]), new


def _matters(more: EquationFit, fit: EquationFit) -> bool:
    """Whether forms explain a tenth of the residual beyond noise, and held-back data better.

    And more than the equation's own error, which may resemble a form.
    """
    noise = min(_least(more), more.cost)
    if more.cost - noise >= 0.9 * (fit.cost - noise) or not more.beats(fit, noise):
        return False
    own = more.equations.alike(more.actuator)
    return fit.cost - more.cost > DECIDES * (more.weight + own)


def _chosen(fit: EquationFit, forms: Sequence[Form]) -> EquationFit:
    """The fit with the alternatives chosen from lists, form by form."""
    for form in forms:
        starts = [(one, False) for one in form.alternatives(fit.actuator)]
        for values in fit.equations.ranked(fit, starts)[:1]:
            other = fit.equations.fitted(with_values(fit.actuator, values), fit.places, fit)
            fit = min(fit, other, key=lambda one: one.cost)
    return fit


def _together(fit: EquationFit, choices: Choices) -> EquationFit:
    """What several forms hold, chosen together by beam search, with the first samples.

    The recording with the largest trace chooses.
    """
    main = int(np.argmax([one.size for one in fit.equations.each]))
    kept: list[Values] = [{}]
    for some in choices:
        beside = [(one, with_values(fit.actuator, one)) for one in kept]
        starts = [{**one, **more} for one, actuator in beside for more in some(actuator)]
        each = {tuple(sorted(one.items())): (one, False) for one in starts}
        kept = fit.equations.ranked(fit, list(each.values()), main)[:3] or kept
    actuators = [with_values(fit.actuator, one) for one in kept]
    ends = [fit.equations.with_first_samples(fit, one) for one in actuators]
    return min(ends, key=lambda end: end.cost)


def _with_sections(known: ParameterSet, fit: EquationFit, found: Sequence[Form]) -> ParameterSet:
    """The actuator with the sections of the forms found, as they were fitted.

    Of a section that the file has, only what belongs to a form: the rest keeps its tolerance.
    """
    own = {place for form in found for place in (*form.places, *form.fitted)}
    sections = {place.partition(".")[0] for form in found for place in form.places}
    values = {
        place: value
        for place, value, *_ in fit.actuator.parameters()
        if place.partition(".")[0] in sections and (place in own or known.parameter(place) is None)
    }
    try:
        return known.changed(values)
    except EmatwinError:  # unstable with the file's gains, and not with those fitted beside
        fitted = {place: fit.actuator.value(place) for place in fit.places}
        return known.changed({**values, **fitted})


def _least(fit: EquationFit) -> float:
    """Energy that noise and the errors of its equations leave."""
    return fit.equations.least(fit.actuator)
