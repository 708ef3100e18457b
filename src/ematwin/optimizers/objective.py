"""The objective of a search, called with a whole batch or point by point, its answers checked."""

from collections.abc import Callable
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ematwin.errors import EmatwinError, InputError
from ematwin.optimizers.base import FloatArray

Objective = Callable[[FloatArray], ArrayLike]
"""(N, d) points to (N,) costs; or, with ``vectorized=False``, a (d,) point to its cost.

Lower is better; NaN or infinite means "as bad as can be".
"""


@runtime_checkable
class LimitedObjective(Protocol):
    """An objective that can stop evaluating a point once its cost is known to be too high."""

    def __call__(self, points: FloatArray) -> ArrayLike:
        """(N, d) points to (N,) costs."""
        ...  # pragma: no cover

    def costs_within(self, points: FloatArray, limits: FloatArray) -> ArrayLike:
        """The same costs; those above a limit (N,) may be given as infinite."""
        ...  # pragma: no cover


Evaluate = Callable[[FloatArray, bool, FloatArray | None], FloatArray]
"""Points of a batch, whether it is the first of the search, and limits (N,), to costs."""


_ONE_POINT = (
    "It receives a whole batch, one row per point; for an objective of one point give "
    "vectorized=False."
)
_WHOLE_BATCH = (
    "It receives one point at a time; for an objective of a whole batch leave out vectorized=False."
)


def evaluator(objective: Objective, vectorized: bool | None) -> Evaluate:
    """Give what evaluates a batch; ``vectorized`` as of `ematwin.optimizers.loop.minimize`."""

    def one_by_one(points: FloatArray, first: bool) -> FloatArray:
        return np.array([_costs(objective, point, first).item() for point in points])

    def evaluate(points: FloatArray, first: bool, limits: FloatArray | None) -> FloatArray:
        nonlocal vectorized
        if vectorized is None:  # a batch if it can take the first one, else point by point
            try:
                costs = _first_batch(objective, points)
                vectorized = True
            except (IndexError, TypeError, ValueError) as error:  # as one of one point gives
                try:
                    costs = one_by_one(points, False)
                except EmatwinError:  # it takes neither: what a batch gave tells more
                    raise error from None
                vectorized = False
            return costs
        if not vectorized:
            return one_by_one(points, first)
        if first:
            return _first_batch(objective, points)
        if limits is not None and isinstance(objective, LimitedObjective):
            return _costs(partial(objective.costs_within, limits=limits), points, False)
        return _costs(objective, points, False)

    return evaluate


def _first_batch(objective: Objective, points: FloatArray) -> FloatArray:
    """Evaluate a whole batch so that an objective of one point is recognised.

    It takes rows for variables and gives one number a column. Where there are as many rows as
    columns this looks right: a piece of the batch does not.
    """
    count, variables = points.shape
    pieces = [points[:-1], points[-1:]] if count == variables > 1 else [points]
    return np.concatenate([_costs(objective, piece, True) for piece in pieces])


def _costs(objective: Objective, points: FloatArray, first: bool) -> FloatArray:
    """Costs (N,) of a batch (N, d), or of size 1 of a point (d,), checked."""
    single = points.ndim == 1
    advice = _WHOLE_BATCH if single else _ONE_POINT
    try:
        answer = objective(points.copy())
    except (IndexError, TypeError, ValueError) as error:
        if isinstance(error, EmatwinError) or not first:
            raise
        if isinstance(error, IndexError) and not single and len(points) < points.shape[1]:
            raise InputError(
                f"The objective failed at {len(points)} points of {points.shape[1]} variables: "
                f"{error}. {advice}"
            ) from error
        error.add_note(advice)  # this mistake, perhaps; an error of its own stays what it is
        raise
    try:
        costs = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"The objective must give numbers, received {type(answer).__name__}. {advice}"
        ) from error
    if costs.size != 1 if single else costs.shape != (len(points),):
        wanted = "cost: for a point" if single else "cost per point: for points"
        raise InputError(
            f"The objective must give one {wanted} of shape {points.shape} it gave shape "
            f"{costs.shape}. {advice}"
        )
    return costs
