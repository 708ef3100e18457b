"""Weighted draws beside moments and integrals in closed form."""

import numpy as np
import pytest
from scipy.special import gammaln, polygamma

from ematwin.fleet.learning import shares, weighted_draws

SHAPES = np.array([1.5, 2.0, 3.0, 5.0, 20.0])  # of gamma variates, whose logarithms are drawn


def test_draws_weigh_as_a_skewed_density_whose_integral_they_give_from_a_poor_start():
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((5, 5)))[0]

    def density(points):
        logs = points @ turn
        return 3.0 + (SHAPES * logs - np.exp(logs) - gammaln(SHAPES)).sum(axis=1)

    points, weight = weighted_draws(density, np.zeros(5), 0.5 * np.eye(5))
    share = shares(weight)
    assert 1.0 / (share**2).sum() > 500.0  # of 3000
    assert np.log(np.mean(np.exp(weight))) == pytest.approx(3.0, abs=0.1)
    logs = points @ turn
    mean, variance = polygamma(0, SHAPES), polygamma(1, SHAPES)
    np.testing.assert_allclose((share @ logs - mean) / variance**0.5, 0.0, atol=0.2)
    np.testing.assert_allclose(share @ (logs - mean) ** 2 / variance, 1.0, atol=0.3)
