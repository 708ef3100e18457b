"""Quantiles and median, beside numpy's."""

import math

import numpy as np
import pytest

from ematwin.numerics.quantiles import median, quantiles


@pytest.mark.parametrize("count", [1, 2, 3, 8, 101, 1000])
def test_as_of_numpy(count):
    values = np.random.default_rng(count).standard_normal(count)
    assert median(values) == np.median(values)
    shares = [0.0, 0.025, 0.5, 0.9, 1.0]
    np.testing.assert_allclose(quantiles(values, shares), np.quantile(values, shares), rtol=1e-12)


@pytest.mark.parametrize("count", [1, 4, 9])
@pytest.mark.parametrize("place", [0, -1])
def test_no_median_where_a_value_is_missing(count, place):
    values = np.arange(float(count))
    values[place] = math.nan
    assert math.isnan(median(values))


def test_values_stay_in_their_order():
    values = np.array([3.0, 1.0, 2.0])
    assert median(values) == 2.0
    assert values.tolist() == [3.0, 1.0, 2.0]
