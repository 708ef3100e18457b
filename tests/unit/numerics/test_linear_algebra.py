"""Least squares within bounds, beside scipy's."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ematwin.numerics.linear_algebra import bounded_squares


@pytest.mark.parametrize("seed", range(60))
def test_it_finds_what_scipy_finds(seed):
    rng = np.random.default_rng(seed)
    d = int(rng.integers(1, 28))
    matrix = rng.standard_normal((d + int(rng.integers(1, 60)), d)) * 10.0 ** rng.uniform(-3, 3, d)
    if d > 3:  # two columns that are nearly alike
        matrix[:, 1] = matrix[:, 0] + 1e-3 * matrix[:, 1]
    target = rng.standard_normal(len(matrix)) * 10.0 ** rng.uniform(-3, 3)
    low, high = -rng.exponential(size=d), rng.exponential(size=d)
    low[rng.random(d) < 0.3] = 0.0
    high[rng.random(d) < 0.2] = np.inf
    found = bounded_squares(matrix, target, low, high)
    wider = np.maximum(high, 1e-12)  # scipy wants bounds that differ
    right = lsq_linear(matrix, target, (np.minimum(low, -1e-12), wider), method="bvls")
    assert (low <= found).all()
    assert (found <= high).all()
    cost = float(((matrix @ found - target) ** 2).sum())
    assert cost <= 2.0 * right.cost * (1.0 + 1e-6)


@pytest.mark.parametrize("rounding", [0.0, 1e-14])
def test_what_says_nothing_stays_where_it_is(rounding):
    matrix = np.array([[1.0, 0.0], [1.0, rounding]])
    found = bounded_squares(matrix, np.array([2.0, 4.0]), np.array([-9.0, -9.0]), np.full(2, 9.0))
    assert found == pytest.approx([3.0, 0.0])


def test_bounds_that_are_one_hold():
    matrix, target = np.eye(2), np.array([2.0, 2.0])
    found = bounded_squares(matrix, target, np.zeros(2), np.array([0.0, 1.0]))
    assert found == pytest.approx([0.0, 1.0])
