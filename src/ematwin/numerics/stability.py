"""Stability of sampled linear loops: all eigenvalues lie within the unit circle.

Franklin, Powell and Workman (1998), Digital Control of Dynamic Systems, chapters 4 and 5.
"""

import math
from collections.abc import Callable

import numpy as np

_BISECTIONS = 50


def spectral_radius(transition: np.ndarray) -> float:
    """Largest magnitude of an eigenvalue of a (n, n) transition; below 1 it is stable."""
    return float(np.abs(np.linalg.eigvals(transition)).max())


def largest_share(stable: Callable[[float], bool]) -> float:
    """The share of 1 up to which a loop is stable; 0 if it is at none."""
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def exponential(matrix: np.ndarray) -> np.ndarray:
    """exp of a small (n, n) matrix by scaling and squaring; scipy.linalg takes longer to import."""
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(matrix).sum(1).max()), 1e-300))) + 4)
    scaled = matrix / 2.0**squarings
    term, total = np.eye(len(matrix)), np.eye(len(matrix))
    for n in range(1, 12):
        term = term @ scaled / n
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total
