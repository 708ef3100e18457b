"""Jacobians of residuals by differences to both sides, some columns at a time.

``size`` is the number K of residuals: of long ones only a few are simulated together.
"""

from collections.abc import Callable

import numpy as np

from ematwin.estimation.levenberg_marquardt import LARGEST_BATCH
from ematwin.models.chart import Chart

Residuals = Callable[[np.ndarray], np.ndarray]  # (B, K) at coordinates (B, d)


def central(
    residuals: Residuals, z: np.ndarray, steps: np.ndarray, lower: np.ndarray, upper: np.ndarray,
    size: int,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Residuals (K,) at a point, and their Jacobian (d, K) by differences to both sides.

    ``size`` is K: of long residuals only some columns are differenced at a time.
    """
    up = np.minimum(steps, upper - z)
    down = np.minimum(steps, z - lower)
    eye, d = np.eye(len(z)), len(z)
    many = max(1, LARGEST_BATCH // (2 * size))
    jacobian = np.empty((d, size))
    for first in range(0, d, many):
        columns = slice(first, first + many)
        beside = [z + eye[columns] * up, z - eye[columns] * down]
        found = residuals(np.vstack(beside if first else [z[None], *beside]))
        if not first:
            here, found = found[0].copy(), found[1:]
        half = len(found) // 2
        jacobian[columns] = (found[:half] - found[half:]) / (up + down)[columns, None]
    return here, jacobian


def along(
    residuals: Residuals, z: np.ndarray, ways: np.ndarray, chart: Chart, size: int
) -> np.ndarray:
    """The Jacobian (d, K) by differences to both sides along ``ways`` (d, d), within the bounds."""
    up, down = chart.project(z + ways), chart.project(z - ways)
    moved = up - down
    change = np.empty((len(z), size))
    many = max(1, LARGEST_BATCH // (2 * size))
    for first in range(0, len(z), many):
        some = slice(first, first + many)
        found = residuals(np.vstack([up[some], down[some]]))
        half = len(found) // 2
        change[some] = found[:half] - found[half:]
    return np.linalg.solve(moved, change)
