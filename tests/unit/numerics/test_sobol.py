"""Sobol points against those of scipy."""

import numpy as np
import pytest
from scipy.stats import qmc

from ematwin.numerics.sobol import Sobol


@pytest.mark.parametrize("dimensions", [1, 2, 3, 8, 21, 64, 70])
def test_points_are_those_of_scipy(dimensions):
    own = Sobol(dimensions, np.random.default_rng(dimensions))
    peer = qmc.Sobol(dimensions, rng=np.random.default_rng(dimensions))
    for count in (1, 256, 7, 129):
        np.testing.assert_array_equal(own.random(count), peer.random(count))


def test_the_generator_goes_on_where_that_of_scipy_would_leave_it():
    one, other = np.random.default_rng(5), np.random.default_rng(5)
    Sobol(8, one)
    qmc.Sobol(8, rng=other)
    assert one.random() == other.random()
