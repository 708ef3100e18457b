"""Intervals hold 95 % of what is possible within the bounds."""

import numpy as np
import pytest

from ematwin.estimation.intervals import Draws, draws
from ematwin.models.chart import Chart
from ematwin.models.unknown import Unknown

SPREAD = 0.05  # standard deviation in the tests, of a range of 1
TWO_SIDED = 1.96  # standard errors that hold 95 %; also of a half-normal distribution


def fault(name: str, **more) -> Unknown:
    return Unknown(name, "", "", 0.0, 0.0, 1.0, **more)


def interval(z: float) -> tuple[float, float]:
    drawn = draws(Chart([fault("a")]), np.array([z]), np.array([[SPREAD**2]]))
    return drawn.interval("a", 0.0, 1.0)


def vector(size: float, direction: float, spread: float) -> Draws:
    """Draws of a magnitude and its direction, with the same error along both components."""
    chart = Chart([fault("size"), fault("way", direction_of="size")])
    z = chart.from_values(np.array([[size, direction]]))[0]
    return draws(chart, z, spread**2 * np.eye(2))


def test_far_from_the_bounds_an_interval_is_that_of_the_normal_distribution() -> None:
    low, high = interval(0.4)
    assert high - low == pytest.approx(2.0 * TWO_SIDED * SPREAD, rel=0.04)
    # the shortest interval is a little loose about where it lies
    assert 0.5 * (low + high) == pytest.approx(0.4, abs=0.3 * SPREAD)
    x = draws(Chart([fault("a")]), np.array([0.4]), np.array([[SPREAD**2]])).of("a")
    assert ((x >= low) & (x <= high)).mean() == pytest.approx(0.95, abs=1e-3)


def test_a_half_normal_at_a_bound_begins_at_the_bound() -> None:
    low, high = interval(0.0)
    assert low == 0.0
    assert high == pytest.approx(TWO_SIDED * SPREAD, rel=0.04)
    low, high = interval(1.0)
    assert high == 1.0
    assert low == pytest.approx(1.0 - TWO_SIDED * SPREAD, rel=0.04)


def test_three_standard_errors_from_a_bound_no_interval_touches_it() -> None:
    assert interval(3.0 * SPREAD)[0] > 0.5 * SPREAD


@pytest.mark.parametrize("role", ["nominal", "nuisance"])
def test_only_faults_are_cut_off_at_their_bounds(role) -> None:
    drawn = draws(Chart([fault("a", role=role)]), np.zeros(1), np.array([[SPREAD**2]]))
    low, high = drawn.interval("a", -5.0, 5.0)
    assert low == pytest.approx(-high, abs=0.3 * SPREAD)
    assert high - low == pytest.approx(2.0 * TWO_SIDED * SPREAD, rel=0.04)


def test_draws_keep_the_bounds_of_faults() -> None:
    chart = Chart([fault("a"), fault("size"), fault("way", direction_of="size")])
    root = np.random.default_rng(5).standard_normal((3, 3))
    x = draws(chart, np.array([0.95, 0.6, -0.6]), 0.1 * root @ root.T).values
    assert x.min() >= 0.0
    assert x.max() <= 1.0
    assert len(x) > 1000


@pytest.mark.parametrize("rank", [4, 2])
def test_what_has_no_bounds_follows_the_faults_as_the_covariance_says(rank) -> None:
    roles = ("nuisance", "fault", "nominal", "fault")
    chart = Chart([fault(name, role=role) for name, role in zip("abcd", roles, strict=True)])
    root = 0.03 * np.random.default_rng(7).standard_normal((4, rank))
    middle = np.full(4, 0.5)  # of the faults; ten standard deviations from all bounds
    x = draws(chart, middle, root @ root.T).values
    size = np.sqrt(np.diag(root @ root.T))
    assert np.abs(x.mean(axis=0) - 0.5).max() < 0.04 * size.max()
    unit = np.outer(size, size)
    assert np.cov(x.T) / unit == pytest.approx(root @ root.T / unit, abs=0.05)


def test_a_bound_of_a_fault_moves_what_goes_with_it() -> None:
    chart = Chart([fault("a", role="nuisance"), fault("b")])
    covariance = SPREAD**2 * np.array([[1.0, 0.9], [0.9, 1.0]])
    x = draws(chart, np.array([0.5, 0.0]), covariance)
    # of a half-normal distribution the mean is sqrt(2/pi)
    mean = np.sqrt(2.0 / np.pi) * SPREAD
    assert x.of("b").mean() == pytest.approx(mean, rel=0.03)
    assert x.of("a").mean() - 0.5 == pytest.approx(0.9 * mean, rel=0.06)


def test_three_faults_that_go_together_keep_an_interval_with_one_side() -> None:
    """At the corner where none is: the common part is limited, each alone much better known."""
    alone, common = 0.005, 0.1
    covariance = alone**2 * np.eye(3) + common**2 * np.ones((3, 3))
    names = ("a", "b", "c")
    found = draws(Chart([fault(name) for name in names]), np.zeros(3), covariance)
    # the slow way: what lies within the bounds, of many draws
    rng = np.random.default_rng(7)
    x = common * rng.standard_normal((400_000, 1)) + alone * rng.standard_normal((400_000, 3))
    expected = np.quantile(x[(x >= 0.0).all(axis=1)], 0.95, axis=0)
    for name, end in zip(names, expected, strict=True):
        low, high = found.interval(name, 0.0, 1.0)
        assert low == 0.0
        assert high == pytest.approx(end, rel=0.05)
    assert expected[0] > 1.8 * common  # far more than each alone


def test_in_a_corner_that_draws_hardly_hit_each_keeps_an_interval_of_its_own() -> None:
    names = [f"k{n}" for n in range(16)]
    chart = Chart([fault(name) for name in names])
    found = draws(chart, np.zeros(16), SPREAD**2 * np.eye(16))
    for name in names:
        low, high = found.interval(name, 0.0, 1.0)
        assert low == 0.0
        assert high == pytest.approx(1.645 * SPREAD, rel=0.1)


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
    low, high = found.interval("size", 0.0, 1.0)
    assert low == 0.0
    # half of a normal distribution: each size is as likely beforehand, whatever its direction
    assert high == pytest.approx(0.02 * 1.96, rel=0.05)


def test_an_interval_that_ends_next_to_a_bound_ends_at_it() -> None:
    x = np.linspace(0.002, 0.4, 5000)
    assert Draws(("a",), x[:, None], {}).interval("a", 0.0, 1.0)[0] == 0.0
    far = Draws(("a",), (x + 0.1)[:, None], {}).interval("a", 0.0, 1.0)
    assert far[0] > 0.1


def test_draws_are_the_same_each_time() -> None:
    chart = Chart([fault("a"), fault("b")])
    z, covariance = np.array([0.1, 0.2]), np.diag([0.01, 0.02])
    assert (draws(chart, z, covariance).values == draws(chart, z, covariance).values).all()
