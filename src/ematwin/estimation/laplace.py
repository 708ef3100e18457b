"""Laplace's approximation: where a posterior has its peak, and how wide it is there.

From a point that a search found, all unknowns of a problem descend together, those with priors
included; the curvature at the end is the inverse covariance. Two things keep it honest.

The noise is not white: what the twin misses is alike from sample to sample. Its size comes from the
residuals themselves, counted once for each independent sample; `Laplace.widened` allows for what
the twin misses in the same way throughout.

Impacts make residuals rough, and differences over short steps see that roughness where a change
of parameters has no effect: unknowns that cannot be told apart would seem to be. Steps of one
standard deviation, to both sides, look past most of it. Directions in which a kind knows that its
answer does not change at all (`Model.aliases`) are not differenced: the column of the one is made
of those of the others, and while the others are fitted it is held, so that no descent strays where
priors alone decide.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Alias

_STAGES, _LEAST_STAGES, _ITERATIONS = 8, 1, 5
_ROUNDS = 3  # over aliases that share unknowns
_GAIN = 0.95  # ratio of costs over a stage above which there is no more to gain
_SHORTEST, _LONGEST = 1e-3, 2e-2  # steps of the last Jacobian, shares of a range

Aliases = Callable[[Mapping[str, float]], Sequence[Alias]]


@dataclass(frozen=True)
class Laplace:
    """A peak and its width, in the coordinates of the problem's chart.

    Attributes
    ----------
    problem : Problem, with the noise that was found
    z : (d,) array, the best point within the bounds
    mean, covariance : (d,) and (d, d) arrays, of the normal distribution without bounds
    data, priors : (d, d) arrays, what each of the two adds to the inverse of the covariance
    cost : float, of the data alone
    evaluations : int
    """

    problem: Problem
    z: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    data: np.ndarray
    priors: np.ndarray
    cost: float
    evaluations: int

    @property
    def point(self) -> np.ndarray:
        """(d,) values of the unknowns at the best point."""
        return self.problem.chart.to_values(self.z[None])[0]

    def widened(self, factor: float) -> np.ndarray:
        """The covariance (d, d) where the noise of the data is so many times larger."""
        return inverse(self.data / factor**2 + self.priors)


def laplace(
    problem: Problem,
    start: np.ndarray,
    *,
    aliases: Aliases | None = None,
    held: Collection[str] = (),
    least_noise: float = 0.0,
    settled: float = 0.0,
) -> Laplace:
    """The peak next to a point, and its width.

    Parameters
    ----------
    problem : Problem
    start : (d,) array, values
    aliases : values by name -> directions in which the answer does not change
    held : unknowns that stay where they are and only widen the peak
    least_noise : float, the noise is taken to be no less, in the unit of `Problem.noise`
    settled : float, relative misfit at which a start lies in its valley already
    """
    point, spent = _descended(problem, start, aliases, held, least_noise, settled)
    chart = problem.chart

    def residuals(z: np.ndarray) -> np.ndarray:
        nonlocal spent
        spent += len(z)
        return problem.residuals(chart.to_values(z))

    z = chart.project(chart.from_values(point[None]))[0]
    problem = problem.with_noise(max(noise_of(problem, residuals(z[None])[0]), least_noise))
    known = _known_directions(problem, point, aliases)
    steps = np.full(len(z), _SHORTEST)
    for _ in range(2):
        here, jacobian = central(residuals, z, steps, chart.lower, chart.upper)
        data = jacobian[:, : here.size - problem.prior_rows]
        for pivot, same, _ in known:
            data[pivot] = same @ data
        of_data = data @ data.T / problem.noise**2
        rest = jacobian[:, here.size - problem.prior_rows :]
        of_priors = rest @ rest.T / problem.noise**2
        covariance = inverse(of_data + of_priors)
        steps = np.clip(np.sqrt(np.diag(covariance)), _SHORTEST, _LONGEST)
    mean = z - covariance @ (jacobian @ here) / problem.noise**2
    left = here[: here.size - problem.prior_rows]
    return Laplace(problem, z, mean, covariance, of_data, of_priors, float(left @ left), spent)


def _descended(
    problem: Problem,
    start: np.ndarray,
    aliases: Aliases | None,
    held: Collection[str],
    least_noise: float,
    settled: float,
) -> tuple[np.ndarray, int]:
    """The best point (d,) with the pivots of aliases held where they are, and what it took."""
    known = _known_directions(problem, start, aliases)
    still = {problem.names[n] for n, _, is_held in known if is_held} | set(held)
    values = dict(zip(problem.names, start.tolist(), strict=True))
    fixed = {name: value for name, value in values.items() if name in still}
    small = problem.holding(fixed) if fixed else problem
    chart, spent = small.chart, 0
    z = chart.project(chart.from_values(start[[problem.names.index(n) for n in small.names]][None]))
    # each stage looks with long differences again: rough stretches stop a single descent
    first = z
    near = bool(small.relative_misfit(float(small.costs(chart.to_values(z))[0])) < settled)
    for stage in range(_LEAST_STAGES if near else 0, _STAGES):
        # wide valleys first
        seen = small.smoothed() if stage == 0 else small
        left = seen.residuals(chart.to_values(z))[0]
        noise = max(noise_of(seen, left), least_noise)
        cost = float(left @ left) / noise**2 if stage else np.inf

        weighed = seen.with_noise(noise)

        def residuals(points: np.ndarray, weighed: Problem = weighed) -> np.ndarray:
            nonlocal spent
            spent += len(points)
            return weighed.residuals(chart.to_values(points))

        descent = LevenbergMarquardt.start(z, residuals, damping=1e-2)
        for _ in range(_ITERATIONS):
            descent.iterate(residuals, chart.lower, chart.upper, chart.project)
        end = descent.best(1)
        z = chart.project(end.points)
        if stage >= _LEAST_STAGES and float(end.costs[0]) / noise**2 > _GAIN * cost:
            break
    # the smooth misfit may have led astray
    both = np.vstack([first, z])
    z = both[[int(np.argmin(weighed.costs(chart.to_values(both))))]]
    values = small.values(chart.to_values(z)[0])
    point = np.array([values[name] for name in problem.names])
    if problem is small:
        point = _along(problem, point, known)
    return point, spent


def _known_directions(
    problem: Problem, point: np.ndarray, aliases: Aliases | None
) -> list[tuple[int, np.ndarray, bool]]:
    """Pivot, the same change in the others (d,), in coordinates of the chart, and whether held.

    Of an alias whose unknowns are not all free, nothing is known.
    """
    names, widths = list(problem.names), problem.chart.widths
    found = []
    for one in () if aliases is None else aliases(problem.values(point)):
        if one.pivot not in names:
            continue
        same = np.zeros(len(names))
        complete = True
        for name, change in one.same.items():
            places = [n for n, own in enumerate(names) if own.partition("@")[0] == name]
            complete &= bool(places)
            same[places] = change
        pivot = names.index(one.pivot)
        if complete:
            found.append((pivot, same / widths * widths[pivot], one.held))
    return found


def _along(
    problem: Problem, point: np.ndarray, known: list[tuple[int, np.ndarray, bool]]
) -> np.ndarray:
    """The point (d,) where the priors have it along the directions that they alone decide."""
    chart = problem.chart
    z = chart.from_values(point[None])
    for pivot, same, _ in known * _ROUNDS:
        blind = -same
        blind[pivot] += 1.0
        blind *= 1e-4 / np.abs(blind).max()
        near = problem.prior_distances(chart.to_values(np.vstack([z, z + blind])))
        slope = near[1] - near[0]
        if slope @ slope > 0.0:
            z = chart.project(z - (near[0] @ slope) / (slope @ slope) * blind)
    return np.asarray(chart.to_values(z)[0])


def noise_of(problem: Problem, residual: np.ndarray) -> float:
    """Standard deviation of an independent residual, from those that are left."""
    data = residual[: residual.size - problem.prior_rows]
    scale = sum(one.scale for one in problem.comparisons)
    independent = sum(one.independent for one in problem.comparisons)
    return float(np.sqrt((data @ data) / independent)) or 1e-9 * float(np.sqrt(scale))


def central(residuals, z, steps, lower, upper):  # type: ignore[no-untyped-def]
    """Residuals (K,) at a point, and their Jacobian (d, K) by differences to both sides."""
    up = np.minimum(steps, upper - z)
    down = np.minimum(steps, z - lower)
    eye = np.eye(len(z))
    found = residuals(np.vstack([z[None], z + eye * up, z - eye * down]))
    d = len(z)
    return found[0], (found[1 : d + 1] - found[d + 1 :]) / (up + down)[:, None]


def inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix; directions without information get a large variance."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    found = (vectors / np.maximum(values, 1e-10)) @ vectors.T
    return np.asarray(found / np.outer(scale, scale))
