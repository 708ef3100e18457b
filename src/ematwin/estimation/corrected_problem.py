"""A problem whose fast model is corrected by the reference.

Reference minus fast model at one point is taken off the recordings. That difference changes with
the unknowns: linearly with those that only the reference depends on, and where the fast model lacks
whole loops, linearly with all. `ematwin.estimation.correction` looks for the minimum with these.

Behind sampled loops the reference scatters: a small change moves a commutation past a sample, and
the impacts after it. Differences over short steps are made of that. So the reference is asked over
wide steps, and its difference from the fast model is regressed on them (statistical linear
regression; Lefebvre, Bruyninckx and De Schutter 2002, IEEE Trans. Autom. Control 47(8), 1406-1408).
What scatter alone would make of the slopes is left out.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ematwin.errors import ParameterError
from ematwin.estimation.prior import coordinates
from ematwin.estimation.problem import Problem
from ematwin.models.chart import Chart
from ematwin.models.comparison import Comparison
from ematwin.numerics.linear_algebra import eigen
from ematwin.numerics.side_by_side import side_by_side


class _Difference(NamedTuple):
    """What residuals of the reference change more with the unknowns than those of the fast model.

    Attributes
    ----------
    chart : Chart, of the unknowns
    z : (d,) array, coordinates of the point where the reference was asked
    here : of each recording (K,), difference that is left there
    slopes : of each recording (d, K), its change with the coordinates
    """

    chart: Chart
    z: np.ndarray
    here: Sequence[np.ndarray]
    slopes: Sequence[np.ndarray]

    def residuals(self, values: Mapping[str, np.ndarray], recording: int) -> np.ndarray:
        """(B, K), as `ResidualChange` says."""
        moved = coordinates(self.chart, values) - self.z
        return np.asarray(self.here[recording] + moved @ self.slopes[recording])


def corrected_at(
    problem: Problem,
    point: np.ndarray,
    like: Problem | None = None,
    ways: np.ndarray | None = None,
) -> Problem | None:
    """The same problem, corrected by the reference minus the fast model at a point (d,).

    The correction is linear in some unknowns: its slopes are regressed on answers of the reference,
    two along each way. The noise is what recordings are expected to leave beside the reference.
    None where a recording has no reference, or the reference diverged.

    Parameters
    ----------
    problem : not corrected
    like : corrected before, of the same recordings though perhaps with other unknowns: its slopes
        serve here too
    ways : (m, d) array, steps from the point in coordinates, a row each; one along each unknown
        that the fast model does not have and ``like`` did not have either if not given
    """
    chart = problem.chart
    first = missed_at(problem, point)
    if first is None:
        return None
    other = corrected_by(problem, first)
    if ways is None:
        ways = _ways_unseen(problem, point, like)
    if not (len(ways) or (like is not None and like.changes)):
        return other
    z = chart.from_values(point[None])[0]
    points = np.vstack([z[None], _beside(chart, z, ways)])
    values = chart.to_values(points)
    fast = [other.residuals_of(n, values) for n in range(len(problem.comparisons))]
    sizes = [one.shape[1] for one in fast]
    slopes, difference = _slopes_of(like, problem.names, sum(sizes)), np.zeros(sum(sizes))
    asked = side_by_side(lambda one: exact_residuals(problem, one), values[1:])
    there = np.array([True, *(one is not None for one in asked)])
    if there[1:].any():
        exact = np.array([np.concatenate(one) for one in asked if one is not None])
        moves = points[there] - z
        changes = np.vstack([difference, exact - np.hstack(fast)[there][1:]]) - moves @ slopes
        data = np.concatenate([
            np.arange(size) < size - one.evidence
            for size, one in zip(sizes, problem.comparisons, strict=True)
        ])  # fmt: skip
        independent = sum(one.independent for one in problem.comparisons)
        own = _slopes_beyond_scatter(moves, changes, data, independent)
        difference = changes.mean(axis=0) - moves.mean(axis=0) @ own
        slopes = slopes + own
    ends = np.cumsum(sizes)[:-1]
    parts = np.split(difference, ends), np.split(slopes, ends, axis=1)
    return other.with_comparisons(other.comparisons, [_Difference(chart, z, *parts)])


def _ways_unseen(problem: Problem, point: np.ndarray, like: Problem | None) -> np.ndarray:
    """Steps (m, d), in coordinates, along unknowns that only the reference has, and ``like`` not.

    One standard deviation of the prior: impacts make shorter differences rough.
    """
    known = () if like is None else like.names
    unseen = problem.comparisons[0].unseen
    widths = _prior_widths(problem)
    return np.array([
        (width or 0.1) * row
        for one, width, row in zip(problem.unknowns, widths, np.eye(len(point)), strict=True)
        if one.name.partition("@")[0] in unseen and one.name not in known
    ]).reshape(-1, len(point))  # fmt: skip


def _prior_widths(problem: Problem) -> np.ndarray:
    """(d,) standard deviations of the priors, in coordinates; zero of unknowns without one."""
    prior, widths = problem.prior, np.zeros(len(problem.names))
    places = [problem.names.index(name) for name in prior.names]
    widths[places] = np.sqrt(np.diag(prior.covariance)) / problem.chart.widths[places]
    return widths


def _slopes_beyond_scatter(
    moves: np.ndarray, changes: np.ndarray, data: np.ndarray, independent: float
) -> np.ndarray:
    """Slopes (d, K) of changes (n, K) with moves (n, d), by least squares.

    Scatter makes slopes too. Of the singular values of those of ``data`` (K,) remains what
    minimises the error (Gavish and Donoho 2017, IEEE Trans. Inf. Theory 63(4), 2137-2152, equation
    7); nothing of those no larger than scatter's.
    """
    away, change = moves - moves.mean(axis=0), changes - changes.mean(axis=0)
    size = np.abs(away).max(axis=0)
    size[size == 0.0] = 1.0
    left, values, right = np.linalg.svd(away / size, full_matrices=False)
    some = values > 1e-6 * values.max(initial=0.0)
    left, values, right = left[:, some], values[some], right[some]
    along = left.T @ change
    rest = (change - left @ along)[:, data]
    free = np.maximum(1.0 - 1.0 / len(moves) - np.sum(left**2, axis=1), 1e-9)
    # the median: along some ways the change curves
    scatter = max(float(np.median(np.sum(rest**2, axis=1) / free)), 1e-300)
    squares, vectors = eigen(along[:, data] @ along[:, data].T)
    ratio, beta = squares / scatter, len(values) / independent
    seen = ratio > (1.0 + math.sqrt(beta)) ** 2
    share = np.zeros(len(ratio))
    share[seen] = np.sqrt((ratio[seen] - beta - 1.0) ** 2 - 4.0 * beta) / ratio[seen]
    along[:, data] = vectors @ (share[:, None] * (vectors.T @ along[:, data]))
    slopes = (right.T / values @ along) / size[:, None]
    slopes[~away.any(axis=0)] = 0.0
    return np.asarray(slopes)


def _beside(chart: Chart, z: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Two points (2 m, d) for each of m ways beside coordinates (d,).

    On both sides; at half the step on one side where bounds leave less than half of the other.
    """
    length = np.linalg.norm(ways, axis=1)
    sides = [chart.project(z + step) for step in (ways, -ways)]
    halves = [chart.project(z + 0.5 * step) for step in (-ways, ways)]
    return np.vstack([
        np.where((np.linalg.norm(side - z, axis=1) < 0.5 * length)[:, None], half, side)
        for side, half in zip(sides, halves, strict=True)
    ])  # fmt: skip


def as_searched(problem: Problem) -> Problem:
    """The same problem as a search sees it.

    Where the fast model lacks forms of the actuator, it is corrected at healthy values first:
    minima of the fast model alone belong to another actuator.
    """
    if not problem.lacks_forms:
        return problem
    return corrected_at(problem, problem.start) or problem


def of_fast_model(problem: Problem) -> Problem:
    """The same problem where the recordings are of the fast model: a correction is nothing."""
    if not problem.comparisons[0].has_reference:
        return problem
    every = [one.measured() for one in problem.comparisons]
    return corrected_by(problem, [{n: np.zeros_like(x) for n, x in one.items()} for one in every])


def reference_scatter(problem: Problem, point: np.ndarray) -> float:
    """The relative misfit by which the reference differs from one candidate to the next.

    Behind sampled loops they do: a small change moves samples, and these the impacts in a gap. A
    recording is one such answer. The candidates are a point (d,) and one beside it, by a tenth of
    the width of the priors of parameters: of what differs from recording to recording priors are
    wide. 0 where the kind has no reference.
    """
    chart = problem.chart
    nominal = np.array([one.role == "nominal" for one in problem.unknowns])
    sides = np.random.default_rng(0).choice([-0.1, 0.1], len(point))
    away = sides * _prior_widths(problem) * nominal
    near = chart.project(chart.from_values(point[None]) + away)
    here, there = (missed_by(problem, one) for one in (point, chart.to_values(near)[0]))
    if here is None or there is None:
        return 0.0
    return problem.relative_misfit(0.5 * problem.data_cost(there - here))


def missed_by(problem: Problem, point: np.ndarray) -> np.ndarray | None:
    """Residuals (K,) of the reference less those of a problem at a point (d,); None likewise."""
    answer = exact_residuals(problem, point)
    if answer is None:
        return None
    exact = problem.with_answer(answer).residuals(point[None])
    return np.asarray((exact - problem.residuals(point[None]))[0])


def missed_at(
    problem: Problem, point: np.ndarray, moved: Mapping[str, float] | None = None
) -> list[Mapping[str, np.ndarray]] | None:
    """Reference minus fast model, per recording, at a point (d,) with some values ``moved``.

    None where a recording has no reference, or the reference diverged.
    """
    return _each(problem, point, lambda one, values: one.missed({**values, **(moved or {})}))


def exact_residuals(problem: Problem, point: np.ndarray) -> list[np.ndarray] | None:
    """Residuals (K,) of each recording by the reference alone at a point (d,); None likewise."""

    def left(one: Comparison, values: Mapping[str, float]) -> Mapping[str, np.ndarray] | None:
        found = one.exact_residuals(values)
        return None if found is None else {"": found}

    every = _each(problem, point, left)
    return None if every is None else [one[""] for one in every]


def _each(
    problem: Problem,
    point: np.ndarray,
    asked: Callable[[Comparison, Mapping[str, float]], Mapping[str, np.ndarray] | None],
) -> list[Mapping[str, np.ndarray]] | None:
    """What each recording is asked at a point (d,); None where one has no finite answer."""

    def answer(n: int) -> Mapping[str, np.ndarray] | None:
        values = {name: float(x[0]) for name, x in problem.candidates(point[None], n).items()}
        try:
            found = asked(problem.comparisons[n], values)
        except ParameterError:  # a sampled loop that is unstable there
            return None
        if found is None or not all(np.isfinite(trace).all() for trace in found.values()):
            return None
        return found

    every = side_by_side(answer, range(len(problem.comparisons)))
    known = [one for one in every if one is not None]
    return known if len(known) == len(every) else None


def corrected_by(problem: Problem, missed: Sequence[Mapping[str, np.ndarray]]) -> Problem:
    """The same problem with that taken off each recording, and the noise that is left then."""
    pairs = zip(problem.comparisons, missed, strict=True)
    other = problem.with_comparisons([one.with_missed(by_channel) for one, by_channel in pairs])
    # no model error until a discrepancy shows (`ematwin.estimation.noise.with_discrepancy`)
    return other.with_noise(other.comparisons[0].noise, model_error=1.0)


def _slopes_of(like: Problem | None, names: Sequence[str], size: int) -> np.ndarray:
    """Slopes (d, K) with which a problem was corrected, of the unknowns of another."""
    slopes = np.zeros((len(names), size))
    for one in () if like is None else like.changes:
        if isinstance(one, _Difference):
            own = [each.name for each in one.chart.unknowns]
            for n, name in enumerate(names):
                if name in own:
                    slopes[n] = np.hstack([part[own.index(name)] for part in one.slopes])
    return slopes
