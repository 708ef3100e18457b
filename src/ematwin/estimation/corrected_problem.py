"""A problem whose fast model is corrected by the reference.

Reference minus fast model at one point is taken off the recordings. That difference changes with
the unknowns: linearly with those that only the reference depends on, and where the fast model lacks
whole loops, linearly with all. `ematwin.estimation.correction` looks for the minimum with these.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ematwin.errors import ParameterError
from ematwin.estimation.prior import Prior, coordinate
from ematwin.estimation.problem import Problem, ResidualChange
from ematwin.models.comparison import Comparison
from ematwin.models.unknown import Unknown
from ematwin.numerics.side_by_side import side_by_side

_BESIDE = 0.1  # standard deviations of the prior
_NEARLY = 0.01  # of steps one standard deviation long: what changes there is scatter


class _Unseen(NamedTuple):
    """An unknown on which only the reference depends.

    Attributes
    ----------
    unknown : Unknown
    around : float, where the reference was asked: the value, or its logarithm
    slopes : (K,) array for each recording, how residuals change with it
    """

    unknown: Unknown
    around: float
    slopes: list[np.ndarray]

    def residuals(self, values: Mapping[str, np.ndarray], recording: int) -> np.ndarray:
        """(B, K), as `ResidualChange` says."""
        moved = coordinate(self.unknown, values[self.unknown.name]) - self.around
        return np.outer(moved, self.slopes[recording])


def corrected_at(
    problem: Problem, point: np.ndarray, like: Problem | None = None
) -> Problem | None:
    """The same problem, corrected by the reference minus the fast model at a point (d,).

    The correction is linear in unknowns that the fast model does not have. Slopes come from
    ``like``, which was corrected before, of the same recordings though perhaps with other unknowns;
    those that it lacks take an answer of the reference each.
    The noise is what recordings are expected to leave beside the reference. None where a
    recording has no reference, or the reference diverged.
    """
    values = problem.values(point)
    first = missed_at(problem, point)
    if first is None:
        return None
    known = {} if like is None else _slopes_of(like)
    other = corrected_by(problem, first)
    unseen = [one for one in problem.unknowns if one.name in problem.comparisons[0].unseen]
    new = [one for one in unseen if one.name not in known]
    if new:
        far = {one.name: _likely(one, values[one.name], problem.prior) for one in new}
        near = {
            name: values[name] + _NEARLY * (there - values[name]) for name, there in far.items()
        }
        moved = [missed_at(problem, point, one) for one in (near, *({n: far[n]} for n in far))]
        if any(one is None for one in moved):
            return None
        before = residuals_each(other, point)
        steps = [
            _change(before, corrected_by(problem, one), point) for one in moved if one is not None
        ]
        scatter = _size(other, steps[0])
        for one, moves in zip(new, steps[1:], strict=True):
            step = coordinate(one, far[one.name]) - coordinate(one, values[one.name])
            share = _beyond_scatter(_size(other, moves), scatter)
            known[one.name] = [share / step * part for part in moves]
    changes: list[ResidualChange] = [
        _Unseen(one, coordinate(one, values[one.name]), known[one.name]) for one in unseen
    ]
    return other.with_comparisons(other.comparisons, changes)


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

    Behind sampled loops they do: a small change moves samples, and these the impacts in a gap.
    A recording is one such answer. The candidates are a point (d,) and one with parameters beside
    it, within a tenth of a standard deviation of their prior: of what differs from recording to
    recording priors are wide. 0 where the kind has no reference.
    """
    here = corrected_at(problem, point)
    if here is None:
        return 0.0
    prior = problem.prior.of(one.name for one in problem.unknowns if one.role == "nominal")
    places = [problem.names.index(name) for name in prior.names]
    logarithmic = np.array([problem.unknowns[n].logarithmic for n in places], bool)
    sides = np.random.default_rng(0).choice([-1.0, 1.0], len(places))
    moves = _BESIDE * sides * np.sqrt(np.diag(prior.covariance))
    near = point.copy()
    near[places] = np.where(logarithmic, point[places] * np.exp(moves), point[places] + moves)
    beside = corrected_at(problem, np.clip(near, problem.lower, problem.upper), here)
    if beside is None:
        return 0.0
    change = here.data_cost(beside.residuals(point[None])[0] - here.residuals(point[None])[0])
    return problem.relative_misfit(0.5 * change)


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


def residuals_each(problem: Problem, point: np.ndarray) -> list[np.ndarray]:
    """Residuals (K,) of each recording at a point (d,)."""
    return [problem.residuals_of(n, point[None])[0] for n in range(len(problem.comparisons))]


def _change(before: Sequence[np.ndarray], there: Problem, point: np.ndarray) -> list[np.ndarray]:
    """Change of residuals (K,) of each recording at a point (d,), to those of another problem."""
    return [now - then for now, then in zip(residuals_each(there, point), before, strict=True)]


def _size(problem: Problem, change: Sequence[np.ndarray]) -> float:
    """Sum of squares of a change of the data."""
    pairs = zip(change, problem.comparisons, strict=True)
    return sum(float(np.sum(x[: len(x) - one.evidence] ** 2)) for x, one in pairs)


def _beyond_scatter(size: float, scatter: float) -> float:
    """Share of a change that is no scatter, by the sums of squares of both."""
    return max(0.0, 1.0 - scatter / size) if size > 0.0 else 0.0


def _slopes_of(problem: Problem) -> dict[str, list[np.ndarray]]:
    """The slopes that a problem was corrected with, by name."""
    return {one.unknown.name: one.slopes for one in problem.changes if isinstance(one, _Unseen)}


def _likely(one: Unknown, value: float, prior: Prior) -> float:
    """A value one standard deviation from another: impacts make shorter differences rough."""
    spread = 0.1 if one.logarithmic else 0.1 * one.width
    if one.name in prior.names:
        n = prior.names.index(one.name)
        spread = math.sqrt(prior.covariance[n, n])
    sign = 1.0 if one.upper - value >= value - one.lower else -1.0
    moved = value * math.exp(sign * spread) if one.logarithmic else value + sign * spread
    return min(max(moved, one.lower), one.upper)
