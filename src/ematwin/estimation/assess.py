"""From the end of a search to values with honest intervals.

A search holds all parameters at the values of the file. Here they are freed, each as far as it is
known, with the sensors and the load, and all descend together from where the search ended; then
the curvature, the aliases and the drifts give the intervals. Before these are believed, other
valleys that the search found are compared, and the misfit is looked at along each fault.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.aliases import aliases_of
from ematwin.estimation.baseline import Baseline, frees_parameters, with_all_free
from ematwin.estimation.constants import (
    ANYTHING,
    AS_GOOD,
    CERTAIN,
    COVERAGE,
    DECIDES,
    HOPELESS,
    IMPLAUSIBLE,
    SIGMAS,
    SMALLEST,
)
from ematwin.estimation.correction import Corrected, corrected, reweighed, with_model_error
from ematwin.estimation.descent import Descent
from ematwin.estimation.held_healthy import held_healthy
from ematwin.estimation.intervals import (
    Interval,
    contrasts_of,
    deviations,
    in_physical_units,
)
from ematwin.estimation.joint import Joint
from ematwin.estimation.laplace import Laplace, profiled, sharp_errors
from ematwin.estimation.other_minima import other_minima
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.estimation.spike_and_slab import FaultSets, fault_sets
from ematwin.estimation.verdict import worst_misfit
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

_REACHES = (2.0,)  # standard errors at which the misfit along a fault is looked at
_APART = 0.05  # share of a range by which another answer differs
_WORTH_A_LOOK = 4.0  # ratio of costs up to which another valley is gone into
_KNOWN, _BY_SHEET = 5, 10  # iterations from there: parameters have yet to leave the sheet's
_RIVALS = 2  # other valleys that are gone into
_ANEW = 3  # rounds in which a best point is looked for without the faults that it names
_NOWHERE = 0.3  # length of the mean of unit vectors: directions all round
_FAR = 100.0  # squared standard deviations by which a minimum is no rival any more


@dataclass(frozen=True)
class Assessment:
    """Values with intervals.

    Attributes
    ----------
    values : by name, all that was free
    covariance : (d, d) array, of the values of the problem that was searched
    sharp_errors : standard errors by fault, as if all parameters were known exactly
    intervals : by name, in the unit of the unknown
    physical : by name of a fault, value and interval in its physical unit
    contrasts : by name, value and interval
    nuisances : by name, value and interval of load and sensors where they stand out
    cost : float, of the data
    strained : parameters, load and sensors that would have to be further off than can be believed,
        by name, in standard deviations of what was known of them
    others : values by name of other answers that explain the recording nearly as well
    trust : how far the evidence of further channels counted (`Problem.trust`); 1 if there was none
    evaluations : int
    reference_runs : int, answers of the reference model that the best one took
    unsettled : names of what the last of them still moved by more than a standard error
    joint : the joint density of which these are the peak and its width; None after an interruption
    sets : the posterior of sets of faults; None after an interruption
    """

    values: dict[str, float]
    covariance: np.ndarray
    sharp_errors: dict[str, float]
    intervals: dict[str, Interval]
    physical: dict[str, tuple[float, Interval]]
    contrasts: dict[str, tuple[float, Interval]]
    nuisances: dict[str, tuple[float, Interval]]
    strained: dict[str, float]
    cost: float
    others: tuple[dict[str, float], ...]
    evaluations: int
    trust: float = 1.0
    reference_runs: int = 0
    unsettled: tuple[str, ...] = ()
    joint: Joint | None = None
    sets: FaultSets | None = None


def assess(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    found: Found,
    baseline: Baseline,
    threads: int | None = 1,
) -> Assessment:
    """Values with intervals, from where a search ended.

    Parameters
    ----------
    model, actuator : of the twin
    problem : that was searched
    found : the end of the search
    baseline : what is known of the actuator
    threads : on which valleys are gone into side by side; None takes one for each core
    """
    full = with_all_free(model, actuator, problem, baseline, found.problem)
    still = set() if frees_parameters(model) else set(baseline.prior.names) & set(full.names)
    measured = math.isfinite(baseline.misfit)
    healthy = baseline.misfit if measured else full.recorded_misfit
    settled, iterations = AS_GOOD * healthy, _KNOWN if measured else _BY_SHEET
    if baseline.exact:
        settled, iterations = math.inf, _KNOWN

    descent = Descent(
        aliases_of(model, actuator, full, _placed(full, problem, found.point)), still,
        full.comparisons[0].noise, settled=settled, iterations=iterations,
    )  # fmt: skip

    def peak_from(point: np.ndarray) -> Corrected:
        return corrected(full, _placed(full, problem, point), descent)

    def beside_it(near: Corrected, anew: bool = False) -> list[Corrected]:
        near_it = descent.afresh(settled=math.inf)
        return [
            corrected(full, one.point, near_it) for one in other_minima(near.peak, descent, anew)
        ]

    starts = [found.point, *_worth_a_look(full, found, problem)]
    # each may use all cores: most of its batches are one block
    best, *others = side_by_side(peak_from, starts, threads)
    misfit = full.relative_misfit(min(one.peak.cost for one in (best, *others)))
    usual = max(healthy, best.peak.problem.recorded_misfit)
    explained = full.relative_misfit(best.peak.cost) <= AS_GOOD * usual
    # from further off no other load has led to a verdict
    if misfit <= worst_misfit(baseline.misfit) and (_strained(best.peak) or not explained):
        others += beside_it(best)
        noise = best.peak.problem.noise
        nearest = min((best, *others), key=lambda one: height(one.peak, noise))
        if _strained(nearest.peak):
            others += beside_it(nearest, anew=True)
    spent = sum(one.peak.evaluations for one in (best, *others))
    noise = min(one.peak.problem.noise for one in (best, *others))
    others.sort(key=lambda one: height(one.peak, noise))
    if others and height(others[0].peak, noise) < height(best.peak, noise):
        others.append(best)
        best = others.pop(0)
    own, cost = len(problem.names), best.peak.cost
    weighed = reweighed(best, descent)
    if weighed is not best:  # all that follows is compared by the same weights
        near = [one.peak.point for one in others if risen(best.peak, one.peak) < _FAR]
        best, full, noise = weighed, weighed.peak.problem, weighed.peak.problem.noise
        near_it = descent.afresh(settled=math.inf, least_noise=noise)
        others = [corrected(full, point, near_it) for point in near]
        spent += sum(one.peak.evaluations for one in (best, *others))
    best = with_model_error(best, threads)
    errors, held = np.ones(len(full.names)), set[str]()
    for left in reversed(range(_ANEW)):
        sets = _sets(best, own, baseline, errors, held)
        improbable = _improbable(sets, best.peak)
        if not left or not improbable:
            break
        # values are those of the best explanation in which improbable faults are healthy
        held |= set(improbable)
        without = held_healthy(best.peak, [sorted(held)], threads)
        again = descent.afresh(settled=math.inf, least_noise=full.comparisons[0].noise)
        nearer = corrected(full, without.point, replace(again, held={*descent.held, *held}))
        spent += without.evaluations + nearer.peak.evaluations
        best = with_model_error(nearer, threads)
    named = [name for name, share in sets.probabilities.items() if share > CERTAIN]
    tried = held_healthy(best.peak, [[name] for name in named], threads)
    spent += tried.evaluations
    for name, rise in zip(named, tried.rises.tolist(), strict=True):
        n = full.names.index(name)
        errors[n] = max(1.0, sets.distances[name] / math.sqrt(max(1.0, rise)))
    if (errors > 1.0).any():
        sets = _sets(best, own, baseline, errors, held)
    peak, rivals = best.peak, [one.peak for one in others]
    sharp = sharp_errors(peak, own, peak.problem.model_error)
    values, intervals, covariance = _values(full, sets, peak, own)
    faults = [one for one in problem.unknowns if one.role == "fault"]
    return Assessment(
        values=values,
        covariance=covariance,
        sharp_errors=dict(zip(problem.names, sharp.tolist(), strict=True)),
        intervals=intervals,
        physical=in_physical_units(faults, actuator, values, sets, intervals),
        contrasts=contrasts_of(model, actuator, values, sets.drawn),
        nuisances=_evident(full, peak, intervals, own),
        strained=_strained(peak),
        cost=cost,
        others=_other_answers(problem, peak, rivals),
        evaluations=spent,
        trust=peak.problem.trust,
        reference_runs=best.rounds,
        unsettled=best.unsettled,
        joint=Joint(
            (peak, *rivals), peak.problem.model_error, own, peak.problem.comparisons[0].noise,
            scatter(baseline),
        ),
        sets=sets,
    )  # fmt: skip


def unassessed(
    model: Model, actuator: ParameterSet, problem: Problem, found: Found, baseline: Baseline
) -> Assessment:
    """What is said of a search that was interrupted: its values, and that nothing is sure."""
    values = problem.values(found.point)
    faults = [one for one in problem.unknowns if one.role == "fault"]
    whole = {one.name: Interval(one.lower, one.upper) for one in problem.unknowns}
    return Assessment(
        values=values,
        covariance=np.diag(np.full(len(problem.names), np.inf)),
        sharp_errors=dict.fromkeys(problem.names, math.inf),
        intervals=whole,
        physical={
            one.name: (
                one.physical_value(actuator, values[one.name]).value,
                Interval(
                    one.physical_value(actuator, one.lower).value,
                    one.physical_value(actuator, one.upper).value,
                ),
            )
            for one in faults
        },
        contrasts={},
        nuisances={},
        strained={},
        cost=found.cost,
        others=(),
        evaluations=0,
    )


def _placed(full: Problem, problem: Problem, point: np.ndarray) -> np.ndarray:
    """The point (d,) of a problem in which more is free: all that was not searched as known."""
    known = dict(zip(problem.names, point.tolist(), strict=True))
    return np.array([known.get(one.name, one.healthy) for one in full.unknowns])


def _worth_a_look(full: Problem, found: Found, problem: Problem) -> list[np.ndarray]:
    """Ends of other valleys that are not far worse and lie apart; none of what nothing explains."""
    if not found.others:
        return []
    judged = found.problem or problem
    points = np.stack([found.point, *found.others])
    costs = judged.costs(points)
    if judged.relative_misfit(costs[0]) > HOPELESS:
        return []
    near = 1 + np.argsort(costs[1:], kind="stable")[:_RIVALS]
    points, costs = points[np.r_[0, near]], costs[np.r_[0, near]]
    apart = np.abs(judged.chart.from_values(points) - judged.chart.from_values(points[:1]))
    return [
        point
        for point, cost, away in zip(points[1:], costs[1:], apart[1:].max(axis=1), strict=True)
        if away > _APART and cost < _WORTH_A_LOOK * costs[0]
    ]


def height(peak: Laplace, noise: float) -> float:
    """How far a peak lies from the recording and from the priors, squared standard deviations."""
    distances = peak.problem.prior_distances(peak.point[None])[0] / peak.problem.noise
    data = (peak.cost + peak.evidence) / noise**2
    return data + float(distances @ distances)


def risen(first: Laplace, other: Laplace) -> float:
    """How much higher the second peak lies, squared standard deviations.

    Costs at the bottom of two valleys scatter with impacts and ripple, by a tenth from one answer
    of the reference to the next, where noise alone would have them differ by far less: so all that
    a fast model misses counts as noise here.
    """
    noise = first.problem.comparisons[0].model_error * min(first.problem.noise, other.problem.noise)
    return height(other, noise) - height(first, noise)


def _with_scatter(found: Corrected, baseline: Baseline) -> np.ndarray:
    """The covariance with what the twin misses, and what healthy recordings are off by."""
    peak, covariance = found.peak, found.covariance
    widths, differ = peak.problem.chart.widths, scatter(baseline)
    for n, name in enumerate(peak.problem.names):
        if name in differ:
            covariance[n, n] += (differ[name] / widths[n]) ** 2
    return covariance


def scatter(baseline: Baseline) -> dict[str, float]:
    """By fault, how far a healthy recording may be found off healthy."""
    more = math.sqrt(1.0 + 1.0 / max(1, baseline.recordings))
    return {name: more * value for name, value in baseline.scatter.items()}


def _sets(
    found: Corrected, own: int, baseline: Baseline, errors: np.ndarray, held: Collection[str]
) -> FaultSets:
    """The posterior of sets of faults around a peak; the first ``own`` unknowns were searched.

    Parameters
    ----------
    errors : (d,) array, factors by which standard errors are larger than the curvature says
    held : names of faults that are held healthy at the peak
    """
    peak = found.peak
    factor = peak.problem.model_error
    covariance = _with_scatter(found, baseline)
    covariance = profiled(peak, covariance, range(own), factor, _REACHES)
    mean = peak.unbounded(factor, held)
    return fault_sets(peak.problem.chart, mean, covariance * np.outer(errors, errors))


def _improbable(sets: FaultSets, peak: Laplace) -> list[str]:
    """Faults that are improbable, and are not healthy at a peak."""
    values = peak.problem.values(peak.point)
    return [
        one.name
        for one in sets.faults
        if sets.is_improbable(one.name)
        and abs(values[one.name] - one.healthy) > SMALLEST * one.width
    ]


def _values(
    full: Problem, sets: FaultSets, peak: Laplace, own: int
) -> tuple[dict[str, float], dict[str, Interval], np.ndarray]:
    """Values and intervals by name, and the covariance (own, own) of what was searched.

    Of a fault they are those of the sets with it. Deviations of a logarithmic unknown are of the
    logarithm, scaled such that a value is as many standard errors from healthy as its logarithm
    is: halved is as far off as doubled. The covariance is infinite for a direction that has no
    meaning, and for a value that may be anything.
    """
    values, intervals, errors = full.values(peak.point), {}, []
    for one in full.unknowns:
        given = sets.given(one.direction_of or one.name)
        is_fault = one.role == "fault" and one.direction_of is None
        if is_fault and sets.is_improbable(one.name):
            values[one.name] = float(given.of(one.name).mean())
        low, high = given.interval(one.name, one.lower, one.upper)
        if is_fault and sets.presence(one.name) < CERTAIN:
            low, high = min(low, one.healthy), max(high, one.healthy)
        intervals[one.name] = Interval(low, high)
        errors.append(_error(one, given.of(one.name), values[one.name]))
    covariance = np.diag(np.square(errors[:own]))
    # what is absent in all sets is no neighbour of anything
    away = [
        deviations(one, sets.drawn.values[:, n], values[one.name])
        for n, one in enumerate(full.unknowns[:own])
    ]
    varied = [n for n in range(own) if math.isfinite(errors[n]) and np.ptp(away[n]) > 0.0]
    if varied:
        alike = np.atleast_2d(np.corrcoef([away[n] for n in varied]))
        sizes = np.array([errors[n] for n in varied])
        covariance[np.ix_(varied, varied)] = alike * np.outer(sizes, sizes)
    return values, intervals, covariance


def _error(one: Unknown, drawn: np.ndarray, value: float) -> float:
    """Standard error of a value by draws (N,), infinite where it may be anything."""
    if one.direction_of is not None and abs(np.exp(2j * np.pi * drawn).mean()) < _NOWHERE:
        return math.inf
    error = math.sqrt(float(np.mean(deviations(one, drawn, value) ** 2)))
    return math.inf if one.role == "fault" and error > ANYTHING * one.width else error


def _evident(
    full: Problem, peak: Laplace, intervals: Mapping[str, Interval], own: int
) -> dict[str, tuple[float, Interval]]:
    """Load and sensors that are clearly not as recorded."""
    point = peak.point
    found = {}
    for n, one in enumerate(full.unknowns):
        if n < own or one.role != "nuisance":
            continue
        reach = 0.5 * (intervals[one.name].high - intervals[one.name].low) / COVERAGE
        away = abs(point[n] - one.healthy)
        if one.spread is not None and away > max(SIGMAS * reach, 0.5 * one.spread):
            found[one.name] = (float(point[n]), intervals[one.name])
    return found


def _strained(peak: Laplace) -> dict[str, float]:
    """What lies beyond belief, and how far."""
    problem, point = peak.problem, peak.point
    prior, found = problem.prior, {}
    spread = np.sqrt(np.diag(prior.covariance))
    for name, mean, error in zip(prior.names, prior.mean, spread, strict=True):
        n = problem.names.index(name)
        here = math.log(point[n]) if problem.unknowns[n].logarithmic else point[n]
        away = abs(here - mean) / error
        if away > IMPLAUSIBLE and problem.unknowns[n].role != "fault":
            found[name] = float(away)
    return found


def _other_answers(
    problem: Problem, peak: Laplace, rivals: list[Laplace]
) -> tuple[dict[str, float], ...]:
    """Rivals that explain the recording nearly as well and say something else."""
    own = len(problem.names)
    found = []
    for one in rivals:
        rise = risen(peak, one)
        away = np.abs(one.z[:own] - peak.z[:own]).max()
        if rise < DECIDES and away > _APART:
            found.append(dict(zip(problem.names, one.point[:own].tolist(), strict=True)))
    return tuple(found)
