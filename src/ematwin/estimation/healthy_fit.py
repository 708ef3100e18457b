"""Healthy recordings: parameters fitted to all of them, and bias and scatter of estimates on each.

Recordings of few commands are searched all over the ranges of the parameters, until two searches
end equally deep. Where the misfit is smooth, and noise alone is left next to where the fit of forms
ended, there is no search; and a kind with one minimum starts from its template. From there all
recordings are fitted together, with sensors and load of each.

Recordings of one healthy actuator differ; and a twin that lacks a form of an actuator takes part of
it for a fault, in all of them alike. Parameters and sensors, which are free beside the faults,
can hide that from a calibration and not from a verdict: so healthy recordings are judged as
`identify` would. Deviations beyond the standard errors there may occur in any recording.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.along_motion import informed, shown_along, usual_search
from ematwin.estimation.assess import assess
from ematwin.estimation.baseline import Baseline, effective, frees_parameters, searched_range
from ematwin.estimation.constants import AS_GOOD, SAME_COMMAND, WORSE, WORST
from ematwin.estimation.corrected_problem import as_searched, corrected_at, reference_scatter
from ematwin.estimation.correction import Corrected, corrected, reweighed, with_model_error
from ematwin.estimation.descent import Descent
from ematwin.estimation.free_unknowns import searched
from ematwin.estimation.laplace import Laplace, laplace
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.multistart import MultistartDescent
from ematwin.estimation.noise import noise_at
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Search, Tally, find
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.sensors import SKEW
from ematwin.models.unknown import Alias, Unknown
from ematwin.numerics.side_by_side import side_by_side
from ematwin.numerics.signals import spread_of
from ematwin.recordings.recording import Recording

Progress = Callable[[float], None]

_SEARCHES = 8  # at most: of one actuator in sixty six of them end in the same wrong valley
_TRIED = 2  # ends of searches from which all recordings are fitted together
_ODD = 6.0  # standard deviations by which faults differ from those of other recordings


def healthy_nuisances(
    model: Model, actuator: ParameterSet, comparisons: Sequence[Comparison]
) -> list[Unknown]:
    """Load and sensors that matter to healthy recordings; the load as a load cell states it."""
    found = [
        replace(one, spread=0.01) if one.name == "load_gain" else one
        for one in effective(model, actuator, comparisons)
    ]
    if frees_parameters(model):
        return found
    # a load that was not recorded
    every = model.unknowns(actuator)
    return [*(one for one in every if one.role == "nuisance" and not one.marginal), *found]


def expected_misfit(comparisons: Sequence[Comparison], command: str) -> float:
    """The relative misfit that noise and the twin's known error leave; noise from repeats."""
    known = comparisons[0].expected_misfit
    shares = []
    for one, other in combinations(comparisons, 2):
        if not one.whitened and same_command(one.recording, other.recording, command):
            mine, theirs = one.measured(), other.measured()
            gap = sum(float(np.sum((mine[k] - theirs[k]) ** 2)) for k in mine)
            shares.append(0.5 * gap / sum(float(np.sum(mine[k] ** 2)) for k in mine))
    # the two that are most alike: one may be faulty
    noise = min(shares, default=0.0)
    return max(known, float(np.sqrt(noise)))


def same_command(a: Recording, b: Recording, command: str) -> bool:
    """Whether two recordings follow the same command at the same rate."""
    if len(a) != len(b) or abs(a.interval - b.interval) > 1e-3 * a.interval:
        return False
    mine, theirs = a.channels[command], b.channels[command]
    return bool(np.abs(mine - theirs).max() <= SAME_COMMAND * max(float(np.ptp(mine)), 1e-300))


class Fitted(NamedTuple):
    """The minimum of all recordings together."""

    end: Corrected
    misfit: float  # relative, of all recordings
    alone: float  # of the recordings searched
    scatter: float  # of the reference from one candidate to the next (`reference_scatter`)

    @property
    def values(self) -> dict[str, float]:
        """Values of all unknowns by name."""
        return self.end.peak.problem.values(self.end.peak.point)

    @property
    def explains_along_motion(self) -> bool:
        """Whether equations along the motion show every fault, and leave no more than may be."""
        known = self.end.peak.problem.information
        return known is not None and known.whole and known.unexplained <= WORST

    def explains(self, floor: float) -> bool:
        """Whether little more is left than a misfit (``floor``) and the scatter do."""
        return self.misfit <= WORSE * math.hypot(floor, self.scatter)


@dataclass(frozen=True)
class HealthyFit:
    """Search and joint fit of some recordings.

    Equations along the recorded motion take the place of the search for an actuator with forms that
    only the reference has. ``near`` are values from which they set out, by name.
    """

    model: Model
    template: ParameterSet
    nominals: Sequence[Unknown]
    floor: float
    near: Mapping[str, float] = field(default_factory=dict)

    def run(self, comparisons: Sequence[Comparison], tell: Progress = lambda share: None) -> Fitted:
        """The minimum of all recordings together."""
        beside = [one.with_evidence() for one in comparisons]
        own = healthy_nuisances(self.model, self.template, beside)
        mine = [one.name for one in own]
        problem = Problem(beside, [*self.nominals, *own], own=mine, start=self.near)
        if not frees_parameters(self.model):
            point, alone = self._from_template(problem, comparisons)
        elif along := informed(self.model, self.template, problem, problem.start):
            problem, point = along
            alone = self.floor
        else:
            point, alone = self._from_near(problem) or self._searched(
                problem, comparisons, own, tell
            )
        # coarse to fine: what is learnt here is what faults are multiples of
        scatter = reference_scatter(problem, point) if problem.lacks_forms else 0.0
        noise = noise_at(problem, scatter)
        if problem.is_informed:  # what is left is alike throughout, and equations know better
            noise *= problem.model_error
        near = Descent(self._aliases, settled=np.inf, least_noise=noise)
        end = corrected(problem.refined(), point, near)
        left = end.peak.problem.relative_misfit(end.peak.cost)
        return Fitted(with_model_error(reweighed(end, near)), left, alone, scatter)

    def _aliases(self, values: Mapping[str, float]) -> Sequence[Alias]:
        return self.model.aliases(self.template, values)

    def _from_template(
        self, problem: Problem, comparisons: Sequence[Comparison]
    ) -> tuple[np.ndarray, float]:
        """The template with the nuisances of each recording (d,), and the misfit of each alone."""
        free = searched(self.model, self.template)
        start, cost = {}, 0.0
        for n, one in enumerate(comparisons):
            starts = self.model.starts(self.template, one.recording)
            alone = Problem([one], free, starts=starts)
            found = find(alone, LocalDescent())
            cost += found.cost
            for name, value in alone.values(found.point).items():
                start[name if len(comparisons) == 1 else f"{name}@{n}"] = value
        first = [start.get(a, b) for a, b in zip(problem.names, problem.start, strict=True)]
        return np.array(first), problem.relative_misfit(cost)

    def _from_near(self, problem: Problem) -> tuple[np.ndarray, float] | None:
        """The minimum next to where the forms were fitted, as `_searched` gives it.

        None where more than noise is left there, or where the misfit is rough.
        """
        if not (self.near and problem.is_smooth):
            return None
        nearer = corrected_at(problem, problem.start)
        if nearer is None:
            return None
        peak = laplace(nearer, problem.start, Descent(self._aliases, settled=np.inf))
        left = nearer.relative_misfit(peak.cost)
        return (peak.point, left) if left < AS_GOOD * nearer.expected_misfit else None

    def _searched(
        self,
        problem: Problem,
        comparisons: Sequence[Comparison],
        own: Sequence[Unknown],
        tell: Progress,
    ) -> tuple[np.ndarray, float]:
        """The best point (d,) from which all fit, and the misfit of the recordings searched."""
        sought, ends = self._ends(comparisons, [o for o in own if o.name == SKEW], tell)
        best: Laplace | None = None
        for n, (cost, z) in enumerate(ends[:_TRIED]):
            point = sought.chart.to_values(z[None])[0]
            start = dict(zip(sought.names, point.tolist(), strict=True))
            pairs = zip(problem.names, problem.start, strict=True)
            first = np.array([start.get(name.partition("@")[0], value) for name, value in pairs])
            # what a search has found fits as it is: smoothed currents hardly tell an inductance
            near = Descent(self._aliases, settled=AS_GOOD * sought.relative_misfit(cost))
            peak = laplace(corrected_at(problem, first) or problem, first, near)
            tell(0.6 + 0.2 * (n + 1) / _TRIED)
            if best is None or peak.cost < best.cost:
                best = peak
            if problem.relative_misfit(best.cost) < AS_GOOD * self.floor:
                break
        assert best is not None
        return best.point, sought.relative_misfit(ends[0][0])

    def _ends(
        self, comparisons: Sequence[Comparison], clocks: Sequence[Unknown], tell: Progress
    ) -> tuple[Problem, list[tuple[float, np.ndarray]]]:
        """Ends of searches all over the ranges, the deepest first."""
        command = self.model.command
        chosen: list[Comparison] = []
        for one in comparisons:
            known = (same_command(one.recording, c.recording, command) for c in chosen)
            if len(chosen) < 2 and not any(known):  # different commands
                chosen.append(one)
        problem = Problem(chosen, [*(searched_range(one) for one in self.nominals), *clocks])
        problem = as_searched(problem)
        search = MultistartDescent(Tally(problem, 20_000))  # it takes 1,300
        ends: list[tuple[float, np.ndarray]] = []
        for n, end in enumerate(search.searches(_SEARCHES)):
            ends.append(end)
            tell(0.6 * (n + 1) / _SEARCHES)
            ends.sort(key=lambda one: one[0])
            agree = len(ends) > 1 and ends[1][0] < 1.1**2 * ends[0][0]
            # a floor is known where a recording was repeated
            low = problem.relative_misfit(ends[0][0]) < AS_GOOD * self.floor
            if agree and (low or len(comparisons) == 1):
                break
        return problem, ends


def lacking_load(model: Model, comparisons: Sequence[Comparison]) -> str:
    """A sentence where no recording holds the load, which looks like much else; "" else."""
    if model.load is None or any(model.load in one.recording.channels for one in comparisons):
        return ""
    return f" None of them holds {model.load}: if there was one, record it."


def refuse_odd(fit: HealthyFit, comparisons: Sequence[Comparison], misfit: float) -> None:
    """Refuse a recording without which the others agree; return if there is none."""
    left = []
    for n in range(len(comparisons)):
        others = [one for k, one in enumerate(comparisons) if k != n]
        left.append(fit.run(others).misfit)
    best = int(np.argmin(left))
    if left[best] > 0.5 * misfit:
        return  # no better without any of them: the twin lacks something
    load = lacking_load(fit.model, comparisons)
    if len(comparisons) == 2:
        raise RecordError(
            f"The two recordings contradict each other: together the twin leaves "
            f"{100.0 * misfit:.1f} % of them unexplained, alone {100.0 * left[best]:.1f} %. One of "
            f"them is faulty or of another actuator; leave it out, or give a third.{load}"
        )
    raise RecordError(
        f"{_name_of(comparisons, best)} is unlike the other healthy recordings: with it the "
        f"twin leaves {100.0 * misfit:.1f} % unexplained, without it {100.0 * left[best]:.1f} %. "
        f"If it is faulty or of another actuator, leave it out.{load}"
    )


class _Judged(NamedTuple):
    """Faults of a recording, without directions."""

    values: np.ndarray  # (d,)
    errors: np.ndarray  # (d,), standard
    cost: float  # of the data
    is_told: bool  # as of `Problem`


def healthy_bias(
    model: Model,
    actuator: ParameterSet,
    baseline: Baseline,
    comparisons: Sequence[Comparison],
    beside: Sequence[Mapping[str, float]],
) -> dict[str, float]:
    """Standard deviation by which a healthy recording may be found off healthy, by fault.

    It is the larger of two. One is of what `identify` finds (`between_recordings`). The other is
    estimated with the faults alone free and all else as learnt: there the faults absorb the whole
    error of the twin.

    ``baseline`` is without this; ``beside`` are load and sensors of each recording, as learnt.
    `RecordError` if one of them is unlike the others.
    """
    faults = [one for one in model.faults(actuator) if one.direction_of is None]
    # recordings of one occasion: nothing has drifted since
    now = replace(baseline, recordings=0)
    compared = [model.compare(one.recording, actuator) for one in comparisons]

    def judged(one: Comparison, search: Search | None = None) -> _Judged:
        """The faults of a recording, all else free as it is known."""
        problem = as_searched(Problem([one], model.faults(actuator)))
        end = find(problem, search or usual_search(model, shown_along(model, actuator, problem)))
        seen = assess(model, actuator, problem, end, now)
        chosen = [n for n, one in enumerate(problem.unknowns) if one.direction_of is None]
        values = np.array([seen.values[problem.names[n]] for n in chosen])
        told = seen.joint is not None and seen.joint.peaks[0].problem.is_told
        return _Judged(values, np.sqrt(np.diag(seen.covariance))[chosen], seen.cost, told)

    found = side_by_side(judged, compared)
    settled, left = list(found), set(range(len(found)))
    while odd := _odd(faults, settled):
        n, said = odd
        # a search may end beside a healthy minimum that explains the recording as well
        near = judged(compared[n], LocalDescent()) if n in left else None
        if near is None or near.cost > AS_GOOD**2 * found[n].cost:
            raise RecordError(f"{_name_of(comparisons, n)} {said}")
        settled[n] = near
        left.remove(n)
    values, errors = (np.array(each) for each in list(zip(*found, strict=True))[:2])
    healthy = np.array([one.healthy for one in faults])
    beyond = between_recordings(values - healthy, errors)
    if not all(one.is_told for one in found):  # else the closed loop tells nothing of faults
        ends = [_descended_to(one, faults, own) for one, own in zip(compared, beside, strict=True)]
        beyond = np.maximum(beyond, np.mean((np.array(ends) - healthy) ** 2, axis=0))
    return {one.name: float(x) for one, x in zip(faults, np.sqrt(beyond), strict=True)}


def between_recordings(away: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (d,) between recordings, of estimates (n, d) less healthy with standard errors.

    The mean square less what standard errors explain: the moment estimate (DerSimonian and Laird
    1986, Control. Clin. Trials 7, 177-188).
    """
    return np.asarray(np.maximum(np.mean(away**2 - errors**2, axis=0), 0.0))


def _descended_to(
    one: Comparison, faults: Sequence[Unknown], held: Mapping[str, float]
) -> np.ndarray:
    """(d,) faults at the end of a descent from healthy, which may end below it."""
    problem = Problem([one], faults, held=held)
    problem = corrected_at(problem, problem.healthy) or problem
    return LocalDescent().run(problem, budget=None, seed=1, report=lambda *_: None).point


def _odd(faults: Sequence[Unknown], found: Sequence[_Judged]) -> tuple[int, str] | None:
    """Which of at least three recordings has faults unlike the others, and how it differs.

    None if there is none.
    """
    if len(found) < 3:
        return None
    values, errors = (np.array(each) for each in list(zip(*found, strict=True))[:2])
    width = np.array([one.width for one in faults])
    away = np.abs(values - np.median(values, axis=0)) / width
    scatter = np.hypot(spread_of(away, axis=0), errors / width)
    usual = np.maximum(scatter, 0.05 / _ODD)  # so much of a range is never odd
    n, k = (int(x) for x in np.unravel_index(np.argmax(away / usual), away.shape))
    if away[n, k] <= _ODD * usual[n, k]:
        return None
    return n, (
        f"is unlike the other healthy recordings: its {faults[k].name} differs from theirs by "
        f"{values[n, k] - np.median(values[:, k]):+.2g}. If it is faulty or of another actuator, "
        "leave it out."
    )


def _name_of(comparisons: Sequence[Comparison], n: int) -> str:
    """The file or labels of a recording, else its place."""
    recording = comparisons[n].recording
    if recording.source or recording.labels:
        return recording.name
    return f"Recording {n + 1} of {len(comparisons)}"
