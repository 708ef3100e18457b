"""From the end of a search to values with honest intervals.

Around each minimum (`ematwin.estimation.minima`) the curvature, the error of the model and the bias
of healthy recordings give a normal distribution, and all of them the probability of each set of
faults (`ematwin.estimation.spike_and_slab`).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.aliases import Aliases
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import (
    ANYTHING,
    APART,
    CERTAIN,
    COVERAGE,
    SIGMAS,
    SMALLEST,
    WORTH,
)
from ematwin.estimation.correction import Corrected, corrected, with_model_error
from ematwin.estimation.held_healthy import held_healthy
from ematwin.estimation.intervals import (
    Interval,
    contrasts_of,
    deviations,
    in_physical_units,
    physical_of,
)
from ematwin.estimation.joint import Joint
from ematwin.estimation.laplace import Laplace, sharp_errors
from ematwin.estimation.minima import height, minima, risen, strained
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.estimation.spike_and_slab import WINDOW, FaultSets, fault_sets
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown

_AGAIN = 2  # times that the best point is looked for without faults, at most
_NOWHERE = 0.3  # length of the mean of unit vectors: directions all round


@dataclass(frozen=True)
class Assessment:
    """Values with intervals.

    Attributes
    ----------
    values : by name, all that was free
    covariance : (d, d) array, of the values of the problem that was searched
    sharp_errors : standard errors by fault, as if all parameters were known exactly
    intervals : by name, in the unit of the unknown
    physical : by name of an unknown, value and interval in its physical unit
    contrasts : by name, value and interval
    nuisances : by name, value and interval of load and sensors where they stand out
    cost : float, of the data
    strained : parameters, load and sensors that are implausible under their priors, by name, in
        standard deviations of the prior
    others : values by name at other minima that are not improbable
    trust : how far the evidence of further channels counted (`Problem.trust`); 1 if there was none
    evaluations : int
    reference_runs : int, answers of the reference model that the best one took
    scatter : float, relative misfit by which answers of the reference differ from one to the next
    cost_scatter : float, standard deviation of the cost of the data within the width
    unsettled : names of unknowns that the last of them still moved by more than a standard error
    joint : the joint density, with its peak and width; None after an interruption
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
    scatter: float = 0.0
    cost_scatter: float = 0.0
    unsettled: tuple[str, ...] = ()
    joint: Joint | None = None
    sets: FaultSets | None = None


def assess(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    end: Found,
    baseline: Baseline,
    threads: int | None = 1,
) -> Assessment:
    """Values with intervals, from where a search ended.

    Parameters
    ----------
    model, actuator : of the twin
    problem : that was searched
    end : of the search
    baseline : prior knowledge of the actuator
    threads : for descents side by side; None takes one for each core
    """
    found = minima(model, actuator, problem, end, baseline, threads)
    full, others, own = found.problem, found.others, len(problem.names)
    spent, cost = found.evaluations, found.cost
    best = with_model_error(found.best, threads)
    held, again = set[str](), found.descent.afresh(settled=math.inf, least_noise=full.least_noise)

    def sets_at(one: Corrected, held: Collection[str] = ()) -> FaultSets:
        return _sets(one, baseline, held, found.descent.aliases)

    sets = sets_at(best)
    for _ in range(_AGAIN):
        improbable = _improbable(sets, best.peak)
        # values are those of the best explanation in which improbable faults are healthy
        held |= set(improbable)
        possible = [[name] for name in sets.distances if not sets.is_improbable(name)]
        groups = [sorted(held)] if improbable else possible
        tried = held_healthy(best.peak, groups, found.descent.aliases, threads)
        spent += tried.evaluations
        # better without one of them: the search had ended beside the best point
        if not improbable and tried.rises.min(initial=0.0) >= -WORTH:
            break
        again = replace(again, held={*again.held, *held})
        nearer = corrected(full, tried.point, again, like=best.peak.problem)
        spent += nearer.peak.evaluations
        noise = best.peak.problem.noise
        if not improbable and height(nearer.peak, noise) >= height(best.peak, noise):
            break
        best = with_model_error(nearer, threads)
        sets = sets_at(best, held)
    apart = _apart(best, others, own)
    if apart:
        around = [sets_at(one) for one in apart]
        rises = [risen(best.peak, one.peak) for one in apart]
        sets = FaultSets.over([sets, *around], [0.0, *rises])
    answers = [best, *apart]
    likely = np.argsort(-np.array(sets.minima), kind="stable").tolist()
    best = answers[likely[0]]
    peak = best.peak
    sharp = sharp_errors(peak, own, peak.problem.model_error)
    point = sets.points[likely[0]]
    values, intervals, covariance = _values(full, sets, point, own)
    return Assessment(
        values=values,
        covariance=covariance,
        sharp_errors=dict(zip(problem.names, sharp.tolist(), strict=True)),
        intervals=intervals,
        physical=in_physical_units(problem.unknowns, actuator, values, sets, intervals),
        contrasts=contrasts_of(model, actuator, values, sets),
        nuisances=_evident(full, point, intervals, own),
        strained=strained(peak),
        cost=cost,
        others=tuple(
            dict(zip(problem.names, answers[n].peak.point[:own].tolist(), strict=True))
            for n in likely[1:]
            if sets.minima[n] > 1.0 - CERTAIN
        ),
        evaluations=spent,
        trust=peak.problem.trust,
        reference_runs=best.rounds,
        scatter=best.scatter,
        cost_scatter=best.cost_scatter,
        unsettled=best.unsettled,
        joint=Joint(
            tuple(answers[n].peak for n in likely), peak.problem.model_error, own,
            peak.problem.comparisons[0].noise, _beside_density(best, baseline),
            found.descent.aliases,
        ),
        sets=sets,
    )  # fmt: skip


def unassessed(
    model: Model, actuator: ParameterSet, problem: Problem, found: Found, baseline: Baseline
) -> Assessment:
    """The assessment of an interrupted search: its values, with nothing certain."""
    values = problem.values(found.point)
    whole = {one.name: Interval(one.lower, one.upper) for one in problem.unknowns}
    return Assessment(
        values=values,
        covariance=np.diag(np.full(len(problem.names), np.inf)),
        sharp_errors=dict.fromkeys(problem.names, math.inf),
        intervals=whole,
        physical={
            one.name: physical_of(one, actuator, values[one.name], whole[one.name])
            for one in problem.unknowns
        },
        contrasts={},
        nuisances={},
        strained={},
        cost=found.cost,
        others=(),
        evaluations=0,
    )


def _with_scatter(found: Corrected, baseline: Baseline) -> np.ndarray:
    """The covariance with the discrepancy of the twin and the scatter of healthy recordings."""
    peak, covariance = found.peak, found.covariance
    widths, differ = peak.problem.chart.widths, scatter(baseline)
    for n, name in enumerate(peak.problem.names):
        if name in differ:
            covariance[n, n] += (differ[name] / widths[n]) ** 2
    return covariance


def _beside_density(found: Corrected, baseline: Baseline) -> dict[str, float]:
    """By fault, what its density lacks: the error of the model, scatter of healthy recordings."""
    peak, differ = found.peak, scatter(baseline)
    chart = peak.problem.chart
    errors = chart.standard_errors(peak.z, found.model_error + 0.0 * peak.covariance)
    return {
        one.name: math.hypot(differ.get(one.name, 0.0), error * (value if one.logarithmic else 1.0))
        for one, error, value in zip(chart.unknowns, errors, peak.point, strict=True)
        if one.role == "fault" and one.direction_of is None
    }


def scatter(baseline: Baseline) -> dict[str, float]:
    """By fault, how far a healthy recording may be found off healthy."""
    more = math.sqrt(1.0 + 1.0 / max(1, baseline.recordings))
    return {name: more * value for name, value in baseline.scatter.items()}


def _sets(
    found: Corrected, baseline: Baseline, held: Collection[str], aliases: Aliases | None
) -> FaultSets:
    """The posterior of sets of faults around a peak.

    Parameters
    ----------
    held : names of faults that are held healthy at the peak
    aliases : as of `Descent`; what multiplies faults is known to its mean until these are drawn
    """
    peak = found.peak
    problem, factor = peak.problem, peak.problem.model_error
    covariance = _with_scatter(found, baseline)
    values = problem.values(peak.point)
    factors = [
        one
        for one in (aliases(values) if aliases else ())
        if one.multiplies and one.pivot in problem.names
    ]
    given = [problem.names.index(one.pivot) for one in factors]
    alone = covariance[np.ix_(given, given)]
    follows = np.linalg.solve(alone, covariance[given])
    covariance = covariance - covariance[:, given] @ follows
    covariance[np.ix_(given, given)] = alone
    mean = peak.unbounded(factor, held)
    mean = mean + (peak.z - mean)[given] @ follows
    sets = fault_sets(problem.chart, mean, covariance, peak.z)
    for one in factors:
        sets = sets.multiplied(one, values[one.pivot])
    return sets


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
    full: Problem, sets: FaultSets, point: np.ndarray, own: int
) -> tuple[dict[str, float], dict[str, Interval], np.ndarray]:
    """Values and intervals by name, and the covariance (own, own) of the unknowns of the search.

    Intervals of faults are conditional on their presence. Deviations of a logarithmic unknown are
    of the logarithm, scaled such that a value is as many standard errors from healthy as its
    logarithm is: halved and doubled are equally far. The covariance is infinite for a direction
    that has no meaning, and for a value that may be anything.
    """
    values, intervals, errors = full.values(point), {}, []
    for one in full.unknowns:
        given = sets.given(one.direction_of or one.name)
        is_fault = one.role == "fault" and one.direction_of is None
        intervals[one.name] = Interval(
            *sets.interval(one, values[one.name])
            if is_fault
            else given.interval(one.name, one.lower, one.upper)
        )
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
    full: Problem, point: np.ndarray, intervals: Mapping[str, Interval], own: int
) -> dict[str, tuple[float, Interval]]:
    """Load and sensors that are clearly not as recorded."""
    found = {}
    for n, one in enumerate(full.unknowns):
        if n < own or one.role != "nuisance":
            continue
        low, high = intervals[one.name]
        if one.spread is None or low <= one.healthy <= high:
            continue  # draws are as wide as the prior where the twin explains nothing
        value, reach = float(point[n]), 0.5 * (high - low) / COVERAGE
        if abs(value - one.healthy) > max(SIGMAS * reach, 0.5 * one.spread):
            found[one.name] = (value, Interval(min(low, value), max(high, value)))
    return found


def _apart(best: Corrected, others: Sequence[Corrected], own: int) -> list[Corrected]:
    """Other minima that count: each apart from those before it, and not far less dense."""
    found: list[Corrected] = []
    for one in others:
        away = [np.abs(one.peak.z - it.peak.z)[:own].max() for it in (best, *found)]
        if min(away) > APART and risen(best.peak, one.peak) < 2.0 * WINDOW:
            found.append(one)
    return found
