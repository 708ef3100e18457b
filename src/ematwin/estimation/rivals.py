"""Whether another form of a fault, which the parameter file leaves out, explains a recording.

A twin names the fault that comes nearest among those that it has. A kind knows forms that its file
may leave out (`Model.other_forms`). Each is descended to from where the first answer puts it, with
all free that was free there, and the heights of both peaks are compared: how far each lies from
the recording and from the priors, in squared standard deviations.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ematwin.estimation.along_motion import informed
from ematwin.estimation.assess import Assessment
from ematwin.estimation.baseline import Baseline, uncertain, with_all_free, with_nuisances
from ematwin.estimation.constants import (
    AS_GOOD,
    DECIDES,
    EXPLAINED,
    HOPELESS,
    SIGMAS,
    SMALLEST,
)
from ematwin.estimation.correction import corrected
from ematwin.estimation.descent import Descent, TooFarError
from ematwin.estimation.laplace import Laplace
from ematwin.estimation.levenberg_marquardt import NOTHING
from ematwin.estimation.minima import height, risen
from ematwin.estimation.problem import Problem
from ematwin.estimation.spike_and_slab import fault_sets
from ematwin.estimation.verdict import Verdict
from ematwin.models.base import Model, OtherForm
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side
from ematwin.showing.text import said

_FAR = 5.0  # times the misfit of the first answer: a start, or a smooth descent, not worth more
_FAR_BETTER = 0.7  # times the misfit of the first answer; 0.42 at most where the form was right


@dataclass(frozen=True)
class Rival:
    """Another form and how well it explains the recording.

    Attributes
    ----------
    form : OtherForm
    present : names of the faults that are there: with the form, and those it may be mistaken for
    said : str, the same with their values
    rise : float, how much further it is from recording and priors than the first answer, squared
        standard deviations or, if more, the scatter of the reference; negative where it is nearer
    """

    form: OtherForm
    present: tuple[str, ...]
    said: str
    rise: float


def rivals_of(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    assessed: Assessment,
    baseline: Baseline,
    verdict: Verdict,
    threads: int | None = None,
) -> list[Rival]:
    """Forms that the file leaves out and that explain the recording as well, or nearly.

    They are looked for where a fault is named that they may be mistaken for, and where there is no
    verdict and the twin leaves more than a good fit does (`EXPLAINED`), and not all of it.
    """
    if assessed.joint is None or verdict.grade not in ("fault", "none"):
        return []
    misfit = problem.relative_misfit(assessed.cost)
    if verdict.grade == "none" and not EXPLAINED < misfit <= HOPELESS:
        return []
    forms = [
        form
        for form in model.other_forms(actuator, assessed.values)
        if (verdict.grade == "none" or form.mistaken & set(verdict.faults))
        and set(form.names) <= set(problem.names)
    ]
    if not forms:
        return []

    unexplained = verdict.grade == "none"

    def compared(form: OtherForm) -> tuple[Laplace, float] | None:
        return _compared(model, actuator, form, problem, assessed, baseline, unexplained, threads)

    # each may use all cores: the other one often ends at once
    ends = side_by_side(compared, forms, threads)
    # where answers of the reference scatter, two of one form differ by so much
    peak, unit = assessed.joint.peaks[0], 1.0
    if not peak.problem.is_told:
        noise = peak.problem.comparisons[0].model_error * peak.problem.noise
        unit = max(1.0, SIGMAS * assessed.cost_scatter / noise**2 / DECIDES)
    return [
        _rival(model, form, problem, one[0], one[1] / unit)
        for form, one in zip(forms, ends, strict=True)
        if one is not None and one[1] < DECIDES * unit
    ]


def objections(rivals: Iterable[Rival], verdict: Verdict) -> list[str]:
    """Sentences that forbid the verdict: another form is nearer, and says something else."""
    return [
        f"{_told(one)} explains it better: if the actuator may have that, put "
        f"{one.form.setting} into its file."
        for one in rivals
        if one.rise < -DECIDES and verdict.grade == "fault" and not _agrees(one, verdict)
    ]


def qualified(rivals: Iterable[Rival], verdict: Verdict) -> Verdict:
    """The verdict with the other forms that explain the recording about as well in its sentence."""
    for one in rivals:
        if _is_as_near(one, verdict):
            said = (
                f"Not certain: {one.form.meaning} ({one.said}) would explain this recording about "
                "as well."
            )
            verdict = replace(
                verdict,
                reason=f"{verdict.reason} {said}".strip(),
                sentence=f"{verdict.sentence} {said}",
            )
    return verdict


def hints(rivals: Iterable[Rival], verdict: Verdict) -> list[str]:
    """Sentences on other forms that do not change the verdict."""
    found = []
    if verdict.grade == "none":  # of several the nearest
        rivals = sorted(rivals, key=lambda one: one.rise)[:1]
    for one in rivals:
        setting = f"put {one.form.setting} into the file of the actuator"
        if verdict.grade == "none":
            if one.rise < -DECIDES:
                found.append(
                    f"{_told(one)} would explain this "
                    f"recording far better: {setting} if it may have that."
                )
        elif _agrees(one, verdict):
            if one.rise < -DECIDES and set(one.form.names) & set(one.present):
                found.append(
                    f"{_told(one)} would explain this recording better; the same "
                    f"fault, of another size: {setting} if it may have that."
                )
        elif _is_as_near(one, verdict):
            found.append(f"P{setting[1:]} if it may have {one.form.meaning}.")
    return found


def _told(one: Rival) -> str:
    """The form and its values, as a sentence begins."""
    told = one.form.meaning[:1].upper() + one.form.meaning[1:]
    return f"{told} ({one.said})" if one.said else told


def _is_as_near(one: Rival, verdict: Verdict) -> bool:
    """Whether it says something else than the faults named, with no more of them, and as well.

    Any shares of turns are an offset fixed in space and some turns missing from each phase. Where
    one short explains as much as such a mixture, the short is the answer.
    """
    if verdict.grade != "fault" or not one.present or _agrees(one, verdict):
        return False
    named = one.form.mistaken & set(verdict.faults)
    return abs(one.rise) <= DECIDES and len(one.present) <= len(named)


def _agrees(one: Rival, verdict: Verdict) -> bool:
    """Whether both name the same."""
    return set(one.present) == one.form.mistaken & set(verdict.faults)


def _compared(
    model: Model,
    actuator: ParameterSet,
    form: OtherForm,
    problem: Problem,
    assessed: Assessment,
    baseline: Baseline,
    unexplained: bool,
    threads: int | None,
) -> tuple[Laplace, float] | None:
    """The other form at its best, and its rise (`Rival`).

    None where it would be far worse; and of an ``unexplained`` recording, where it is not far
    better, which is all that there is to be told.
    """
    assert assessed.joint is not None
    peak = assessed.joint.peaks[0]
    comparisons = [
        model.compare(one.recording, form.actuator, threads=threads)
        for one in peak.problem.comparisons  # with the first samples of loops that were found
    ]
    other = Problem(comparisons, problem.unknowns, held=problem.held)
    full = with_all_free(model, form.actuator, other, _with_form(baseline, model, actuator, form))
    own = peak.problem.values(peak.point)
    starts = np.stack([_start(full, problem.names, one) for one in form.starts])
    costs = full.costs(starts)
    best = int(np.argmin(costs))
    # a start that follows from the first answer is right, and others may be far from their valley
    if len(starts) > 1 and not costs[best] < _FAR**2 * peak.cost:
        return None
    start, as_found = starts[best], _start(full, full.names, {**own, **form.starts[best]})
    # equations along the motion may exclude a form, however well it fits the closed loop
    most = math.inf
    if peak.problem.is_informed and not unexplained:
        most = DECIDES + height(peak, peak.problem.comparisons[0].model_error * peak.problem.noise)
    try:
        along = informed(model, form.actuator, full, as_found, most, like=peak.problem)
    except TooFarError:
        return None
    if along:
        full, start = along
    information = _information(peak, full)
    known = {
        "within": (1.0 if unexplained else _FAR) * _smooth_misfit(peak),
        "settled": AS_GOOD * peak.problem.relative_misfit(peak.cost),
        "least": NOTHING,
    }

    def descended_from(start: np.ndarray) -> tuple[Laplace, float] | None:
        try:
            end = _descended(model, form.actuator, full, start, peak, information, **known)
        except TooFarError:
            return None
        return end, risen(peak, end)

    ends = [descended_from(start)]
    short = ends[0] is None or ends[0][1] > DECIDES
    # it may have stopped short: it gets the parameters of the first answer
    if short and not unexplained and not np.array_equal(as_found, start):
        ends.append(descended_from(as_found))
    near = [one for one in ends if one is not None]
    if not near:
        return None
    end, rise = min(near, key=lambda one: one[1])
    if unexplained and end.cost > _FAR_BETTER**2 * peak.cost:
        return None
    if rise < -DECIDES:  # so may the first answer: it gets what the other found beside the fault
        its = _own_names(problem, form)
        beside = {name: x for name, x in full.values(end.point).items() if name not in its}
        for names in (problem.names, peak.problem.names):
            point = _start(peak.problem, names, {**own, **beside})
            again = _descended(model, actuator, peak.problem, point, peak)
            rise = max(rise, risen(again, end))
            if rise >= -DECIDES:
                break
    return end, rise


def _rival(model: Model, form: OtherForm, problem: Problem, end: Laplace, rise: float) -> Rival:
    """The other form at its best point, ``end``, with its likely faults of a size that matters."""
    factor, values = end.problem.model_error, end.problem.values(end.point)
    sets = fault_sets(end.problem.chart, end.unbounded(factor), end.widened(factor)).sets
    likely = next((one.faults for one in sets if one.faults & set(form.names)), frozenset[str]())
    faults = [model.unknown(form.actuator, name) for name in _own_names(problem, form)]
    matters = {n.name for n in faults if abs(values[n.name] - n.healthy) >= SMALLEST * n.width}
    there = tuple(one.name for one in faults if one.name in likely & matters)
    said = ", ".join(
        _said(one, form.actuator, values[one.name])
        for one in faults
        if one.name in there or one.direction_of in there
    )
    return Rival(form, there, said, rise)


def _with_form(
    baseline: Baseline, model: Model, actuator: ParameterSet, form: OtherForm
) -> Baseline:
    """The baseline of the actuator, extended by the parameters that the form adds."""
    if baseline.exact:
        return baseline
    known = {one.name for one in uncertain(model, actuator)}
    more = [one for one in uncertain(model, form.actuator) if one.name not in known]
    return replace(baseline, prior=with_nuisances(baseline.prior, more))


def _start(full: Problem, names: Collection[str], values: Mapping[str, float]) -> np.ndarray:
    """(d,) where a descent sets out: ``names`` at ``values``, all else as it is known."""
    point = [
        values.get(one.name, one.healthy) if one.name in names else one.healthy
        for one in full.unknowns
    ]
    return np.clip(point, full.lower, full.upper)


def _smooth_misfit(peak: Laplace) -> float:
    """The relative misfit of a peak by the smoothed data."""
    smooth = peak.problem.smoothed()
    return smooth.relative_misfit(smooth.data_cost(smooth.residuals(peak.point[None])[0]))


def _information(peak: Laplace, full: Problem) -> np.ndarray:
    """(d, d), by which differences of another form are as long as the first answer is wide."""
    information = np.diag(np.full(len(full.names), np.diag(peak.information).max()))
    shared = [n for n, name in enumerate(full.names) if name in peak.problem.names]
    places = [peak.problem.names.index(full.names[n]) for n in shared]
    information[np.ix_(shared, shared)] = peak.information[np.ix_(places, places)]
    return information


def _descended(
    model: Model,
    actuator: ParameterSet,
    full: Problem,
    start: np.ndarray,
    first: Laplace,
    information: np.ndarray | None = None,
    **known: Any,
) -> Laplace:
    """The peak next to a start, corrected as the ``first`` one was; ``known`` is of `Descent`."""
    descent = Descent(
        partial(model.aliases, actuator),
        least_noise=full.least_noise,
        **known,
    )
    return corrected(full, start, descent, information=information, like=first.problem).peak


def _own_names(problem: Problem, form: OtherForm) -> list[str]:
    """Names of the faults that the form may be mistaken for, and of their directions."""
    return [
        one.name
        for one in problem.unknowns
        if one.name in form.mistaken or one.direction_of in form.mistaken
    ]


def _said(one: Unknown, actuator: ParameterSet, value: float) -> str:
    row = one.physical_value(actuator, value)
    return f"{one.name.replace('_', ' ')} {said(row.value, row.unit, 2)}"
