"""Laplace's approximation: where a posterior has its peak, and how wide it is there.

From a point that a search found, all unknowns of a problem descend together (`Descent`); the
curvature at the end is the inverse covariance. Two things keep it honest.

The noise is not white: the twin's error is alike from sample to sample. Its size comes from the
residuals themselves, counted once for each independent sample; `Laplace.widened` allows for errors
of the twin that are the same throughout.

Impacts make residuals rough, and differences over short steps see that roughness where a change
of parameters has no effect: unknowns that cannot be told apart would seem to be. Steps of one
standard deviation, to both sides, look past most of it. Where unknowns compensate each other, a
step of one alone raises the misfit, and the curvature on its way passes for information.
So differences are taken along the principal directions of the width found before (`principal`):
what recordings hardly see is then measured as the small change that it is. Directions that a kind
knows (`ematwin.estimation.aliases`) are not differenced. At the end all move together by the
linearised residuals, unknowns that aliases had held included, for as long as that gains.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ematwin.estimation.aliases import Aliases, Direction, directions, held_pivots
from ematwin.estimation.constants import WORTH
from ematwin.estimation.descent import STEP, Descent, bounded_step
from ematwin.estimation.levenberg_marquardt import LARGEST_BATCH
from ematwin.estimation.noise import with_shown_noise
from ematwin.estimation.problem import Problem
from ematwin.models.chart import Chart
from ematwin.numerics.linear_algebra import bounded_squares, eigen, inverse

_ROUGH = 1.02  # ratio of costs that is mere roughness
_SHORTEST, _LONGEST = 1e-3, 2e-2  # steps of the last Jacobian, shares of a range


@dataclass(frozen=True)
class Laplace:
    """A peak and its width, in the coordinates of the problem's chart.

    Attributes
    ----------
    problem : Problem, with the noise that was found
    z : (d,) array, the best point within the bounds
    mean, covariance : (d,) and (d, d) arrays, of the normal distribution without bounds
    data, priors : (d, d) arrays, what recordings and priors add to the inverse of the covariance
    cost : float, of the data that a search sees
    evidence : float, sum of squares of the evidence of further channels
    evaluations : int
    jacobian : (d, K) array, of all residuals
    residuals : (K,) array, at ``z``
    """

    problem: Problem
    z: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    data: np.ndarray
    priors: np.ndarray
    cost: float
    evidence: float
    evaluations: int
    jacobian: np.ndarray
    residuals: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """(d, d), of recordings and priors."""
        return self.data + self.priors

    @property
    def point(self) -> np.ndarray:
        """(d,) values of the unknowns at the best point."""
        return self.problem.chart.to_values(self.z[None])[0]

    def widened(self, factor: float) -> np.ndarray:
        """The covariance (d, d) with the noise of the data multiplied by a factor."""
        return inverse(self.data / factor**2 + self.priors)

    def unbounded(self, factor: float, held: Collection[str] = ()) -> np.ndarray:
        """The mean (d,) of the normal distribution whose peak within the bounds this is.

        Parameters
        ----------
        factor : times that the noise of the data is larger
        held : faults that stay where they are at the peak
        """
        chart, slope = self.problem.chart, self.slope(factor)
        precision = self.data / factor**2 + self.priors
        size = np.sqrt(np.maximum(np.diag(precision), 1e-12))
        values, vectors = eigen(precision / np.outer(size, size))
        root = np.sqrt(np.maximum(values, 1e-10))
        scaled = (vectors * root).T
        there = -(vectors.T @ (slope / size)) / root
        low = np.minimum(chart.lower - self.z, 0.0) * size
        high = np.maximum(chart.upper - self.z, 0.0) * size
        free = [
            n for n, one in enumerate(chart.unknowns)
            if one.name not in held and one.direction_of not in held
        ]  # fmt: skip
        step = np.zeros(len(slope))
        step[free] = bounded_squares(scaled[:, free], there, low[free], high[free])
        # slopes are rough: were they exact, this step would be none
        return self.z + (vectors @ (there / root) - step) / size

    def slope(self, factor: float) -> np.ndarray:
        """Half the slope (d,) of minus twice the log density, with the noise of the data so."""
        slopes, here = self.problem.split(self.jacobian), self.problem.split(self.residuals)
        noise = self.problem.noise
        found = (slopes.data @ here.data + slopes.evidence @ here.evidence) / (factor * noise) ** 2
        return np.asarray(found + slopes.priors @ here.priors / noise**2)


def laplace(
    problem: Problem,
    start: np.ndarray,
    descent: Descent | None = None,
    *,
    information: np.ndarray | None = None,
) -> Laplace:
    """The peak next to a point, and its width.

    Parameters
    ----------
    problem : Problem
    start : (d,) array, values
    descent : to the peak; unknowns that it holds only widen the peak
    information : (d, d) array, as of `width_at`

    Raises
    ------
    TooFarError
        If the descent raises it.
    """
    descent = descent or Descent()
    aliases, held = descent.aliases, descent.held
    point, spent = descent.end(problem, start)
    chart = problem.chart
    z = chart.project(chart.from_values(point[None]))[0]
    seen = _Seen(problem, point, descent.least_noise)
    problem = seen.problem
    slopes = _slopes(problem, seen, z, aliases, information)
    still = held_pivots(problem, directions(problem, point, aliases)) | set(held)
    # everything together, where evidence decides what data do not see
    for _ in range(2 if problem.has_evidence else 0):
        # what evidence alone tells, the descent has left where it was
        first = chart.to_values(
            (z + bounded_step(slopes.jacobian, slopes.here, z, chart, still))[None]
        )[0]
        point, more = descent.afresh(settled=np.inf).end(problem, first)
        spent += more
        tried = chart.project(chart.from_values(point[None]))[0]
        if not _is_better(problem, seen(np.vstack([z, tried]))):
            break
        z = tried
        slopes = _slopes(problem, seen, z, aliases)
    z, slopes = _stepped(problem, seen, z, slopes, aliases, held)
    return _peak(problem, z, slopes, spent + seen.spent)


def followed(peak: Laplace, problem: Problem, z: np.ndarray, held: Collection[str]) -> Laplace:
    """The peak of a problem that differs little from one whose peak is known, in one step.

    From coordinates (d,), by the other's slopes, noise and width; ``held`` as of `Descent`.
    """
    problem = problem.with_noise(peak.problem.noise, trust=peak.problem.trust)
    here = problem.residuals(problem.chart.to_values(z[None]))[0]
    step = bounded_step(peak.jacobian, here, z, problem.chart, held)
    return replace(peak, problem=problem, z=z + step, residuals=here, evaluations=1)


def width_at(
    problem: Problem,
    point: np.ndarray,
    *,
    aliases: Aliases | None = None,
    least_noise: float = 0.0,
    information: np.ndarray | None = None,
) -> Laplace:
    """The width of a peak that is known to lie at a point (d,), without a descent.

    ``information`` (d, d) is that of a peak that is about as wide, where known already: one batch
    of differences is enough then.
    """
    z = problem.chart.project(problem.chart.from_values(point[None]))[0]
    seen = _Seen(problem, point, least_noise)
    return _peak(seen.problem, z, _slopes(seen.problem, seen, z, aliases, information), seen.spent)


class _Seen:
    """Residuals (B, K) at ``z`` (B, d), with the noise that a first point (d,) shows; counted."""

    def __init__(self, problem: Problem, point: np.ndarray, least_noise: float) -> None:
        self.problem, self.spent = problem, 1
        here = problem.residuals(point[None])[0]
        self.problem = with_shown_noise(problem, here, least_noise)

    def __call__(self, z: np.ndarray) -> np.ndarray:
        self.spent += len(z)
        return self.problem.residuals(self.problem.chart.to_values(z))


def prior_information(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Information (d, d) near coordinates (d,) on the unknowns, without the data of a problem."""
    chart = problem.chart

    def distances(z: np.ndarray) -> np.ndarray:
        return problem.prior_distances(chart.to_values(z)) / problem.noise

    size = distances(z[None]).shape[1]
    jacobian = _along(distances, z, _SHORTEST * np.eye(len(z)), chart, size)
    return np.asarray(jacobian @ jacobian.T)


def sharp_errors(peak: Laplace, own: int, factor: float) -> np.ndarray:
    """Standard errors (own,) of the first unknowns, in values, as if the others were known.

    The noise of the data is taken to be ``factor`` times larger.
    """
    kept = slice(own)
    chart = Chart(peak.problem.chart.unknowns[:own])
    covariance = inverse(peak.data[kept, kept] / factor**2 + peak.priors[kept, kept])
    return chart.standard_errors(peak.z[:own], covariance)


def _peak(problem: Problem, z: np.ndarray, slopes: "_Slopes", spent: int) -> Laplace:
    mean = z - slopes.covariance @ (slopes.jacobian @ slopes.here) / problem.noise**2
    left = problem.split(slopes.here)
    cost, evidence = (float(part @ part) for part in left[:2])
    return Laplace(
        problem, z, mean, slopes.covariance, slopes.data, slopes.priors, cost, evidence, spent,
        slopes.jacobian, slopes.here,
    )  # fmt: skip


class _Slopes(NamedTuple):
    """Residuals (K,) at a point, their Jacobian (d, K), and the information (d, d) in it."""

    here: np.ndarray
    jacobian: np.ndarray
    data: np.ndarray
    priors: np.ndarray
    covariance: np.ndarray


def _slopes(
    problem: Problem,
    seen: _Seen,
    z: np.ndarray,
    aliases: Aliases | None,
    information: np.ndarray | None = None,
) -> _Slopes:
    """Differences along the principal directions of the peak, as long as it is wide there.

    Twice after first ones of each unknown, but once where its ``information`` (d, d) is about
    known; directions that the kind knows are not differenced.
    """
    chart = problem.chart
    known = directions(problem, chart.to_values(z[None])[0], aliases)
    shown = [_shown(problem, seen, z, one) for one in known]
    here = seen(z[None])[0]
    passes = 3 if information is None else 1
    if information is None:
        information = np.eye(len(z)) / _SHORTEST**2
    for _ in range(passes):
        jacobian = _along(seen, z, principal(information, z, chart), chart, len(here))
        parts = problem.split(jacobian)
        for one, change in zip(known, shown, strict=True):
            parts.data[one.pivot] = one.same @ parts.data
            parts.evidence[one.pivot] = one.same @ parts.evidence + change
        data = (parts.data @ parts.data.T + parts.evidence @ parts.evidence.T) / problem.noise**2
        priors = parts.priors @ parts.priors.T / problem.noise**2
        information = data + priors
    return _Slopes(here, jacobian, data, priors, inverse(information))


def principal(
    information: np.ndarray, z: np.ndarray, chart: Chart, longest: float = _LONGEST
) -> np.ndarray:
    """Directions (d, d), a row each, along which slopes are taken at a point (d,).

    They are the principal directions of this information (d, d), one standard deviation long. An
    unknown that lies nearer to a bound has a direction of its own, into the box. On it the unknowns
    that have room compensate the change; a bound that cuts off a step would end that. The largest
    component of a step is limited.
    """
    reach = np.clip(np.sqrt(np.diag(inverse(information))), _SHORTEST, longest)
    above, below = chart.upper - z, z - chart.lower
    near = np.minimum(above, below) < reach
    kept, far = np.flatnonzero(near), np.flatnonzero(~near)
    within = information[np.ix_(far, far)]
    scale = np.sqrt(np.maximum(np.diag(within), 1e-12))
    values, vectors = eigen(within / np.outer(scale, scale))
    ways = np.zeros((len(z), len(z)))
    ways[np.ix_(far, far)] = (vectors / scale[:, None] / np.sqrt(np.maximum(values, 1e-10))).T
    ways[kept, kept] = np.where(above > below, 1.0, -1.0)[kept]
    across = information[np.ix_(kept, far)] * ways[kept, kept][:, None]
    ways[np.ix_(kept, far)] = -across @ inverse(within)
    left = np.einsum("nk,kl,nl->n", ways[kept], information, ways[kept])
    ways[kept] /= np.sqrt(np.maximum(left, 1e-12))[:, None]
    size = np.abs(ways).max(axis=1, keepdims=True)
    return np.asarray(ways * (np.clip(size, _SHORTEST, longest) / size))


def _is_better(problem: Problem, pair: np.ndarray) -> bool:
    """Whether the second of two points lies nearer to evidence and priors, and fits as well.

    ``pair`` holds their residuals (2, K). The data separate two points so near only roughly.
    """
    before, after = zip(*((part**2).sum(axis=1) for part in problem.split(pair)), strict=True)
    return bool(after[0] < _ROUGH * before[0] and sum(after[1:]) < sum(before[1:]))


def _stepped(
    problem: Problem,
    seen: _Seen,
    z: np.ndarray,
    slopes: _Slopes,
    aliases: Aliases | None,
    held: Collection[str],
) -> tuple[np.ndarray, _Slopes]:
    """A point (d,) after steps of everything together, held pivots included, and slopes there.

    A bound may forbid an apparent pivot, as turns are missing and never added: then the data
    determine the pivot, and its held value has been forced on others.
    """
    chart = problem.chart
    for _ in range(8 if np.isfinite(slopes.jacobian).all() else 0):
        step = bounded_step(slopes.jacobian, slopes.here, z, chart, held)
        # shares of the step are tried
        tried = chart.project(z + np.outer((1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08), step))
        left = seen(tried)
        costs = np.einsum("bk,bk->b", left, left)
        best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        if not costs[best] < slopes.here @ slopes.here - WORTH * problem.noise**2:
            break
        z = tried[best]
        slopes = _slopes(problem, seen, z, aliases, slopes.data + slopes.priors)
    return z, slopes


def _shown(
    problem: Problem,
    residuals: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    one: Direction,
) -> np.ndarray | float:
    """How evidence (K,) changes along a direction that data do not see, for one of the pivot.

    Currents and motion stay along it, so that differences are not rough, as they are otherwise.
    """
    if not problem.has_evidence:
        return 0.0
    blind = STEP * one.blind
    up, down = problem.split(residuals(np.vstack([z + blind, z - blind]))).evidence
    return np.asarray((up - down) / (2.0 * blind[one.pivot]))


def _along(
    residuals: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    ways: np.ndarray,
    chart: Chart,
    size: int,
) -> np.ndarray:  # fmt: skip
    """The Jacobian (d, K) by differences along ``ways`` (d, d), within the bounds.

    To both sides, or to that which has room. ``size`` is K: of long residuals only some ways are
    differenced at a time.
    """
    up, down = chart.project(z + ways), chart.project(z - ways)
    cut = [np.any(end != z + way, axis=1) for end, way in ((up, ways), (down, -ways))]
    up[cut[0] & ~cut[1]] = z
    down[cut[1] & ~cut[0]] = z
    moved = up - down
    change = np.empty((len(z), size))
    many = max(1, LARGEST_BATCH // max(1, 2 * size))
    for first in range(0, len(z), many):
        some = slice(first, first + many)
        found = residuals(np.vstack([up[some], down[some]]))
        half = len(found) // 2
        change[some] = found[:half] - found[half:]
    return np.linalg.solve(moved, change)
