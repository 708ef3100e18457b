"""The minima of a problem in which everything is free, from where a search ended.

A search holds all parameters at the values of the file. Here they are freed, each with its
prior, with the sensors and the load. All descend together from where the search ended, from where
its other descents ended, and if that fails, from other loads. The minima are refined with the
reference model (`ematwin.estimation.correction`).

A descent of everything together begins at the means of the priors. Where an unknown makes the
twin stick at other places of the motion, as an unrecorded load does, that start may lie next to
another minimum than the true one, and other parameters take up the effect of stiction. So such an
unknown, which its prior alone holds, is held at values all over its prior while everything else
descends from the same place, all starts as one batch of the lanes; then once more near the best of
them; then it is free. A start that is soon far behind is given up.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.aliases import aliases_of, held_by
from ematwin.estimation.along_motion import informed
from ematwin.estimation.baseline import Baseline, frees_parameters, with_all_free
from ematwin.estimation.constants import APART, AS_GOOD, HOPELESS, IMPLAUSIBLE, SEARCHED, WORST
from ematwin.estimation.correction import Corrected, corrected, reweighed
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import Laplace, laplace
from ematwin.estimation.levenberg_marquardt import NOTHING, LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

_RATIO = 4.0  # of costs, up to which another end of the search is descended from
_KNOWN, _BY_SHEET = 5, 10  # iterations from there: parameters have yet to leave the sheet's
_FAR = 100.0  # squared standard deviations by which a minimum is no rival any more
_BEHIND = 4.0  # times the least cost: a start so far behind does not win, 1.7 times did


@dataclass(frozen=True)
class Minima:
    """The best minimum of a problem, and others."""

    problem: Problem  # with everything free, weighed by the residuals of the best minimum
    best: Corrected
    others: Sequence[Corrected]  # by how far they lie from the recording and the priors
    descent: Descent  # how they were found
    cost: float  # of the data at the best one, as the search weighs them
    evaluations: int


def minima(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    end: Found,
    baseline: Baseline,
    threads: int | None = 1,
) -> Minima:
    """The minima next to the end of a search; arguments as of `assess`."""
    full = with_all_free(model, actuator, problem, baseline, end.problem)
    still = set() if frees_parameters(model) else set(baseline.prior.names) & set(full.names)
    measured = math.isfinite(baseline.misfit)
    healthy = baseline.misfit if measured else full.recorded_misfit
    settled, iterations = AS_GOOD * healthy, _KNOWN if measured else _BY_SHEET
    if baseline.exact:
        settled, iterations = math.inf, _KNOWN

    ends = (end.point, *_worth_a_look(full, end, problem))
    starts = [_placed(full, problem, point) for point in ends]
    if along := informed(model, actuator, full, starts[0]):  # which has one minimum
        full, starts = along[0], [along[1]]
    descent = Descent(
        aliases_of(model, actuator, full, starts[0]), still,
        full.least_noise, settled=settled, iterations=iterations,
    )  # fmt: skip

    def peak_from(point: np.ndarray) -> Corrected:
        return corrected(full, point, descent)

    def beside_it(near: Corrected, anew: bool = False) -> list[Corrected]:
        near_it = descent.afresh(settled=math.inf)
        return [
            corrected(full, one.point, near_it, like=near.peak.problem)
            for one in other_minima(near.peak, descent, anew)
        ]

    # each may use all cores: most of its batches are one block
    best, *others = side_by_side(peak_from, starts, threads)
    misfit = full.relative_misfit(min(one.peak.cost for one in (best, *others)))
    usual = max(healthy, best.peak.problem.recorded_misfit)
    explained = full.relative_misfit(best.peak.cost) <= AS_GOOD * usual
    # equations have one minimum; and from further off no other load has led to a verdict
    doubtful = not full.is_told and (strained(best.peak) or not explained)
    if misfit <= WORST and doubtful:
        others += beside_it(best)
        noise = best.peak.problem.noise
        nearest = min((best, *others), key=lambda one: height(one.peak, noise))
        if strained(nearest.peak):
            others += beside_it(nearest, anew=True)
    spent = sum(one.peak.evaluations for one in (best, *others))
    noise = min(one.peak.problem.noise for one in (best, *others))
    others.sort(key=lambda one: height(one.peak, noise))
    if others and height(others[0].peak, noise) < height(best.peak, noise):
        others.append(best)
        best = others.pop(0)
    cost = best.peak.cost
    weighed = reweighed(best, descent)
    if weighed is not best:  # all that follows is compared by the same weights
        near = [one.peak.point for one in others if risen(best.peak, one.peak) < _FAR]
        best, full, noise = weighed, weighed.peak.problem, weighed.peak.problem.noise
        near_it = descent.afresh(settled=math.inf, least_noise=noise)
        others = [corrected(full, point, near_it, like=full) for point in near]
        spent += sum(one.peak.evaluations for one in (best, *others))
    return Minima(full, best, others, descent, cost, spent)


def _placed(full: Problem, problem: Problem, point: np.ndarray) -> np.ndarray:
    """The point (d,) of a problem in which more is free: all that was not searched as known."""
    known = dict(zip(problem.names, point.tolist(), strict=True))
    return np.array([known.get(one.name, one.healthy) for one in full.unknowns])


def _worth_a_look(full: Problem, found: Found, problem: Problem) -> list[np.ndarray]:
    """Ends of other descents that are not far worse and lie apart; none if nothing explains it."""
    if not found.others:
        return []
    judged = found.problem or problem
    points = np.stack([found.point, *found.others])
    costs = judged.costs(points)
    if judged.relative_misfit(costs[0]) > HOPELESS:
        return []
    near = 1 + np.argsort(costs[1:], kind="stable")[:2]  # other ends that are descended from
    points, costs = points[np.r_[0, near]], costs[np.r_[0, near]]
    apart = np.abs(judged.chart.from_values(points) - judged.chart.from_values(points[:1]))
    return [
        point
        for point, cost, away in zip(points[1:], costs[1:], apart[1:].max(axis=1), strict=True)
        if away > APART and cost < _RATIO * costs[0]
    ]


def height(peak: Laplace, noise: float, informed: bool = True) -> float:
    """How far a peak lies from the recording and from the priors, squared standard deviations.

    Not ``informed`` leaves out knowledge beside priors (`Problem.informed`). Where that tells all
    of the recording, the closed loop does not count.
    """
    distances = peak.problem.prior_distances(peak.point[None], informed)[0] / peak.problem.noise
    if peak.problem.is_told and informed:
        return float(distances @ distances)
    data = (peak.cost + peak.evidence) / noise**2
    return data + float(distances @ distances)


def risen(first: Laplace, other: Laplace) -> float:
    """How much higher the second peak lies, squared standard deviations.

    Costs at the two minima scatter with impacts and ripple, by a tenth from one answer
    of the reference to the next, where noise alone would have them differ by far less: so all that
    a fast model misses counts as noise here. Of equations along the motion no more counts than the
    peak that explains more leaves.
    """
    noise = first.problem.comparisons[0].model_error * min(first.problem.noise, other.problem.noise)
    mine, its = first.problem.information, other.problem.information
    if mine is None or its is None:
        return height(other, noise, False) - height(first, noise, False)
    return height(other, noise) - height(first, noise) - mine.beyond(its)


def strained(peak: Laplace) -> dict[str, float]:
    """Parameters, load and sensors that are implausible, in standard deviations of their priors."""
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


def other_minima(peak: Laplace, descent: Descent, anew: bool = False) -> list[Laplace]:
    """Other local minima of the same problem, one for each unknown that has several.

    Unknowns that the ``descent`` to the peak held stay. ``anew`` is for where that did not help:
    parameters begin at the means of their priors, for their values belong to the wrong minimum, and
    none is held.
    """
    problem, found, held = peak.problem, [], set(descent.held)
    loose = {one.name for one in problem.unknowns if anew and one.role == "nominal"} - held
    start = np.array([
        one.healthy if one.name in loose else value
        for one, value in zip(problem.unknowns, peak.point, strict=True)
    ])  # fmt: skip
    for one in problem.unknowns:
        if one.spread is None or one.valleys == 1 or one.name in held:
            continue
        point, middle, reach, spent = start, one.healthy, SEARCHED * one.spread, 0
        for wide in (True, False):
            still = (held_by(problem, point, descent.aliases) | held) - loose
            point, more = _across(problem, point, one, middle, reach, still, wide)
            middle = float(point[problem.names.index(one.name)])
            reach, spent = 2.0 * reach / (one.valleys - 1), spent + more
        end = laplace(problem, point, descent.afresh())
        found.append(replace(end, evaluations=end.evaluations + spent))
    return found


def _across(
    problem: Problem,
    start: np.ndarray,
    along: Unknown,
    middle: float,
    reach: float,
    still: Collection[str],
    wide: bool,
) -> tuple[np.ndarray, int]:
    """The lowest of descents from ``start`` (d,) with an unknown held all over a range.

    And the simulations that they took. Unknowns in ``still`` stay; ``wide`` ones descend on the
    smoothed misfit first.
    """
    names = list(problem.names)
    known = dict(zip(names, start.tolist(), strict=True))
    small = problem.holding({name: known[name] for name in still}) if still else problem
    chart, place = small.chart, small.names.index(along.name)
    points = np.tile([known[name] for name in small.names], (along.valleys, 1))
    points[:, place] = np.clip(
        middle + np.linspace(-reach, reach, along.valleys), along.lower, along.upper
    )
    z, spent = chart.project(chart.from_values(points)), 0
    least = NOTHING * small.noise**2
    low, high = (np.tile(end, (along.valleys, 1)) for end in (chart.lower, chart.upper))
    low[:, place] = high[:, place] = z[:, place]
    stages = [(small.smoothed(), 5)] if wide else []  # problem and iterations
    for seen, iterations in (*stages, (small.coarse(), 8)):

        def residuals(at: np.ndarray, seen: Problem = seen) -> np.ndarray:
            nonlocal spent
            spent += len(at)
            return seen.residuals(chart.to_values(at))

        descent = LevenbergMarquardt.start(z, residuals, least=least)
        for _ in range(iterations):
            descent.iterate(residuals, low, high, chart.project)
            costs = descent.costs
            near = costs <= _BEHIND * costs.min()
            descent.finished |= ~near
        z, low, high = (x[near] for x in (descent.points, low, high))
    best = chart.project(descent.best(1).points)
    values = small.values(chart.to_values(best)[0])
    return np.array([values[name] for name in names]), spent
