"""Weighted draws of a density in several dimensions: adaptive importance sampling.

Cornuet, Marin, Mira and Robert (2012), Scand. J. Stat. 39, 798-812. Draws come from t
distributions; each next one has the mean and covariance of all draws so far. Departure: while few
draws have all the weight, mean and covariance are those of the density to a power below 1.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

_TAIL = 8.0  # degrees of freedom of t distributions: further out than the density reaches


def weighted_draws(
    density: Callable[[np.ndarray], np.ndarray], center: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Draws (N, D), and the logarithms of their weights (N,), whose mean is the integral.

    ``density`` gives logarithms (N,) at points (N, D); ``center`` (D,) and ``root`` (D, D) are mean
    and root of the covariance to begin with.
    """
    random = np.random.default_rng(1)
    points, logs = np.zeros((0, center.size)), np.zeros(0)
    known: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(6):
        known.append((center, root))
        z = random.standard_normal((500, center.size))
        new = center + z / np.sqrt(random.chisquare(_TAIL, (500, 1)) / _TAIL) @ root.T
        points, logs = np.concatenate([points, new]), np.concatenate([logs, density(new)])
        parts = [multivariate_t.logpdf(points, at, r @ r.T, df=_TAIL) for at, r in known]
        drawn = logsumexp(parts, axis=0) - np.log(len(known))
        weight = logs - drawn
        power = 1.0
        while 1.0 / ((part := shares(power * weight)) ** 2).sum() < 100.0:
            power *= 0.7  # until a mean and a covariance have enough effective draws
        center = part @ points
        root = np.linalg.cholesky((part[:, None] * (points - center)).T @ (points - center))
    return points, weight


def shares(weight: np.ndarray) -> np.ndarray:
    """Shares (N,) of draws, which sum to 1, by the logarithms of their weights."""
    found = np.exp(weight - weight.max())
    return np.asarray(found / found.sum())
