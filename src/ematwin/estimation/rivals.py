"""Whether another form of a fault, which the parameter file leaves out, explains a recording.

A twin names the fault that comes nearest among those that it has. A kind knows forms that its file
may leave out (`Model.other_forms`). Each is descended to from where the first answer puts it, with
all free that was free there, and the heights of both peaks are compared: how far each lies from
the recording and from the priors, in squared standard deviations.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

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
    WORST,
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
from ematwin.numerics.side_by_side import side_by_side
from ematwin.showing.text import capital, said

_FAR = 5.0  # times the misfit of the first answer: a start, or a smooth descent, not worth more
_FAR_BETTER = 0.7  # times the misfit of the first answer; 0.42 at most where the form was right


@dataclass(frozen=True)
class Rival:
    """Another form and how well it explains the recording."""

    form: OtherForm
    present: tuple[str, ...]  # names of the faults that are there, of the form or mistaken for it
    said: str  # the same with their values
    # how much further it is from recording and priors than the first answer, squared standard
    # deviations or, if more, the scatter of the reference; negative where it is nearer
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
    unexplained = verdict.grade == "none"
    if assessed.joint is None or verdict.grade not in ("fault", "none"):
        return []
    if unexplained and not EXPLAINED < problem.relative_misfit(assessed.cost) <= HOPELESS:
        return []
    forms = [
        form
        for form in model.other_forms(actuator, assessed.values)
        if (unexplained or form.mistaken & set(verdict.faults))
        and set(form.names) <= set(problem.names)
    ]
    if not forms:
        return []
    peak, unit = assessed.joint.peaks[0], 1.0
    first = _First(model, actuator, problem, baseline, peak, unexplained, threads)
    # each may use all cores: the other one often ends at once
    ends = side_by_side(first.compared_with, forms, threads)
    # where answers of the reference scatter, two of one form differ by so much
    if not peak.problem.is_told:
        noise = peak.problem.comparisons[0].model_error * peak.problem.noise
        unit = max(1.0, SIGMAS * assessed.cost_scatter / noise**2 / DECIDES)
    return [
        first.rival(form, end.peak, end.rise / unit)
        for form, end in zip(forms, ends, strict=True)
        if end is not None and end.rise < DECIDES * unit
    ]


def weighed(rivals: Sequence[Rival], verdict: Verdict) -> tuple[Verdict, list[str]]:
    """The verdict in the light of other forms, and sentences on those that do not change it.

    A nearer form that says something else forbids the verdict. One that is about as near, and needs
    no more faults, is told beside it: any shares of turns are an offset fixed in space and some
    turns missing from each phase, and where one short explains as much as such a mixture, the short
    is the answer.
    """
    if verdict.grade == "none":
        nearest = sorted(rivals, key=lambda one: one.rise)[:1]
        return verdict, [
            f"{_told(one)} would explain this recording far better: {_put(one)} that."
            for one in nearest
            if one.rise < -DECIDES
        ]
    objections, doubts, hints = [], [], []
    for one in rivals:
        named = one.form.mistaken & set(verdict.faults)
        agrees, nearer = set(one.present) == named, one.rise < -DECIDES
        if nearer and not agrees:
            objections.append(
                f"{_told(one)} explains it better: if the actuator may have that, put "
                f"{one.form.setting} into its file."
            )
        elif nearer and set(one.form.names) & set(one.present):
            hints.append(
                f"{_told(one)} would explain this recording better; the same fault, of another "
                f"size: {_put(one)} that."
            )
        elif not agrees and 0 < len(one.present) <= len(named) and one.rise <= DECIDES:
            doubts.append(
                f"Not certain: {one.form.meaning} ({one.said}) would explain this recording about "
                "as well."
            )
            hints.append(f"{capital(_put(one))} {one.form.meaning}.")
    if objections:
        return Verdict.none(" ".join(objections)), hints
    reason, sentence = (
        " ".join([text, *doubts]).strip() for text in (verdict.reason, verdict.sentence)
    )
    return replace(verdict, reason=reason, sentence=sentence), hints


def _told(one: Rival) -> str:
    """The form and its values, as a sentence begins."""
    return capital(f"{one.form.meaning} ({one.said})" if one.said else one.form.meaning)


def _put(one: Rival) -> str:
    """How to state the form, as a sentence ends."""
    return f"put {one.form.setting} into the file of the actuator if it may have"


class _End(NamedTuple):
    """The best point of another form, and its rise (`Rival`)."""

    peak: Laplace
    rise: float


@dataclass(frozen=True)
class _First:
    """The first answer, with which other forms are compared.

    Of an ``unexplained`` recording only what is far better is told.
    """

    model: Model
    actuator: ParameterSet
    problem: Problem
    baseline: Baseline
    peak: Laplace
    unexplained: bool
    threads: int | None

    @cached_property
    def values(self) -> dict[str, float]:
        return self.peak.problem.values(self.peak.point)

    def compared_with(self, form: OtherForm) -> _End | None:
        """The other form at its best; None where it would be far worse, or is not worth telling."""
        peak, given = self.peak, self._with_form(form)
        starts = np.stack([_start(given, self.problem.names, one) for one in form.starts])
        costs = given.costs(starts)
        best = int(np.argmin(costs))
        # a start that follows from the first answer is right; others may be far from their valley
        if len(starts) > 1 and not costs[best] < _FAR**2 * peak.cost:
            return None
        start = starts[best]
        as_found = _start(given, given.names, {**self.values, **form.starts[best]})
        # equations along the motion may exclude a form, however well it fits the closed loop
        own, most = peak.problem.information, math.inf
        if own is not None and not self.unexplained:
            noise = peak.problem.comparisons[0].model_error * peak.problem.noise
            most = own.wider**2 * (DECIDES + height(peak, noise))
        try:
            along = informed(self.model, form.actuator, given, as_found, most, like=peak.problem)
        except TooFarError:
            return None
        known = along and along[0].information
        if own and own.whole and not (known and known.unexplained <= max(WORST, own.unexplained)):
            return None  # where equations tell all, the closed loop alone excludes no answer
        full, start = along or (given, start)
        smooth = peak.problem.smoothed()
        left = smooth.relative_misfit(smooth.data_cost(smooth.residuals(peak.point[None])[0]))
        limits = {
            "within": (1.0 if self.unexplained else _FAR) * left,
            "settled": AS_GOOD * peak.problem.relative_misfit(peak.cost),
            "least": NOTHING,
        }

        def descended_from(start: np.ndarray) -> list[_End]:
            try:
                end = self._descended(
                    form.actuator, full, start, _information(peak, full), **limits
                )
            except TooFarError:
                return []
            return [_End(end, risen(peak, end))]

        ends = descended_from(start)
        # it may have stopped short: it gets the parameters of the first answer
        short = not ends or ends[0].rise > DECIDES
        if short and not self.unexplained and not np.array_equal(as_found, start):
            ends += descended_from(as_found)
        end = min(ends, key=lambda one: one.rise, default=None)
        if end is None or (self.unexplained and end.peak.cost > _FAR_BETTER**2 * peak.cost):
            return None
        return self._with_what_it_found(form, end) if end.rise < -DECIDES else end

    def _with_form(self, form: OtherForm) -> Problem:
        """The problem with the form, everything free, also the parameters that the form adds."""
        comparisons = [
            self.model.compare(one.recording, form.actuator, threads=self.threads)
            for one in self.peak.problem.comparisons  # with the first samples that were found
        ]
        other = Problem(comparisons, self.problem.unknowns, held=self.problem.held)
        baseline = self.baseline
        if not baseline.exact:
            known = {one.name for one in uncertain(self.model, self.actuator)}
            every = uncertain(self.model, form.actuator)
            more = with_nuisances(baseline.prior, (o for o in every if o.name not in known))
            baseline = replace(baseline, prior=more)
        return with_all_free(self.model, form.actuator, other, baseline)

    def _with_what_it_found(self, form: OtherForm, end: _End) -> _End:
        """The rise where the first answer gets what the other form found beside the fault."""
        own, full, rise = self._own_names(form), self.peak.problem, end.rise
        found = end.peak.problem.values(end.peak.point)
        beside = {name: x for name, x in found.items() if name not in own}
        for names in (self.problem.names, full.names):
            point = _start(full, names, {**self.values, **beside})
            # as many regressions as the other form has had
            along = full.is_told and informed(self.model, self.actuator, full, point, like=full)
            again, point = along or (full, point)
            rise = max(rise, risen(self._descended(self.actuator, again, point), end.peak))
            if rise >= -DECIDES:
                break
        return end._replace(rise=rise)

    def _descended(
        self,
        actuator: ParameterSet,
        full: Problem,
        start: np.ndarray,
        information: np.ndarray | None = None,
        **known: Any,
    ) -> Laplace:
        """The peak next to a start, corrected as the first one was; ``known`` is of `Descent`."""
        aliases = partial(self.model.aliases, actuator)
        descent = Descent(aliases, least_noise=full.least_noise, **known)
        like = self.peak.problem
        return corrected(full, start, descent, information=information, like=like).peak

    def rival(self, form: OtherForm, end: Laplace, rise: float) -> Rival:
        """The other form at its best point, with its likely faults of a size that matters."""
        factor, values = end.problem.model_error, end.problem.values(end.point)
        sets = fault_sets(end.problem.chart, end.unbounded(factor), end.widened(factor)).sets
        names = set(form.names)
        likely = next((one.faults for one in sets if one.faults & names), frozenset[str]())
        faults = [self.model.unknown(form.actuator, name) for name in self._own_names(form)]
        there = tuple(
            one.name
            for one in faults
            if one.name in likely and abs(values[one.name] - one.healthy) >= SMALLEST * one.width
        )
        told = [
            (one.name.replace("_", " "), one.physical_value(form.actuator, values[one.name]))
            for one in faults
            if one.name in there or one.direction_of in there
        ]
        sizes = ", ".join(f"{name} {said(row.value, row.unit, 2)}" for name, row in told)
        return Rival(form, there, sizes, rise)

    def _own_names(self, form: OtherForm) -> list[str]:
        """Names of the faults that the form may be mistaken for, and of their directions."""
        return [
            one.name
            for one in self.problem.unknowns
            if one.name in form.mistaken or one.direction_of in form.mistaken
        ]


def _start(full: Problem, names: Collection[str], values: Mapping[str, float]) -> np.ndarray:
    """(d,) where a descent sets out: ``names`` at ``values``, all else as it is known."""
    point = [
        values.get(one.name, one.healthy) if one.name in names else one.healthy
        for one in full.unknowns
    ]
    return np.clip(point, full.lower, full.upper)


def _information(peak: Laplace, full: Problem) -> np.ndarray:
    """(d, d), by which differences of another form are as long as the first answer is wide."""
    information = np.diag(np.full(len(full.names), np.diag(peak.information).max()))
    shared = [n for n, name in enumerate(full.names) if name in peak.problem.names]
    places = [peak.problem.names.index(full.names[n]) for n in shared]
    information[np.ix_(shared, shared)] = peak.information[np.ix_(places, places)]
    return information
