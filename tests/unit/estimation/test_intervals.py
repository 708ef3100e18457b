"""Intervals hold 95 % of what is possible within the bounds."""

import numpy as np
import pytest

from ematwin.estimation.intervals import Draws

SPREAD = 0.05  # standard deviation in the tests, of a range of 1
TWO_SIDED = 1.96  # standard errors that hold 95 %; also of a half-normal distribution


def normal(z: float) -> np.ndarray:
    """Draws (N,) of a normal distribution within a range of 1."""
    x = z + SPREAD * np.random.default_rng(1).standard_normal(20_000)
    return x[(x >= 0.0) & (x <= 1.0)]


def interval(z: float) -> tuple[float, float]:
    return Draws(("a",), normal(z)[:, None], {}).interval("a", 0.0, 1.0)


def vector(size: float, direction: float, spread: float) -> Draws:
    """Draws of a magnitude and its direction, with the same error along both components."""
    rng = np.random.default_rng(2)
    middle = size * np.exp(2j * np.pi * direction)
    z = middle + spread * (rng.standard_normal(20_000) + 1j * rng.standard_normal(20_000))
    values = np.stack([np.abs(z), (np.angle(z) / (2.0 * np.pi)) % 1.0], axis=1)
    return Draws(("size", "way"), values, {"way": "size"})


def test_far_from_the_bounds_an_interval_is_that_of_the_normal_distribution() -> None:
    low, high = interval(0.4)
    assert high - low == pytest.approx(2.0 * TWO_SIDED * SPREAD, rel=0.04)
    # the shortest interval is a little loose about where it lies
    assert 0.5 * (low + high) == pytest.approx(0.4, abs=0.3 * SPREAD)
    x = normal(0.4)
    assert ((x >= low) & (x <= high)).mean() == pytest.approx(0.95, abs=1e-3)


def test_a_half_normal_at_a_bound_begins_at_the_bound() -> None:
    low, high = interval(0.0)
    assert low == 0.0
    assert high == pytest.approx(TWO_SIDED * SPREAD, rel=0.04)
    low, high = interval(1.0)
    assert high == 1.0
    assert low == pytest.approx(1.0 - TWO_SIDED * SPREAD, rel=0.04)


@pytest.mark.parametrize("direction", [0.3, 0.97, 0.03, 0.5])
def test_an_interval_of_a_direction_goes_round_the_turn(direction: float) -> None:
    size, spread = 0.5, 0.02
    low, high = vector(size, direction, spread).interval("way", 0.0, 1.0)
    # across the vector an error turns it by its share of the length
    reach = TWO_SIDED * spread / size / (2.0 * np.pi)
    assert 0.5 * (high - low) == pytest.approx(reach, rel=0.05)
    middle = 0.5 * (low + high)
    assert 0.0 <= middle < 1.0  # the ends may lie beyond
    assert abs((middle - direction + 0.5) % 1.0 - 0.5) < 0.1 * reach


def test_a_direction_of_nothing_may_be_any() -> None:
    found = vector(0.0, 0.5, 0.02)
    assert found.interval("way", 0.0, 1.0) == (0.0, 1.0)


def test_an_interval_that_ends_next_to_a_bound_ends_at_it() -> None:
    x = np.linspace(0.002, 0.4, 5000)
    assert Draws(("a",), x[:, None], {}).interval("a", 0.0, 1.0)[0] == 0.0
    far = Draws(("a",), (x + 0.1)[:, None], {}).interval("a", 0.0, 1.0)
    assert far[0] > 0.1
