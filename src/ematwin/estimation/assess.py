"""From the end of a search to values with honest intervals.

A search holds all parameters at the values of the file. Here they are freed, each as far as it is
known, with the sensors and the load, and all descend together from where the search ended; then
the curvature, the aliases and the drifts give the intervals. Before these are believed, other
valleys that the search found are compared, and the misfit is looked at along each fault.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.aliases import aliases_of
from ematwin.estimation.baseline import Baseline, frees_parameters, with_all_free
from ematwin.estimation.constants import (
    ANYTHING,
    AS_GOOD,
    COVERAGE,
    DECIDES,
    HOPELESS,
    IMPLAUSIBLE,
    SIGMAS,
    WORTH,
)
from ematwin.estimation.correction import Corrected, corrected, reweighed, with_model_error
from ematwin.estimation.descent import Descent
from ematwin.estimation.held_healthy import held_healthy
from ematwin.estimation.intervals import (
    Draws,
    Interval,
    contrasts_of,
    draws,
    in_physical_units,
    mean_slope,
    with_corner,
)
from ematwin.estimation.joint import Joint
from ematwin.estimation.laplace import Laplace, profiled, sharp_errors
from ematwin.estimation.other_minima import other_minima
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.estimation.significance import is_present
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
    drawn : draws from that width within the bounds; None after an interruption
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
    drawn: Draws | None = None


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
    for left in reversed(range(_ANEW)):
        values = full.values(best.peak.point)
        drawn = _drawn(best, own, baseline)
        covariance = _covariance_of(drawn, problem, values)
        named = _named(problem, values, np.sqrt(np.diag(covariance)))
        sharp = sharp_errors(best.peak, own, best.peak.problem.model_error)
        excused = [name for name in _named(problem, values, sharp) if name not in named]
        groups = [[name] for name in named] + ([excused] if excused else [])
        tried = held_healthy(best.peak, groups, threads)
        spent += tried.evaluations
        if not left or tried.rises.min(initial=0.0) > -WORTH:
            break
        # better without one of them: the search had ended beside the best point
        again = descent.afresh(settled=math.inf, least_noise=full.comparisons[0].noise)
        nearer = corrected(full, tried.point, again)
        spent += nearer.peak.evaluations
        if not height(nearer.peak, noise) < height(best.peak, noise):
            break
        best = with_model_error(nearer, threads)
    peak, rivals = best.peak, [one.peak for one in others]
    wider = peak.problem.model_error
    errors = dict(zip(problem.names, sharp.tolist(), strict=True))
    free = {one.name: one for one in full.unknowns}
    intervals = {
        name: Interval(*drawn.interval(name, one.lower, one.upper)) for name, one in free.items()
    }
    for name, error in errors.items():
        ends = with_corner((intervals[name].low, intervals[name].high), error, free[name])
        intervals[name] = Interval(*ends)
    for name, rise in zip(named, tried.rises[: len(named)].tolist(), strict=True):
        apart = math.sqrt(max(1.0, rise))  # standard errors from healthy
        error = abs(values[name] - free[name].healthy) / apart
        error = math.hypot(error, scatter(baseline).get(name, 0.0))
        covariance = _widened(covariance, problem.names.index(name), error)
        old, end = intervals[name], _towards_healthy(free[name], values[name], COVERAGE / apart)
        intervals[name] = Interval(min(old.low, end), max(old.high, end))
    return Assessment(
        values=values,
        covariance=covariance,
        sharp_errors=errors,
        intervals=intervals,
        physical=in_physical_units(problem, actuator, values, drawn, intervals),
        contrasts=contrasts_of(model, actuator, values, drawn),
        nuisances=_evident(full, peak, intervals, own),
        strained=_strained(peak),
        cost=cost,
        others=_other_answers(problem, peak, rivals),
        evaluations=spent,
        trust=peak.problem.trust,
        reference_runs=best.rounds,
        unsettled=best.unsettled,
        joint=Joint(
            (peak, *rivals), wider, own, peak.problem.comparisons[0].noise, scatter(baseline)
        ),
        drawn=drawn,
    )


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


def _drawn(found: Corrected, own: int, baseline: Baseline) -> Draws:
    """Draws of all that is free around a peak; the first ``own`` unknowns were searched."""
    peak = found.peak
    covariance = _with_scatter(found, baseline)
    covariance = profiled(peak, covariance, range(own), peak.problem.model_error, _REACHES)
    return draws(peak.problem.chart, peak.z, covariance)


def _covariance_of(drawn: Draws, problem: Problem, values: Mapping[str, float]) -> np.ndarray:
    """(d, d) of the searched unknowns, in the unit of their deviations from healthy.

    Of a logarithmic unknown it is that of the logarithm, scaled such that ``values`` are as many
    standard errors from healthy as their logarithms are: halved is as far off as doubled. Infinite
    for a direction that has no meaning, and for a value that may be anything.
    """
    away = drawn.values[:, : len(problem.names)].copy()
    lost = []
    for n, one in enumerate(problem.unknowns):
        value = values[one.name]
        if one.direction_of is not None:
            turn = np.exp(2j * np.pi * away[:, n])
            away[:, n] = np.angle(turn / np.exp(1j * np.angle(turn.mean()))) / (2.0 * np.pi)
            if abs(turn.mean()) < 0.3:
                lost.append(n)
        elif one.logarithmic:
            away[:, n] = mean_slope(value, one.healthy) * np.log(away[:, n] / value)
    found = np.atleast_2d(np.cov(away.T))
    for n, one in enumerate(problem.unknowns):
        if one.name in drawn.directions.values():  # the length of a vector is found too long
            found[n, n] = float(np.mean((away[:, n] - values[one.name]) ** 2))
    widths = problem.upper - problem.lower
    for n, one in enumerate(problem.unknowns):
        if one.role == "fault" and math.sqrt(found[n, n]) > ANYTHING * widths[n]:
            lost.append(n)
    for n in lost:
        found[n, :] = found[:, n] = 0.0
        found[n, n] = np.inf
    return found


def _named(problem: Problem, values: Mapping[str, float], errors: np.ndarray) -> tuple[str, ...]:
    """Faults that lie further from healthy than their standard errors (d,) make likely."""
    return tuple(
        one.name
        for one, error in zip(problem.unknowns, errors, strict=True)
        if one.role == "fault" and one.direction_of is None
        and is_present(values[one.name] - one.healthy, one.width, error)
    )  # fmt: skip


def _widened(covariance: np.ndarray, n: int, error: float) -> np.ndarray:
    """The covariance (d, d) where the standard error of one unknown is at least ``error``."""
    found = covariance.copy()
    wider = max(1.0, error / math.sqrt(covariance[n, n]))
    found[n, :] *= wider
    found[:, n] *= wider
    return found


def _towards_healthy(one: Unknown, value: float, share: float) -> float:
    """The value a share of the way to healthy and beyond, within the bounds."""
    if one.logarithmic:
        end = value * (one.healthy / value) ** share
    else:
        end = value + share * (one.healthy - value)
    return min(max(end, one.lower), one.upper)


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
