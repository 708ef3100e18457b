"""How well a recording is explained without a fault, everything else free to take its place.

A fault is no more certain than the best explanation that does without it. Its standard error comes
from the curvature at the best point, and so from slopes there. Slopes of a rough misfit may be
wrong, the way along which parameters take a fault's place may bend, and a search may have ended
beside the best point. So each fault that would be named is held at healthy while all else descends,
parameters within their tolerances included. What data and priors rise by then, in squared standard
deviations, is the likelihood ratio of the two explanations (Wilks 1938, Ann. Math. Stat. 9, 60-62;
profile likelihood: Venzon and Moolgavkar 1988, Appl. Stat. 37, 87-94); the standard error is at
least that by which the fault is so far from healthy.

Faults that are improbable are held together, for the minimum without them. Near the minimum the
misfit is looked at along each fault (`profiled`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.constants import WORTH
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import Laplace
from ematwin.numerics.side_by_side import side_by_side

_FLATTEST = 5.0  # times that a covariance is widened at most


@dataclass(frozen=True)
class HeldHealthy:
    """The best explanations of a recording without some groups of faults.

    Attributes
    ----------
    rises : (G,) array, by how many squared standard deviations each is worse than with the fault;
        below zero where the search had not found the best point
    point : (d,) array, the best point next to the best of them, its fault free again
    evaluations : int
    """

    rises: np.ndarray
    point: np.ndarray
    evaluations: int


def held_healthy(
    peak: Laplace, groups: Sequence[Sequence[str]], threads: int | None = 1
) -> HeldHealthy:
    """The best explanations in which the faults of one group are healthy.

    Parameters
    ----------
    peak : the best point of all
    groups : names of the faults that are held together
    threads : for descents side by side; None takes one for each core
    """
    if not groups:
        return HeldHealthy(np.zeros(0), peak.point, 0)
    # what the fast model misses counts as noise here too, and the noise is that of the best point
    noise = peak.problem.noise * peak.problem.model_error
    problem, chart = peak.problem.with_noise(noise), peak.problem.chart
    # nothing is held, pivots of aliases included: parameters leave the means of their priors here
    free = Descent(least_noise=noise, settled=np.inf)

    def end(names: Sequence[str]) -> tuple[np.ndarray, int]:
        healthy = {one.name: one.healthy for one in problem.unknowns if one.name in names}
        if len(problem.names) == len(names):  # nothing else is free
            return np.array(list(healthy.values())), 0
        start = chart.to_values(chart.project((peak.z + _step(peak, names))[None]))[0]
        small = problem.holding(healthy)
        kept = [problem.names.index(one) for one in small.names]
        point, spent = free.end(small, start[kept])
        values = small.values(point)
        return np.array([values[one] for one in problem.names]), spent

    base, spent = peak.point, 1 + len(groups)
    if noise > peak.problem.noise:  # where data count less, priors have the peak elsewhere
        base, more = free.end(problem, base)
        spent += more
    ends = side_by_side(end, groups, threads)
    points = np.array([point for point, _ in ends])
    rises = (problem.costs(points) - problem.costs(base[None])) / noise**2
    spent += sum(more for _, more in ends)
    best = points[int(np.argmin(rises))]
    if rises.min() < -WORTH:
        best, more = free.end(problem, best)
        spent += more
    return HeldHealthy(rises, best, spent)


def _step(peak: Laplace, names: Sequence[str]) -> np.ndarray:
    """The step (d,) to healthy faults on which the others follow by the linearised residuals."""
    problem, chart = peak.problem, peak.problem.chart
    chosen = [problem.names.index(name) for name in names]
    directions = dict(chart.pairs)
    places = [*chosen, *(directions[n] for n in chosen if n in directions)]
    point = peak.point
    for n in chosen:
        point[n] = problem.unknowns[n].healthy
    gap = chart.from_values(point[None])[0] - peak.z
    covariance = peak.widened(problem.model_error)
    across = covariance[np.ix_(places, places)]
    return np.asarray(covariance[:, places] @ np.linalg.solve(across, gap[places]))


def profiled(
    peak: Laplace,
    covariance: np.ndarray,
    chosen: Sequence[int],
    factor: float,
    reaches: Sequence[float],
) -> np.ndarray:
    """The covariance (d, d) widened where the misfit rises less than its curvature says.

    Parameters
    ----------
    peak : Laplace
    covariance : (d, d) array, in the coordinates of the problem's chart
    chosen : places of unknowns; the misfit is looked at along each, while the others follow
    factor : float, times that the noise of the data is larger
    reaches : standard errors, how far to look
    """
    problem, chart, count = peak.problem, peak.problem.chart, len(chosen)
    errors = np.sqrt(np.diag(covariance))
    ways = (covariance[:, chosen] / errors[chosen]).T
    signed = [sign * reach for reach in reaches for sign in (1.0, -1.0)]
    points = np.concatenate([peak.z + reach * ways for reach in signed])
    bounded = chart.project(points)
    inside = np.abs(bounded - points).max(axis=1) < 1e-9
    points[~inside] = bounded[~inside]  # not looked at: a logarithm so far out overflows
    parts = problem.split(problem.residuals(chart.to_values(np.vstack([peak.z[None], points]))))
    data, evidence, priors = (np.einsum("bk,bk->b", part, part) for part in parts)
    heights = ((data + evidence) / factor**2 + priors) / problem.noise**2
    rise = np.where(inside, heights[1:] - heights[0], np.inf).reshape(len(signed), count)
    wider = np.ones(len(errors))
    for reach, seen in zip(signed, rise, strict=True):
        least = np.maximum(np.where(np.isfinite(seen), seen, np.inf), (reach / _FLATTEST) ** 2)
        wider[chosen] = np.maximum(wider[chosen], abs(reach) / np.sqrt(least))
    return stretched(covariance, wider)


def stretched(covariance: np.ndarray, wider: np.ndarray) -> np.ndarray:
    """A covariance (d, d) in which errors are larger by factors (d,) of at least one.

    Along the way on which the others follow each unknown, as it was along this way that the misfit
    rose less: what follows goes as far, and what does not follow stays as sure.
    """
    found = covariance.copy()
    for n in np.argsort(-wider):
        missing = wider[n] ** 2 * covariance[n, n] / found[n, n] - 1.0
        if missing > 0.0:
            found += missing * np.outer(found[:, n], found[:, n]) / found[n, n]
    return found
