"""Learn uncertain parameters of an actuator from healthy recordings.

All parameters that a data sheet leaves uncertain are searched together, from all over the range
that their tolerances allow: descents from the template reach wrong local minima whose misfit looks
fine. Searches are repeated until two end equally deep. Then all recordings are fitted together,
with sensors and load per recording, and the curvature there shows which parameters are determined.

Values that no recording determines stay near the template, within the width of its tolerance. Of
some parameters only ratios or products come out; that is enough for faults, which are judged
against healthy, and is said where physical values are shown.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.errors import ParameterError, RecordError
from ematwin.estimation.baseline import (
    Baseline,
    NominalParameter,
    frees_parameters,
    nominal_parameters,
    uncertain,
)
from ematwin.estimation.closed_loop import closed_loop
from ematwin.estimation.constants import EXPLAINED, IMPLAUSIBLE, SEARCHED, TWO_SIGMA, WORSE, WORST
from ematwin.estimation.correction import Corrected
from ematwin.estimation.forms import CHOSEN, SURE, FoundForms, find_forms
from ematwin.estimation.healthy_fit import (
    HealthyFit,
    Progress,
    expected_misfit,
    healthy_bias,
    lacking_load,
    refuse_odd,
)
from ematwin.estimation.likely_forms import with_likely_form
from ematwin.estimation.prior import Prior, coordinate
from ematwin.estimation.problem import Problem
from ematwin.estimation.random_effects import learn_effects
from ematwin.estimation.verdict import most_of_healthy
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.showing.text import said

_WRONG = math.log(3.0) / SEARCHED  # width of what a sheet may have wrong: to three times


@dataclass(frozen=True)
class Learnt:
    """An actuator as healthy recordings show it."""

    actuator: ParameterSet  # template with the values that were found
    baseline: Baseline  # knowledge of it after calibration
    parameters: list[NominalParameter]  # fitted ones
    tied: list[tuple[str, ...]]  # places whose ratios or products alone are known
    notes: list[str]  # sentences on doubts
    forms: FoundForms | None = None  # that were looked for; None of kinds without
    # values of load and sensors by name, of each recording; empty of kinds without
    nuisances: Sequence[Mapping[str, float]] = ()


def learn(
    model: Model,
    template: ParameterSet,
    comparisons: Sequence[Comparison],
    progress: Progress = lambda share: None,
) -> Learnt:
    """Fit an actuator to healthy recordings, or means of several, from a template.

    `RecordError` if one recording is unlike the others, or they contradict the template.
    """
    if model.recordings_differ:
        return Learnt(*learn_effects(model, template, comparisons, progress), [], [])
    if not uncertain(model, template):
        baseline = Baseline.of_template(model, template)
        return Learnt(template, replace(baseline, recordings=len(comparisons)), [], [], [])
    forms = find_forms(model, template, comparisons, lambda share: progress(0.15 * share))
    forms = with_likely_form(model, template, [one.recording for one in comparisons], forms)
    progress(0.2)
    if not (forms.found or any(forms.first_samples.values())):
        return _learnt(model, template, comparisons, forms, progress)
    recordings = [one.recording for one in comparisons]
    for n, instant in forms.first_samples.items():
        recordings[n] = recordings[n].with_first_sample(instant)
    try:
        beside = [model.compare(one, forms.actuator) for one in recordings]
        return _learnt(model, template, beside, forms, progress)
    except (ParameterError, RecordError) as refusal:  # a loop is unstable, or they do not fit
        if not forms.found:
            raise
        try:
            return _learnt(model, template, comparisons, FoundForms(template), progress)
        except RecordError:
            raise refusal from None


def _learnt(
    model: Model,
    template: ParameterSet,
    comparisons: Sequence[Comparison],
    forms: FoundForms,
    progress: Progress,
) -> Learnt:
    """Fit an actuator with some forms to healthy recordings, which are compared with these."""
    nominals = uncertain(model, forms.actuator)
    floor = expected_misfit(comparisons, model.command)
    fit = HealthyFit(model, forms.actuator, nominals, floor, forms.values)
    found = fit.run(comparisons, lambda share: progress(0.2 + 0.5 * share))
    # as it is, the twin would judge nothing: what a tolerance holds back may be what is wrong
    sigmas = TWO_SIGMA if found.misfit > WORST else IMPLAUSIBLE
    while pulled := _beyond_tolerance(found.values, fit.nominals, template, sigmas):
        # the sheet may be of another motor: anew without its word on what contradicts it most
        most = next(iter(pulled))
        wide = [replace(o, spread=_WRONG) if o.name == most else o for o in fit.nominals]
        if wide == fit.nominals:
            break
        other = replace(fit, nominals=wide)
        again = other.run(comparisons, lambda share: progress(0.7 + 0.1 * share))
        if again.misfit >= found.misfit and not again.explains(floor):
            break
        fit, found = other, again
    beyond = _beyond_tolerance(found.values, nominals, template)
    end, misfit, alone, jitter = found
    explained = found.explains(floor) or found.explains_along_motion
    unlike = misfit > max(3.0 * alone, EXPLAINED) and not explained  # than of one alone
    if unlike and len(comparisons) > 1:
        refuse_odd(fit, comparisons, misfit)
    progress(0.8)
    places = [one.name for one in nominals]
    floor = float(np.hypot(floor, jitter))
    if beyond and not explained:
        raise RecordError(
            f"{next(iter(beyond.values()))} Even so the twin leaves {100.0 * misfit:.1f} % of the "
            f"recordings unexplained, where noise would leave {100.0 * floor:.1f} %. They are of "
            "another actuator or a worn one, which identify judges by the template, or the "
            "template lacks something that this actuator has, such as its loops."
            + lacking_load(model, comparisons)
        )
    values = found.values
    actuator = forms.actuator.changed({place: values[place] for place in places})
    prior = _prior(end, places, forms.chosen)
    baseline = Baseline(
        prior=prior,
        misfit=misfit,
        expected_misfit=floor,
        recordings=len(comparisons),
        has_load=model.load is None or all(model.load in c.recording.channels for c in comparisons),
        forms=forms.said,
        absent_forms=forms.absent,
    )
    own = {name: name.partition("@") for name in values if name not in places}
    beside = [
        {name: values[full] for full, (name, _, of) in own.items() if of in ("", str(n))}
        for n in range(len(comparisons))
    ]
    if frees_parameters(model):  # else the healthy population tells
        scatter = healthy_bias(model, actuator, baseline, comparisons, beside)
        left = _most_left(comparisons, {place: values[place] for place in places}, beside)
        baseline = replace(baseline, scatter=scatter, left=left)
    if told := end.peak.problem.is_told:
        progress(0.85)
        loop = closed_loop(model, actuator, baseline, comparisons[0])
        baseline = replace(baseline, closed_loop=loop)
        misfit = misfit if loop is None else loop.misfit
    progress(1.0)
    advice = (
        "Check the sheet and what is built in. If this actuator may be worn, do not learn from "
        "it: identify judges it by the template."
    )
    return Learnt(
        actuator, baseline,
        nominal_parameters(forms.actuator, fit.nominals, prior),
        _tied(prior),
        [
            *(f"{sentence} {advice}" for sentence in beyond.values()),
            *_notes(misfit, floor, told, end.peak.problem),
        ],
        forms,
        beside,
    )  # fmt: skip


def _prior(end: Corrected, places: Sequence[str], chosen: Sequence[str]) -> Prior:
    """The distribution of the parameters afterwards, as `Prior` counts them.

    ``chosen`` is as of `FoundForms`.

    The curvature takes the residual for noise. The error of the twin biases all samples alike,
    so the data of a twin without a reference count less (`Problem.model_error`).
    """
    peak, problem = end.peak, end.peak.problem
    own = [problem.names.index(place) for place in places]
    widths = problem.chart.widths[own]
    covariance = end.covariance[np.ix_(own, own)]
    if problem.is_informed:
        least = [CHOSEN if place in chosen else SURE for place in places]
        covariance = covariance + np.diag(np.array(least) / widths) ** 2
    found = [coordinate(problem.unknowns[n], peak.point[n]) for n in own]
    return Prior(tuple(places), np.array(found), covariance * np.outer(widths, widths))


def _beyond_tolerance(
    values: Mapping[str, float],
    nominals: Sequence[Unknown],
    template: ParameterSet,
    sigmas: float = IMPLAUSIBLE,
) -> dict[str, str]:
    """Sentences by place on parameters further than ``sigmas`` off, the furthest first."""
    told = []
    for one in nominals:
        # of a form that was found, or without a tolerance
        if template.parameter(one.name) is None or not one.logarithmic:
            continue
        assert one.spread is not None
        value = values[one.name]
        away = abs(math.log(value / one.healthy)) / one.spread
        if away > sigmas:
            told.append((
                away, one.name,
                f"The recordings put {one.name} at {said(value, one.unit)}, "
                f"{value / one.healthy:.2g} times the {said(one.healthy, one.unit)} of the "
                f"template, whose tolerance is {100.0 * math.expm1(2 * one.spread):.0f} %.",
            ))  # fmt: skip
    return {name: text for _, name, text in sorted(told, reverse=True)}


def _tied(prior: Prior) -> list[tuple[str, ...]]:
    """Groups of parameters that move together."""
    errors = np.sqrt(np.diag(prior.covariance))
    together = np.abs(prior.covariance / np.outer(errors, errors)) > 0.9
    linked = np.linalg.matrix_power(together, len(errors))  # over others as well
    groups = [tuple(np.array(prior.names)[row].tolist()) for row in linked]
    return [one for one in dict.fromkeys(groups) if len(one) > 1]


def _most_left(
    comparisons: Sequence[Comparison],
    values: Mapping[str, float],
    beside: Sequence[Mapping[str, float]],
) -> dict[str, float]:
    """By channel, the most that a recording leaves, as of `Baseline.left`."""
    most: dict[str, float] = {}
    for compared, own in zip(comparisons, beside, strict=True):
        for name, one in compared.left({**values, **own}).items():
            most[name] = max(one.times, most.get(name, 0.0))
    return most


def _notes(misfit: float, floor: float, told: bool, problem: Problem) -> list[str]:
    """Sentences on what healthy recordings leave; ``told`` as `Problem.is_told`."""
    left = f"The twin leaves {100.0 * misfit:.1f} % of the healthy recordings unexplained"
    judges, most = f"judges none where it leaves more than {100.0 * WORST:.0f} %", WORST
    if problem.comparisons[0].has_reference:
        judges, most = "judges no recording", most_of_healthy(floor, problem.lacks_forms)
    if misfit > most:
        return [
            f"{left} once its loops are closed, as near instability. Recordings are judged by the "
            f"equations along their motion, and loops may leave {WORSE:g} times as much."
            if told
            else f"{left}, and {judges}: this actuator has something that the twin has "
            "not, such as loops near instability. Record the load and all currents and positions, "
            "by which calibrate finds more."
        ]
    if misfit < WORSE * floor:
        return []
    return [
        f"{left}, where noise and its known errors would leave {100.0 * floor:.1f} %: this "
        "actuator has something that the twin has not. Intervals are wider for it."
    ]
