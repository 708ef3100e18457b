"""How well a recording is explained without some faults, everything else free to take their place.

Slopes at a peak lead no further than its width, and a search may have ended beside the best point.
So each fault that may be there is held at healthy while all else descends, parameters within their
tolerances included. What data and priors rise by then, in squared standard deviations, is the
likelihood ratio of the two explanations (Wilks 1938, Ann. Math. Stat. 9, 60-62; profile likelihood:
Venzon and Moolgavkar 1988, Appl. Stat. 37, 87-94). Faults that are improbable are held together,
for the minimum without them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.aliases import Aliases
from ematwin.estimation.laplace import Laplace, peak_near
from ematwin.numerics.side_by_side import side_by_side


@dataclass(frozen=True)
class HeldHealthy:
    """The best explanations of a recording without some groups of faults.

    Attributes
    ----------
    rises : (G,) array, by how many squared standard deviations each is worse than with the fault;
        below zero where the search had not found the best point
    point : (d,) array, the best of them
    evaluations : int
    """

    rises: np.ndarray
    point: np.ndarray
    evaluations: int


def held_healthy(
    peak: Laplace,
    groups: Sequence[Sequence[str]],
    aliases: Aliases | None = None,
    threads: int | None = 1,
) -> HeldHealthy:
    """The best explanations in which the faults of one group are healthy.

    Parameters
    ----------
    peak : the best point of all
    groups : names of the faults that are held together
    aliases : as of `ematwin.estimation.descent.Descent`; no pivot is held, as parameters leave the
        means of their priors here
    threads : for descents side by side; None takes one for each core
    """
    if not groups:
        return HeldHealthy(np.zeros(0), peak.point, 0)
    # what the fast model misses counts as noise here too, and the noise is that of the best point
    noise = peak.problem.noise * peak.problem.model_error
    problem, chart = peak.problem.with_noise(noise), peak.problem.chart
    known = peak.data / peak.problem.model_error**2 + peak.priors

    def end(names: Sequence[str]) -> tuple[float, np.ndarray, int]:
        """Squared standard deviations from data and priors, the point (d,), and evaluations."""
        z = chart.project((peak.z + _step(peak, names))[None])[0]
        near = peak_near(problem, z, known, aliases, names)
        return float(near.residuals @ near.residuals) / noise**2, near.point, near.evaluations

    ends = side_by_side(end, [(), *groups], threads)
    heights = np.array([height for height, _, _ in ends])
    rises = heights[1:] - heights[0]
    best = ends[1 + int(np.argmin(rises))][1]
    return HeldHealthy(rises, best, sum(spent for _, _, spent in ends))


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
