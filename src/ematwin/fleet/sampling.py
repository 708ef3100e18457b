"""Weighted draws of a density in several dimensions: adaptive importance sampling.

Cornuet, Marin, Mira and Robert (2012), Scand. J. Stat. 39, 798-812. Draws come from t
distributions; each next one has the mean and covariance of all draws so far. Departure: while few
draws have all the weight, mean and covariance are those of the density to a power below 1.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

_ROUNDS, _COUNT = 6, 500  # t distributions, and draws of each
_TAIL = 8.0  # degrees of freedom: further out than the density reaches
_ENOUGH = 100.0  # effective draws for a mean and a covariance


def weighted_draws(
    density: Callable[[np.ndarray], np.ndarray], center: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Draws (N, D), and the logarithms of their weights (N,), whose mean is the integral.

    Parameters
    ----------
    density : gives logarithms (N,) of a density, which need not be normalised, at points (N, D)
    center, root : (D,) and (D, D) arrays, mean and root of the covariance to begin with
    """
    random = np.random.default_rng(1)
    points, logs = np.zeros((0, center.size)), np.zeros(0)
    known: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(_ROUNDS):
        known.append((center, root))
        z = random.standard_normal((_COUNT, center.size))
        new = center + z / np.sqrt(random.chisquare(_TAIL, (_COUNT, 1)) / _TAIL) @ root.T
        points, logs = np.concatenate([points, new]), np.concatenate([logs, density(new)])
        drawn = logsumexp([_student(points, *one) for one in known], axis=0) - np.log(len(known))
        weight = logs - drawn
        power = 1.0
        while 1.0 / ((part := shares(power * weight)) ** 2).sum() < _ENOUGH:
            power *= 0.7
        center = part @ points
        root = np.linalg.cholesky((part[:, None] * (points - center)).T @ (points - center))
    return points, weight


def shares(weight: np.ndarray) -> np.ndarray:
    """Shares (N,) of draws, which sum to 1, by the logarithms of their weights."""
    found = np.exp(weight - weight.max())
    return np.asarray(found / found.sum())


def _student(points: np.ndarray, center: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Logarithm of the density (N,) of a t distribution."""
    return np.asarray(multivariate_t.logpdf(points, center, root @ root.T, df=_TAIL))
