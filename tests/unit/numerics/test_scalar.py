"""Sine, cosine and limits of the compiled steps against those of the standard library."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.numerics import scalar


def test_sine_and_cosine_err_by_less_than_4e_12_within_a_thousand_turns():
    def largest_error(turns, count):
        worst = 0.0
        for n in range(count):
            x = 2.0 * math.pi * turns * (2.0 * n / count - 1.0)
            s, c = scalar.sincos(x)
            worst = max(worst, abs(s - math.sin(x)), abs(c - math.cos(x)))
        return worst

    assert largest_error(1e3, 2_000_003) < 4e-12
    # far beyond the travel of an actuator the error stays that of the angle's own rounding
    assert largest_error(1e5, 2_000_003) < 1e-10


@given(st.floats(0.0, 1e6))
def test_an_exponential_that_falls_errs_by_1e_11_of_it(x):
    assert scalar.fallen(x) == pytest.approx(math.exp(-x), rel=1e-11, abs=1e-13)


@given(st.integers(-40_000, 40_000))
def test_sine_and_cosine_are_right_at_and_beside_every_eighth_of_a_turn(eighths):
    for x in np.nextafter(eighths * math.pi / 4.0, [-np.inf, 0.0, np.inf]):
        assert scalar.sincos(x) == pytest.approx((math.sin(x), math.cos(x)), abs=1e-11)


@given(st.floats(-10.0, 10.0))
def test_fifth_and_seventh_multiples_of_an_angle_follow_from_its_sine_and_cosine(x):
    s, c = math.sin(x), math.cos(x)
    found = (s * scalar.fifth(s * s), c * scalar.fifth(c * c))
    assert found == pytest.approx((math.sin(5.0 * x), math.cos(5.0 * x)), abs=1e-12)
    found = (s * scalar.seventh(s * s), -c * scalar.seventh(c * c))
    assert found == pytest.approx((math.sin(7.0 * x), math.cos(7.0 * x)), abs=1e-12)


@given(st.floats(), st.floats(-1e3, 1e3), st.floats(0.0, 1e3))
def test_clip_limits_and_lets_nan_through(x, low, width):
    clipped = scalar.clip(x, low, low + width)
    if math.isnan(x):
        assert math.isnan(clipped)
    else:
        assert clipped == min(max(x, low), low + width)
