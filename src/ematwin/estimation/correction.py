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
J. ACM 12, 547-560, with steps measured in standard errors). Where the fast model lacks forms of the
actuator, that leads from afar to other points; `_nearer` comes first.

The truth lies elsewhere within the width of the minimum, where the error of the fast model differs:
impacts, ripple and slopes change. With J the slopes of the residuals r, noise s and
covariance C, a correction at a point v in place of the minimum x moves the minimum by

    C J^T ([R(v) - f(v)] - [R(x) - f(x)]) / s^2

in the first order. `with_model_error` measures that at points drawn from the width: the error of
the model in this answer. The residual beyond noise and this scatter is a discrepancy, and counts by
the kind's `Problem.model_error`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.corrected_problem import corrected_at, with_secants
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import Laplace, laplace, step_lengths
from ematwin.estimation.noise import with_channels_reweighed, with_discrepancy
from ematwin.estimation.problem import Problem
from ematwin.numerics.side_by_side import side_by_side

ROUNDS = 10  # at most
_STAYS = 0.25  # standard errors: adds 3 % to an error that it widens
_NEAR = 1.0  # standard errors, within which scatter of the reference may be all that moves a peak
_SHRINKS = 0.5  # of the step before: less is progress
_DEPTH = 3  # rounds that are combined
_FALLS = 0.9  # of the cost before: less is progress, from afar
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
    """

    peak: Laplace
    rounds: int
    left: np.ndarray
    model_error: np.ndarray | float = 0.0

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
    steps: np.ndarray | None = None,
    rounds: int = ROUNDS,
) -> Corrected:
    """The peak next to a point: of the reference model where the kind has one.

    Parameters
    ----------
    problem : not corrected
    start : (d,) array, values, from which the first round descends
    descent : its settings; later rounds begin in the basin that it found. Its least noise counts
        where it exceeds the noise of the corrected problem
    steps : (d,) array, as of `laplace`, of the first round
    rounds : at most

    Raises
    ------
    TooFarError
        If the descent raises it.
    """
    chart = problem.chart
    z = chart.project(chart.from_values(start[None]))[0]
    spent = 0
    begins_afar = math.isfinite(descent.settled)
    if problem.lacks_forms and begins_afar and not problem.is_informed:
        z, descent, steps, spent = _nearer(problem, z, descent, steps)
    known: list[tuple[np.ndarray, np.ndarray]] = []  # where rounds began, and how far they led
    nearer: Problem | None = None
    moved, many, least = np.inf, _DEPTH, descent.least_noise
    for _ in range(rounds):
        point = chart.to_values(z[None])[0]
        tried = corrected_at(problem, point, nearer)
        if tried is None and known:  # the reference diverged: half way back
            z = 0.5 * (z + known[-1][0])
            continue
        nearer = tried
        if nearer is None:
            return Corrected(
                laplace(problem, start, descent, steps=steps), 0, np.zeros((1, len(z)))
            )
        peak = laplace(
            nearer, point, replace(descent, least_noise=max(nearer.noise, least)), steps=steps
        )
        descent, steps = descent.afresh(settled=np.inf), step_lengths(peak.covariance)
        spent += peak.evaluations
        known.append((z, peak.z - z))
        errors = np.sqrt(np.diag(peak.covariance))
        before, moved = moved, float((np.abs(known[-1][1]) / errors).max())
        # impacts and ripple of the reference scatter: nearer than that rounds do not come
        if moved <= _STAYS or _SHRINKS * before < moved <= _NEAR:
            many = 1
            break
        z = chart.project(_combined(known[-_DEPTH - 1 :], errors)[None])[0]
    left = np.array([step for _, step in known[-many:]])
    return Corrected(replace(peak, evaluations=spent), len(known), left)


def _nearer(
    problem: Problem, z: np.ndarray, descent: Descent, steps: np.ndarray | None
) -> tuple[np.ndarray, Descent, np.ndarray | None, int]:
    """Coordinates (d,) nearer to a peak by the reference, from afar.

    Secants of the residuals follow the error of the fast model as it changes (manifold mapping;
    Echeverria and Hemker 2005, Comput. Methods Appl. Math. 5, 107-136). Close to a peak they follow
    the scatter of the reference: they end where the misfit falls no further.
    """
    chart, spent, cost = problem.chart, 0, np.inf
    errors = np.ones(len(z))
    seen: list[tuple[np.ndarray, Problem]] = []
    here: Problem | None = None
    for _ in range(ROUNDS):
        point = chart.to_values(z[None])[0]
        here = corrected_at(problem, point, here)
        before, cost = cost, np.inf
        if here is not None:
            cost = here.data_cost(here.residuals(point[None])[0])
        if here is None or cost > _FALLS * before:
            if seen and cost >= before:
                z = seen[-1][0]
            break
        nearer = with_secants(here, z, seen[-_DEPTH:], errors) if seen else here
        seen.append((z, here))
        least = max(here.noise, descent.least_noise)
        peak = laplace(nearer, point, replace(descent, least_noise=least), steps=steps)
        errors, steps = np.sqrt(np.diag(peak.covariance)), step_lengths(peak.covariance)
        descent, z, spent = descent.afresh(settled=np.inf), peak.z, spent + peak.evaluations
    return z, descent, steps, spent


def reweighed(found: Corrected, descent: Descent) -> Corrected:
    """The minimum next to another, with each channel weighed by the residual there.

    ``descent`` is as of `corrected`.
    """
    peak = found.peak
    problem = with_channels_reweighed(peak.problem, peak.point)
    if problem is None:
        return found
    near = descent.afresh(settled=np.inf, least_noise=problem.least_noise)
    end = corrected(problem, peak.point, near, steps=step_lengths(peak.covariance))
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
    root = np.linalg.cholesky(peak.covariance)
    draws = np.random.default_rng(0).standard_normal((_ELSEWHERE, len(peak.z)))
    points = chart.to_values(chart.project(peak.z + draws @ root.T))
    there = side_by_side(lambda point: corrected_at(problem, point, problem), points, threads)
    changes = np.array([
        one.with_noise(problem.noise).residuals(peak.point[None])[0] - peak.residuals
        for one in there
        if one is not None
    ])  # fmt: skip
    if not len(changes):
        return found
    moved = changes @ peak.jacobian.T @ peak.covariance / problem.noise**2
    error = moved.T @ moved / len(moved)
    scatter = float(np.mean([problem.data_cost(change) for change in changes]))
    nearer = replace(peak, problem=with_discrepancy(problem, peak.cost, scatter))
    return replace(found, peak=nearer, model_error=error, rounds=found.rounds + len(moved))


def _combined(known: list[tuple[np.ndarray, np.ndarray]], errors: np.ndarray) -> np.ndarray:
    """The point (d,) from which a round would lead nowhere, by secants through the last ones."""
    z, step = known[-1]
    if len(known) == 1:
        return z + step
    moved = np.array([z - before for before, _ in known[:-1]])
    changed = np.array([step - before for _, before in known[:-1]])
    shares = np.linalg.lstsq((changed / errors).T, step / errors, rcond=1e-3)[0]
    return z + step - shares @ (moved + changed)
