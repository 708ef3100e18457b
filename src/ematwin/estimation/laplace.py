"""Laplace's approximation: where a posterior has its peak, and how wide it is there.

From a point that a search found, all unknowns of a problem descend together (`Descent`); the
curvature at the end is the inverse covariance. Two things keep it honest.

The noise is not white: the twin's error is alike from sample to sample. Its size comes from the
residuals themselves, counted once for each independent sample; `Laplace.widened` allows for errors
of the twin that are the same throughout.

Impacts make residuals rough. Differences over short steps see that where a change of parameters
has no effect: unknowns that cannot be told apart would seem to be. And a residual at one point
holds its ripple: a descent stops in a dent, standard errors beside the minimum along directions
that priors hold. So residuals and slopes are regressed on pairs of points as far apart as the peak
is wide (statistical linear regression; Lefebvre, Bruyninckx and De Schutter 2002, IEEE Trans.
Autom. Control 47(8), 1406-1408), and the peak is where they lead, by the misfit of the regression.

Where unknowns compensate each other, a step of one alone raises the misfit, and the curvature on
its way passes for information. So the pairs lie along the principal directions of the width found
before (`principal`): what recordings hardly see is then measured as the small change that it is.
Directions that a kind knows (`ematwin.estimation.aliases`) are not stepped along.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ematwin.estimation.aliases import Aliases, Direction, directions
from ematwin.estimation.descent import SAME, STEP, Descent, bounded_step
from ematwin.estimation.levenberg_marquardt import LARGEST_BATCH, NOTHING
from ematwin.estimation.noise import with_shown_noise
from ematwin.estimation.problem import Problem
from ematwin.models.chart import Chart
from ematwin.numerics.linear_algebra import eigen, inverse

_SHORTEST, _LONGEST = 1e-3, 2e-2  # steps of the last Jacobian, shares of a range
_STEPS, _SHARES = 8, (1.0, 0.5, 0.25)  # to a peak at most, and of what slopes predict


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
        data, evidence, priors = self.problem.split(self.jacobian)
        jacobian = np.hstack([data / factor, evidence / factor, priors])
        data, evidence, priors = self.problem.split(self.residuals)
        here = np.concatenate([data / factor, evidence / factor, priors])
        # slopes are rough: were they exact, this step would be none
        step = bounded_step(jacobian, here, self.z, self.problem.chart, held)
        return np.asarray(self.z - self.widened(factor) @ self.slope(factor) - step)

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
    point, spent = descent.end(problem, start)
    problem = with_shown_noise(problem, problem.residuals(point[None])[0], descent.least_noise)
    z = problem.chart.project(problem.chart.from_values(point[None]))[0]
    for _ in range(_STEPS):
        peak = peak_near(problem, z, information, descent.aliases, descent.held)
        spent += peak.evaluations
        fits = with_shown_noise(problem, peak.residuals, descent.least_noise)
        if not fits.noise < SAME * problem.noise:
            break
        problem, z, information = fits, peak.z, peak.information  # priors count less
    return replace(peak, evaluations=spent + 1)


def peak_near(
    problem: Problem,
    z: np.ndarray,
    information: np.ndarray | None,
    aliases: Aliases | None,
    held: Collection[str] = (),
) -> Laplace:
    """The peak to which slopes lead from coordinates (d,), by the noise that the problem has.

    Everything moves together, pivots of aliases included: a bound may forbid an apparent pivot, as
    turns are missing and never added. Then the data determine the pivot, and a value at which it is
    held would be forced on others. Arguments as of `laplace` and `Descent`.
    """
    seen, chart = _Seen(problem), problem.chart
    slopes = _slopes(seen, z, aliases, information)
    for _ in range(_STEPS if np.isfinite(slopes.jacobian).all() else 0):
        step = bounded_step(slopes.jacobian, slopes.here, z, chart, held)
        if step @ slopes.information @ step < NOTHING:
            z, slopes = z + step, slopes._replace(here=slopes.here + step @ slopes.jacobian)
            break
        for share in _SHARES:
            tried = chart.project((z + share * step)[None])[0]
            there = _slopes(seen, tried, aliases, slopes.information)
            if there.here @ there.here < slopes.here @ slopes.here:
                z, slopes = tried, there
                break
        else:
            break
    return _peak(problem, z, slopes, seen.spent)


def followed(peak: Laplace, problem: Problem, z: np.ndarray, held: Collection[str]) -> Laplace:
    """The peak of a problem that differs little from one whose peak is known, in one step.

    From coordinates (d,), by the other's slopes, noise and width; ``held`` as of `Descent`.
    """
    problem = problem.with_noise(peak.problem.noise, trust=peak.problem.trust)
    point = problem.chart.to_values(z[None])
    change = (problem.residuals(point) - peak.problem.residuals(point))[0]
    here = peak.residuals + (z - peak.z) @ peak.jacobian + change
    step = bounded_step(peak.jacobian, here, z, problem.chart, held)
    here = here + step @ peak.jacobian
    return replace(peak, problem=problem, z=z + step, residuals=here, evaluations=2)


def width_at(
    problem: Problem,
    point: np.ndarray,
    *,
    aliases: Aliases | None = None,
    least_noise: float = 0.0,
    information: np.ndarray | None = None,
) -> Laplace:
    """The width of a peak that is known to lie at a point (d,), without a descent.

    ``information`` (d, d) is that of a peak that is about as wide, where known already: one
    regression is enough then.
    """
    problem = with_shown_noise(problem, problem.residuals(point[None])[0], least_noise)
    z = problem.chart.project(problem.chart.from_values(point[None]))[0]
    seen = _Seen(problem)
    return _peak(problem, z, _slopes(seen, z, aliases, information), seen.spent + 1)


class _Seen:
    """Residuals (B, K) of a problem at ``z`` (B, d), counted."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.spent = problem, 0

    def __call__(self, z: np.ndarray) -> np.ndarray:
        self.spent += len(z)
        return self.problem.residuals(self.problem.chart.to_values(z))

    @cached_property
    def size(self) -> int:
        """K."""
        return self.problem.residuals(self.problem.start[None]).shape[1]


def _of_priors(problem: Problem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (P,) of the priors at coordinates (d,), and their Jacobian (d, P)."""
    chart = problem.chart

    def distances(z: np.ndarray) -> np.ndarray:
        return problem.prior_distances(chart.to_values(z))

    return _along(distances, z, _SHORTEST * np.eye(len(z)), chart, distances(z[None]).shape[1])


def sharp_errors(peak: Laplace, own: int, factor: float) -> np.ndarray:
    """Standard errors (own,) of the first unknowns, in values, as if the others were known.

    The noise of the data is taken to be ``factor`` times larger.
    """
    kept = slice(own)
    chart = Chart(peak.problem.chart.unknowns[:own])
    covariance = inverse(peak.data[kept, kept] / factor**2 + peak.priors[kept, kept])
    return chart.standard_errors(peak.z[:own], covariance)


def _peak(problem: Problem, z: np.ndarray, slopes: "_Slopes", spent: int) -> Laplace:
    covariance = inverse(slopes.information)
    mean = z - covariance @ (slopes.jacobian @ slopes.here) / problem.noise**2
    left = problem.split(slopes.here)
    cost, evidence = (float(part @ part) for part in left[:2])
    return Laplace(
        problem, z, mean, covariance, slopes.data, slopes.priors, cost, evidence, spent,
        slopes.jacobian, slopes.here,
    )  # fmt: skip


class _Slopes(NamedTuple):
    """Residuals (K,) and Jacobian (d, K) of a regression, and the information (d, d) in it."""

    here: np.ndarray
    jacobian: np.ndarray
    data: np.ndarray
    priors: np.ndarray
    information: np.ndarray


def _slopes(
    seen: _Seen, z: np.ndarray, aliases: Aliases | None, information: np.ndarray | None
) -> _Slopes:
    """Residuals and slopes near ``z`` (d,) along the principal directions of the peak.

    Twice after first slopes along each unknown, but once where its ``information`` (d, d) is about
    known.
    """
    problem, chart = seen.problem, seen.problem.chart
    known = directions(problem, chart.to_values(z[None])[0], aliases)
    shown = [_shown(seen, z, one) for one in known]
    pivots = [one.pivot for one in known]
    prior, prior_slopes = _of_priors(problem, z)
    passes = 3 if information is None else 1
    if information is None:
        information = np.eye(len(z)) / _SHORTEST**2
    for _ in range(passes):
        ways = principal(information, z, chart.lower, chart.upper, still=pivots)
        here, jacobian = _along(seen, z, ways, chart, seen.size)
        parts = problem.split(jacobian)
        problem.split(here).priors[...], parts.priors[...] = prior, prior_slopes
        for one, change in zip(known, shown, strict=True):
            parts.data[one.pivot] = one.same @ parts.data
            parts.evidence[one.pivot] = one.same @ parts.evidence + change
        data = (parts.data @ parts.data.T + parts.evidence @ parts.evidence.T) / problem.noise**2
        priors = parts.priors @ parts.priors.T / problem.noise**2
        information = data + priors
    return _Slopes(here, jacobian, data, priors, information)


def principal(
    information: np.ndarray,
    z: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    longest: float = _LONGEST,
    still: Collection[int] = (),
    shortest: float = _SHORTEST,
) -> np.ndarray:
    """Directions (m, d), a row each, along which slopes are taken at a point (d,).

    They are the principal directions of this information (d, d), one standard deviation long, with
    the unknowns in ``still`` known. An unknown that lies nearer to a bound has a direction of its
    own, into the box. On it the unknowns that have room compensate the change; a bound that cuts
    off a step would end that. The largest component of a step is limited.
    """
    free = np.setdiff1d(np.arange(len(z)), list(still))
    reach = np.sqrt(np.diag(inverse(information[np.ix_(free, free)])))
    above, below = upper - z, z - lower
    near = np.minimum(above, below)[free] < np.clip(reach, shortest, longest)
    kept, far = free[near], free[~near]
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
    size = np.abs(ways[free]).max(axis=1, keepdims=True)
    return np.asarray(ways[free] * (np.clip(size, shortest, longest) / size))


def _shown(seen: _Seen, z: np.ndarray, one: Direction) -> np.ndarray | float:
    """How evidence (K,) changes along a direction that data do not see, for one of the pivot.

    Currents and motion stay along it, so that differences are not rough, as they are otherwise.
    """
    if not seen.problem.has_evidence:
        return 0.0
    blind = STEP * one.blind
    up, down = seen.problem.split(seen(np.vstack([z + blind, z - blind]))).evidence
    return np.asarray((up - down) / (2.0 * blind[one.pivot]))


def _along(
    residuals: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    ways: np.ndarray,
    chart: Chart,
    size: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (K,) and Jacobian (d, K) regressed on points beside ``z`` along ``ways`` (m, d).

    On both sides, or on that which has room within the bounds. The Jacobian of unknowns that no way
    moves is zero. ``size`` is K: of long residuals only some ways are asked for at a time.
    """
    up, down = chart.project(z + ways), chart.project(z - ways)
    cut = [np.any(end != z + way, axis=1) for end, way in ((up, ways), (down, -ways))]
    up[cut[0] & ~cut[1]] = z
    down[cut[1] & ~cut[0]] = z
    mean, change = np.zeros(size), np.empty((len(ways), size))
    many = max(1, LARGEST_BATCH // max(1, 2 * size))
    for n in range(0, len(ways), many):
        some = slice(n, n + many)
        above, below = np.split(residuals(np.vstack([up[some], down[some]])), 2)
        change[some] = above - below
        mean += (above + below).sum(axis=0) / (2 * len(ways))
    moved = up - down
    free = moved.any(axis=0)
    jacobian = np.zeros((len(z), size))
    jacobian[free] = np.linalg.solve(moved[:, free], change)
    away = np.concatenate([up, down]).mean(axis=0) - z
    return np.asarray(mean - away @ jacobian), jacobian
