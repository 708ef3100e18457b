"""Levenberg-Marquardt from several points at once, within bounds, by batches.

Levenberg (1944), Marquardt (1963). Each iteration simulates all columns of all Jacobians in one
batch (forward differences), then all trial steps in another: a few dampings for each point, of
which the best is kept. A bound that the step presses against is held for that step (projected
Newton, Bertsekas 1982).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Residuals = Callable[[np.ndarray], np.ndarray]

# Trial dampings, as factors of the current one.
DAMPINGS = np.array([0.1, 1.0, 10.0])
LONGEST_DIFFERENCE = 5e-3  # impacts make the misfit rough: shorter differences see only that
_SHORTEST_DIFFERENCE = 2e-4
NOTHING = 0.5  # squared standard deviations, of nine that decide: `least` where minima are chosen
LARGEST_BATCH = 2_000_000  # residuals that are held at a time


@dataclass
class LevenbergMarquardt:
    """Points on their way down.

    Attributes
    ----------
    points : (M, d) array
    residuals : (M, S) array; ``costs`` (M,) are their sums of squares
    damping, difference : (M,) arrays, damping and length of the forward differences
    finished : (M,) array of bool, points that no iteration moves any more
    least : float, gain of an iteration, in the unit of costs, below which a point is left alone
    """

    points: np.ndarray
    residuals: np.ndarray
    damping: np.ndarray
    difference: np.ndarray
    finished: np.ndarray
    least: float = 0.0

    @classmethod
    def start(
        cls,
        points: np.ndarray,
        residuals: Residuals,
        *,
        damping: float = 1e-2,
        least: float = 0.0,
        known: np.ndarray | None = None,
    ) -> "LevenbergMarquardt":
        """A descent from points (M, d); costs M evaluations, unless residuals (M, S) are known."""
        count = len(points)
        return cls(
            points.copy(),
            residuals(points) if known is None else known.copy(),
            np.full(count, damping),
            np.full(count, LONGEST_DIFFERENCE),
            np.zeros(count, dtype=bool),
            least,
        )

    @property
    def costs(self) -> np.ndarray:
        """(M,) sums of squares."""
        squares = np.einsum("ms,ms->m", self.residuals, self.residuals)
        return np.where(np.isfinite(squares), squares, np.inf)

    def best(self, count: int) -> "LevenbergMarquardt":
        """The ``count`` points of least cost, best first."""
        order = np.argsort(self.costs, kind="stable")[:count]
        return LevenbergMarquardt(
            self.points[order],
            self.residuals[order],
            self.damping[order],
            self.difference[order],
            self.finished[order],
            self.least,
        )

    def iterate(
        self,
        residuals: Residuals,
        lower: np.ndarray,
        upper: np.ndarray,
        project: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        """Move every point that is not finished by one Levenberg-Marquardt step.

        Bounds are (d,), or (M, d), a row for each point; a coordinate whose bounds are equal
        stays where it is.
        """
        moving = np.flatnonzero(~self.finished)
        many = max(1, LARGEST_BATCH // (self.points.shape[1] * self.residuals.shape[1]))
        low, high = (np.broadcast_to(end, self.points.shape) for end in (lower, upper))
        for first in range(0, len(moving), many):
            some = moving[first : first + many]
            self._move(some, residuals, low[some], high[some], project)

    def _move(
        self,
        moving: np.ndarray,
        residuals: Residuals,
        low: np.ndarray,
        high: np.ndarray,
        project: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        """Move the points of some numbers (N,), all in two batches."""
        count, d = len(moving), self.points.shape[1]
        here = self.points[moving]
        h = self.difference[moving][:, None]
        signed = np.where(high > low, np.where(here + h <= high, h, -h), 0.0)
        shifted = here[:, None, :] + signed[:, :, None] * np.eye(d)
        beside = residuals(shifted.reshape(-1, d)).reshape(count, d, -1)
        trials = np.empty((count, len(DAMPINGS), d))
        for m, n in enumerate(moving):
            size = np.where(signed[m] == 0.0, 1.0, signed[m])
            jacobian = (beside[m] - self.residuals[n]) / size[:, None]
            dampings = self.damping[n] * DAMPINGS
            trials[m] = here[m] + _steps(
                jacobian, self.residuals[n], here[m], dampings, low[m], high[m]
            )
        trials = project(trials.reshape(-1, d)).reshape(trials.shape)
        tried = residuals(trials.reshape(-1, d)).reshape(count, len(DAMPINGS), -1)
        for m, n in enumerate(moving):
            self._choose(int(n), shifted[m], beside[m], trials[m], tried[m])

    def _choose(
        self,
        n: int,
        shifted: np.ndarray,
        beside: np.ndarray,
        trials: np.ndarray,
        tried: np.ndarray,
    ) -> None:
        """Take the best point seen in this iteration, and adapt damping and difference."""
        before = _cost(self.residuals[n][None])[0]
        stepped, probed = _cost(tried), _cost(beside)
        t, p = int(np.argmin(stepped)), int(np.argmin(probed))
        after = min(stepped[t], probed[p])
        if not after < before:
            self.damping[n] *= 30.0
            self.difference[n] = max(0.4 * self.difference[n], 0.5 * _SHORTEST_DIFFERENCE)
            self.finished[n] = self.damping[n] > 1e5  # damping at which no step helps
            return
        if probed[p] < stepped[t]:  # a rough stretch: the differences did better than the model
            self.points[n], self.residuals[n] = shifted[p], beside[p]
            self.damping[n] *= 4.0
        else:
            moved = float(np.abs(trials[t] - self.points[n]).max())
            self.points[n], self.residuals[n] = trials[t], tried[t]
            self.damping[n] = max(self.damping[n] * DAMPINGS[t], 1e-7)
            self.difference[n] = np.clip(0.2 * moved, _SHORTEST_DIFFERENCE, LONGEST_DIFFERENCE)
        # a point that gains less is left alone
        self.finished[n] = (before - after) < max(1e-4 * before, self.least)


def _cost(residuals: np.ndarray) -> np.ndarray:
    squares = np.einsum("ns,ns->n", residuals, residuals)
    return np.where(np.isfinite(squares), squares, np.inf)


def _steps(
    jacobian: np.ndarray,
    residual: np.ndarray,
    point: np.ndarray,
    dampings: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:
    """Levenberg-Marquardt steps (len(dampings), d); ``jacobian`` is (d, S)."""
    d = len(point)
    normal = jacobian @ jacobian.T
    gradient = jacobian @ residual
    if not (np.isfinite(normal).all() and np.isfinite(gradient).all()):
        return np.zeros((len(dampings), d))
    scale = np.maximum(np.diag(normal), 1e-6 * np.diag(normal).max() + 1e-300)
    damped = normal + dampings[:, None, None] * np.diag(scale)
    steps = -np.linalg.solve(damped, np.broadcast_to(gradient[:, None], (len(dampings), d, 1)))
    steps = steps[..., 0]
    low, high = point <= lower, point >= upper
    for row, matrix in zip(steps, damped, strict=True):
        free = np.ones(d, dtype=bool)
        while (pressing := free & ((low & (row < 0.0)) | (high & (row > 0.0)))).any():
            free &= ~pressing
            f = np.flatnonzero(free)
            row[:] = 0.0
            row[f] = -np.linalg.solve(matrix[np.ix_(f, f)], gradient[f])
    return steps
