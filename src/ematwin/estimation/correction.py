"""Minima of the reference model, by a fast model that is corrected at the best point so far.

A search needs thousands of answers, and only a fast model gives so many. Its difference from the
reference model changes little from one point to the next, so it is taken off the recording at the
minimum of the fast model, and the minimum is looked for again,

    x_{k+1} = argmin_x | y - [f(x) + R(x_k) - f(x_k)] |^2,

until it stays where it is: defect correction (Boehmer, Hemker and Stetter 1984, Computing Suppl. 5,
1-32), in design known as space mapping (Bandler et al. 2004, IEEE Trans. Microw. Theory Tech. 52,
337-361). Each round takes one answer of the reference model for each recording.

Where R - f changes with x the rounds converge slowly, or not at all. Then the last ones are
combined to the point from which a round would lead nowhere, if rounds were linear (Anderson 1965,
J. ACM 12, 547-560, with steps measured in standard errors). Behind loops that the fast model lacks
its slopes may be wrong too. Where equations along the motion show every fault, the peak is theirs,
and the reference only checks it. Else, where rounds end with more than noise, R - f is
regressed on steps whose effect is as large as the remaining residual, rounds follow, and so on
until it falls no more; then on steps as wide as the peak.

The truth lies elsewhere within the width of the minimum, where the error of the model differs:
impacts, ripple and slopes change. With J the slopes of the residuals r, noise s and
covariance C, a correction at a point v in place of the minimum x moves the minimum by

    C J^T ([R(v) - f(v)] - [R(x) - f(x)]) / s^2

in the first order. `with_model_error` measures that at points drawn from the width: the error of
the model in this answer. The residual beyond noise and this scatter is a discrepancy, and counts by
the kind's `Problem.model_error`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ematwin.estimation.constants import AS_GOOD
from ematwin.estimation.corrected_problem import (
    corrected_at,
    exact_residuals,
    missed_by,
    reference_scatter,
)
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import (
    Laplace,
    followed,
    laplace,
    principal,
)
from ematwin.estimation.noise import with_channels_reweighed, with_discrepancy
from ematwin.estimation.problem import Problem
from ematwin.numerics.side_by_side import side_by_side

_ROUNDS = 10  # at most
_STAYS = 0.25  # standard errors: adds 3 % to an error that it widens
_NEAR = 1.0  # standard errors, within which scatter of the reference may be all that moves a peak
_SHRINKS = 0.5  # of the step before: less is progress
_DEPTH = 3  # rounds that are combined
_IN_VAIN = 3  # rounds in succession that do not lower the cost by a reference that scatters
_WIDEST = 0.1  # of a range: steps of slopes at most, where little is known before
_REGRESSIONS = 6  # at most
_ELSEWHERE = 6  # points within the width at which the error of the model is measured


@dataclass(frozen=True)
class Corrected:
    """A peak of the posterior by the reference model.

    Attributes
    ----------
    peak : Laplace, of the problem as it was corrected last
    rounds : int, answers of the reference model for each recording; 0 where the kind has none
    left : (m, d) array, how far the last round moved the peak, in coordinates of the chart; the
        last few, where rounds came to no end
    model_error : (d, d) array, covariance from the model error elsewhere within the width
    scatter : float, relative misfit by which answers of the reference differ from one to the next
    cost_scatter : float, standard deviation of the cost of the data within the width
    """

    peak: Laplace
    rounds: int
    left: np.ndarray
    model_error: np.ndarray | float = 0.0
    scatter: float = 0.0
    cost_scatter: float = 0.0

    @property
    def covariance(self) -> np.ndarray:
        """(d, d), with the model error."""
        sharp = self.peak.widened(self.peak.problem.model_error)
        return sharp + self.left.T @ self.left + self.model_error

    @property
    def unsettled(self) -> tuple[str, ...]:
        """Names of coordinates that the last round moved by more than a standard error."""
        far = np.abs(self.left[-1]) > _NEAR * np.sqrt(np.diag(self.peak.covariance))
        return tuple(np.array(self.peak.problem.names)[far].tolist())


def corrected(
    problem: Problem,
    start: np.ndarray,
    descent: Descent,
    *,
    information: np.ndarray | None = None,
    like: Problem | None = None,
) -> Corrected:
    """The peak next to a point: of the reference model where the kind has one.

    Parameters
    ----------
    problem : not corrected
    start : (d,) array, values, from which the first round descends
    descent : its settings; later rounds begin in the basin that it found. Its least noise counts
        where it exceeds the noise of the corrected problem
    information : (d, d) array, as of `laplace`, for the first round
    like : corrected near another point of the same recordings: its slopes of the reference serve
        here too

    Raises
    ------
    TooFarError
        If the descent raises it.
    """
    chart = problem.chart
    z = chart.project(chart.from_values(start[None]))[0]
    if problem.is_told and (answer := exact_residuals(problem, start)) is not None:
        return _along_motion(problem.with_answer(answer), z, descent)
    here = corrected_at(problem, start, like)
    if here is None:
        return Corrected(
            laplace(problem, start, descent, information=information), 0, np.zeros((1, len(z)))
        )
    visited = _rounds(problem, here, z, descent, information)
    last = _lowest(visited) if problem.lacks_forms else visited[-1]
    spent = sum(one.peak.evaluations for one in visited)
    end = Corrected(replace(last.peak, evaluations=spent), last.runs, last.left)
    if problem.lacks_forms and like is None:
        return _by_regression(problem, descent.afresh(settled=np.inf), last, end)
    return end


def _along_motion(here: Problem, z: np.ndarray, descent: Descent) -> Corrected:
    """The peak of priors and equations, with the reference's residuals there.

    From coordinates (d,) at which ``here`` is answered. The closed loop does not move it.
    """
    runs = 1
    while True:
        peak = laplace(here, here.chart.to_values(z[None])[0], descent)
        moved = peak.z - z
        near = np.abs(moved) <= _STAYS * np.sqrt(np.diag(peak.covariance))
        answer = None if near.all() or runs == _ROUNDS else exact_residuals(here, peak.point)
        if answer is None:
            return Corrected(peak, runs, moved[None])
        here, z, runs = here.with_answer(answer), peak.z, runs + 1


def _by_regression(
    problem: Problem, descent: Descent, near: "_Round", found: Corrected
) -> Corrected:
    """The peak by regressions of the reference, from where rounds ended.

    The effect of a step is as large as the remaining residual: so far off the unknowns may be, and
    scatter of the reference hides slopes over shorter steps. Rounds lead from one regression to the
    next. They end where the residual is noise, or falls no more: costs scatter by a tenth from one
    answer to the next. Over such steps the reference curves, which seems to tell alike unknowns
    apart. So a last regression, as wide as the peak, gives the peak and its width.
    """
    first, spent, asked = near.here, found.peak.evaluations, found.rounds
    peak = found.peak
    for _ in range(_REGRESSIONS):
        if near.here.relative_misfit(near.cost) <= AS_GOOD * near.here.recorded_misfit:
            break
        wide = near.peak.information * near.peak.problem.noise**2 / near.cost
        ways = principal(wide, near.peak.z, problem.chart.lower, problem.chart.upper, _WIDEST)
        here = corrected_at(problem, near.peak.point, near.here, ways)
        if here is None:
            break
        visited = _rounds(problem, here, near.peak.z, descent, near.peak.information)
        spent += sum(one.peak.evaluations for one in visited)
        asked += 2 * len(ways) + visited[-1].runs
        lowest, near = near.cost, _lowest(visited)
        if near.cost < lowest:
            peak = near.peak
        if len(visited) == 1 or near.cost > 0.9 * lowest:
            break
    if asked == found.rounds:
        return found
    left = found.left
    ways = principal(peak.information, peak.z, problem.chart.lower, problem.chart.upper, _WIDEST)
    if here := corrected_at(problem, peak.point, first, ways):
        noise = max(here.noise, descent.least_noise)
        settings = replace(descent, least_noise=noise)
        last = laplace(here, peak.point, settings, information=peak.information)
        left = (last.z - peak.z)[None]
        spent, asked, peak = spent + last.evaluations, asked + 2 * len(ways), last
    return replace(found, peak=replace(peak, evaluations=spent), left=left, rounds=asked)


@dataclass(frozen=True)
class _Round:
    """A round of the correction.

    Attributes
    ----------
    z : (d,) array, coordinates where it began
    here : Problem, corrected there
    peak : Laplace, to which it led
    left : (m, d) array, how far the round, or the last few that came to no end, moved the peak
    runs : int, answers of the reference until then
    """

    z: np.ndarray
    here: Problem
    peak: Laplace
    left: np.ndarray
    runs: int

    @cached_property
    def cost(self) -> float:
        """Of the data where it began, by the reference."""
        left = self.here.residuals(self.here.chart.to_values(self.z[None]))[0]
        return self.here.data_cost(left)


def _lowest(visited: list[_Round]) -> _Round:
    """The round with the lowest cost by the reference, as the end of all of them."""
    lowest, last = min(visited, key=lambda one: one.cost), visited[-1]
    settled = len(last.left) == 1
    return replace(lowest, runs=last.runs, left=lowest.left if settled else last.left)


def _rounds(
    problem: Problem, here: Problem, z: np.ndarray, descent: Descent, information: np.ndarray | None
) -> list[_Round]:
    """Rounds from coordinates (d,) at which ``here`` is corrected, until the peak stays."""
    chart, least, smooth = problem.chart, descent.least_noise, problem.is_smooth
    found: list[_Round] = []
    moved = np.inf
    tried: Problem | None = here
    for runs in range(1, _ROUNDS + 1):
        point = chart.to_values(z[None])[0]
        if found:
            tried = corrected_at(problem, point, here)
        if tried is None:  # the reference diverged: half way back
            z = 0.5 * (z + found[-1].z)
            continue
        here = tried
        noise, before = max(here.noise, least), moved
        # slopes of a smooth misfit hold from one round to the next: taken anew where it stays
        for whole in (False, True) if smooth and found and runs < _ROUNDS else (True,):
            if whole:
                peak = laplace(
                    here, point, replace(descent, least_noise=noise), information=information
                )
                descent, information = descent.afresh(settled=np.inf), peak.information
            else:
                peak = followed(found[-1].peak, here, z, descent.held)
                point = peak.point
            errors = np.sqrt(np.diag(peak.covariance))
            moved = float((np.abs(peak.z - z) / errors).max())
            # impacts and ripple of the reference scatter: nearer than that rounds do not come
            ends = moved <= _STAYS or _SHRINKS * before < moved <= _NEAR
            if not ends:
                break
        known = [*((one.z, one.peak.z - one.z) for one in found), (z, peak.z - z)]
        left = np.array([step for _, step in known[-1 if ends else -_DEPTH :]])
        found.append(_Round(z, here, peak, left, runs))
        if ends or (problem.lacks_forms and _in_vain(found)):
            break
        z = chart.project(_combined(known[-_DEPTH - 1 :], errors)[None])[0]
    return found


def _in_vain(found: list[_Round]) -> bool:
    """Whether the last rounds have not lowered the cost by the reference."""
    costs = [one.cost for one in found]
    return len(costs) > _IN_VAIN and min(costs[-_IN_VAIN:]) >= min(costs[:-_IN_VAIN])


def reweighed(found: Corrected, descent: Descent) -> Corrected:
    """The minimum next to another, with each channel weighed by the residual there.

    ``descent`` is as of `corrected`.
    """
    peak = found.peak
    problem = with_channels_reweighed(peak.problem, peak.point)
    if problem is None:
        return found
    near = descent.afresh(settled=np.inf, least_noise=problem.least_noise)
    end = corrected(problem, peak.point, near, information=peak.information)
    spent = peak.evaluations + end.peak.evaluations
    return replace(end, peak=replace(end.peak, evaluations=spent), rounds=found.rounds + end.rounds)


def with_model_error(found: Corrected, threads: int | None = None) -> Corrected:
    """The same minimum, with the error that the model has within its width.

    The answers of the reference are made side by side, on one thread for each core if not given.
    """
    if not found.rounds:
        return found
    peak = found.peak
    problem, chart = peak.problem, peak.problem.chart
    draws = np.random.default_rng(0).standard_normal((_ELSEWHERE, len(peak.z)))
    there = chart.project(peak.z + draws @ np.linalg.cholesky(peak.covariance).T)

    values = chart.to_values(there)
    known = side_by_side(lambda point: missed_by(problem, point), values, threads)
    changes = np.array([one for one in known if one is not None])
    if not len(changes):
        return found
    moved = changes @ peak.jacobian.T @ peak.covariance / problem.noise**2
    error = moved.T @ moved / len(moved)
    scatter = float(np.median([problem.data_cost(change) for change in changes]))
    nearer = replace(peak, problem=with_discrepancy(problem, peak.cost, scatter))
    ripple = 0.0
    if problem.is_told:
        ripple = problem.relative_misfit(scatter)
    elif problem.lacks_forms:  # the closed loop decides
        ripple = reference_scatter(problem, peak.point)
    costs = [problem.data_cost(peak.residuals + change) for change in changes]
    return replace(
        found, peak=nearer, model_error=error, scatter=ripple,
        cost_scatter=float(np.std(costs)), rounds=found.rounds + len(moved),
    )  # fmt: skip


def _combined(known: list[tuple[np.ndarray, np.ndarray]], errors: np.ndarray) -> np.ndarray:
    """The point (d,) from which a round would lead nowhere, by secants through the last ones."""
    z, step = known[-1]
    if len(known) == 1:
        return z + step
    moved = np.array([z - before for before, _ in known[:-1]])
    changed = np.array([step - before for _, before in known[:-1]])
    shares = np.linalg.lstsq((changed / errors).T, step / errors, rcond=1e-3)[0]
    return z + step - shares @ (moved + changed)
