"""Quantiles of Student's t against scipy's."""

import pytest
from scipy.special import stdtrit

from ematwin.numerics.student import student_quantile


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 5, 10, 33, 100, 1000])
@pytest.mark.parametrize("probability", [1e-6, 0.01, 0.3, 0.5, 0.9, 0.975, 0.999, 1.0 - 1e-6])
def test_a_quantile_is_that_of_scipy(probability: float, freedom: int) -> None:
    expected = stdtrit(freedom, probability)
    assert student_quantile(probability, freedom) == pytest.approx(expected, rel=1e-8, abs=1e-8)
