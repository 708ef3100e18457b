"""A problem that the reference alone answers, linear in the unknowns near a point.

A fast model that lacks whole loops tells little of how the reference changes with the unknowns. And
behind sampled loops the reference scatters: a small change moves a commutation past a sample, and
the impacts after it. Slopes over short steps are made of that. So the reference is asked over steps
as wide as the unknowns are uncertain (statistical linear regression; Lefebvre, Bruyninckx and De
Schutter 2002, IEEE Trans. Autom. Control 47(8), 1406-1408),

    R(x) = R(x_0) + S^T (x - x_0) + e,   e ~ N(0, Sigma),

with slopes S by least squares, and Sigma by what the answers scatter about it. A recording is one
such answer: its residuals have the covariance s^2 I + Sigma, with the noise s, and are whitened.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ematwin.estimation.corrected_problem import (
    corrected_by,
    exact_residuals,
    missed_at,
    residuals_each,
)
from ematwin.estimation.prior import coordinates
from ematwin.estimation.problem import Problem
from ematwin.models.chart import Chart
from ematwin.numerics.side_by_side import side_by_side


class Scatter(NamedTuple):
    """Covariance of residuals of one recording beside their noise, such as what answers scatter.

    Attributes
    ----------
    sizes : (m,) array, standard deviations along its principal parts, in those of the noise
    parts : (m, K) array, of length one
    """

    sizes: np.ndarray
    parts: np.ndarray

    @classmethod
    def of(cls, rest: np.ndarray, noise: float) -> "Scatter":
        """The sum over what each of some independent causes changes, (n, K).

        ``noise`` is the standard deviation of an independent residual.
        """
        _, sizes, parts = np.linalg.svd(rest, full_matrices=False)
        return cls(sizes / noise, parts)

    def whitened(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (B, K) as if they held noise alone."""
        less = 1.0 - 1.0 / np.sqrt(1.0 + self.sizes**2)
        return np.asarray(residuals - (residuals @ self.parts.T * less) @ self.parts)


class _Linear(NamedTuple):
    """Residuals of the reference near a point.

    Attributes
    ----------
    chart : Chart, of the unknowns
    z : (d,) array, coordinates of the point
    here : of each recording (K,), residuals there
    slopes : of each recording (d, K), change with the coordinates
    scatter : of each recording; none if not known
    """

    chart: Chart
    z: np.ndarray
    here: Sequence[np.ndarray]
    slopes: Sequence[np.ndarray]
    scatter: Sequence[Scatter] = ()

    def residuals(self, values: Mapping[str, np.ndarray], recording: int) -> np.ndarray:
        """(B, K), as `ResidualChange` says."""
        moved = coordinates(self.chart, values) - self.z
        found = np.asarray(self.here[recording] + moved @ self.slopes[recording])
        return self.scatter[recording].whitened(found) if self.scatter else found


def is_linear(problem: Problem | None) -> bool:
    """Whether the reference alone answers a problem."""
    return problem is not None and problem.linear is not None


def linear_at(problem: Problem, z: np.ndarray) -> Problem | None:
    """A problem answered by the reference at coordinates (d,), without slopes yet.

    None where a recording has no reference, or the reference diverged.
    """
    point = problem.chart.to_values(z[None])[0]
    missed = missed_at(problem, point)
    if missed is None:
        return None
    other = corrected_by(problem, missed)
    here = residuals_each(other, point)
    flat = [np.zeros((len(z), len(one))) for one in here]
    return other.linearised(_Linear(problem.chart, z, here, flat))


def with_slopes(
    problem: Problem, here: Problem, ways: np.ndarray, like: Problem | None = None
) -> tuple[Problem, int]:
    """A problem with slopes and scatter of its own, and how often the reference was asked.

    It is asked twice along each way.

    Parameters
    ----------
    problem : not corrected
    here : as of `linear_at`, or linear already: then its answer serves, and its slopes do not
    ways : (d, d) array, steps to other points, a row each
    like : linear near another point of the same recordings, though perhaps with other unknowns: it
        has slopes and scatter already, and only unknowns that it lacks are asked for
    """
    linear = _linear(here)._replace(scatter=())
    slopes = [np.zeros((len(linear.z), len(one))) for one in linear.here]
    if like is not None and is_linear(like):
        known = _linear(like)
        names = [one.name for one in known.chart.unknowns]
        new = np.array([name not in names for name in problem.names])
        for slope, other in zip(slopes, known.slopes, strict=True):
            slope[~new] = other[[names.index(name) for name in problem.names if name in names]]
        linear = linear._replace(scatter=known.scatter)
        ways = np.diag(np.abs(ways).max(axis=0))[new]
    if not len(ways):
        return here.linearised(linear._replace(slopes=slopes)), 0
    points = _beside(problem, linear.z, ways)
    asked = side_by_side(lambda z: _answer(problem, z), points)
    answers = [one for one in asked if one is not None]
    moves = points[[one is not None for one in asked]] - linear.z
    size = np.abs(ways).max(axis=0)
    size[size == 0.0] = 1.0
    shares = np.linalg.pinv(moves / size, rcond=1e-6) / size[:, None]
    scatter = []
    for n, (slope, then) in enumerate(zip(slopes, linear.here, strict=True)):
        changes = np.array([one[n] - then for one in answers])
        slope += shares @ (changes - moves @ slope)
        rest = changes - moves @ slope
        rest[:, len(then) - here.comparisons[n].evidence :] = 0.0  # it has a noise of its own
        scatter.append(Scatter.of(rest, here.noise))
    linear = linear._replace(slopes=slopes, scatter=linear.scatter or scatter)
    return here.linearised(linear), len(asked)


def with_secant(
    problem: Problem, here: Problem, z: np.ndarray, errors: np.ndarray
) -> tuple[Problem, Problem] | None:
    """A linear problem and the same at ``z``, each with slopes by which it is right at the other.

    Broyden's update (1965, Math. Comp. 19, 577-593), the least one in standard errors by which
    slopes agree with both answers of the reference. None where it diverged at ``z``.

    Parameters
    ----------
    problem : not corrected
    here : as of `with_slopes`
    z, errors : (d,) arrays, coordinates and their standard errors
    """
    linear, there = _linear(here), linear_at(problem, z)
    if there is None:
        return None
    step = z - linear.z
    share = step / errors**2
    share /= step @ share
    other = _linear(there)
    slopes = [
        slope + np.outer(share, now - then - step @ slope)
        for slope, now, then in zip(linear.slopes, other.here, linear.here, strict=True)
    ]
    linear = linear._replace(slopes=slopes)
    return here.linearised(linear), there.linearised(linear._replace(z=z, here=other.here))


def missed_by(problem: Problem, z: np.ndarray) -> np.ndarray | None:
    """Whitened residuals (K,) of the reference at ``z`` (d,) beyond those of a linear problem.

    None where it diverged.
    """
    linear, there = _linear(problem), _answer(problem, z)
    if there is None:
        return None
    answered = problem.linearised(linear._replace(z=z, here=there))
    point = problem.chart.to_values(z[None])
    change = answered.residuals(point) - problem.residuals(point)
    return np.asarray(change[0])


def _answer(problem: Problem, z: np.ndarray) -> list[np.ndarray] | None:
    """Residuals (K,) of each recording by the reference at ``z`` (d,); None if it diverged."""
    return exact_residuals(problem, problem.chart.to_values(z[None])[0])


def _linear(problem: Problem) -> _Linear:
    assert isinstance(problem.linear, _Linear)
    return problem.linear


def _beside(problem: Problem, z: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Two points (2 m, d) for each of m ways beside coordinates (d,).

    On both sides; at half the step on one side where bounds leave less than half of the other.
    """
    length = np.linalg.norm(ways, axis=1)
    sides = [problem.chart.project(z + step) for step in (ways, -ways)]
    halves = [problem.chart.project(z + 0.5 * step) for step in (-ways, ways)]
    return np.vstack([
        np.where((np.linalg.norm(side - z, axis=1) < 0.5 * length)[:, None], half, side)
        for side, half in zip(sides, halves, strict=True)
    ])  # fmt: skip
