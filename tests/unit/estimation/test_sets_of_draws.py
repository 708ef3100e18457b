"""Probabilities of faults against integrals over a prior that is half absent, half present."""

import numpy as np
import pytest

from ematwin.estimation.spike_and_slab import FaultSets
from ematwin.models.unknown import Unknown


def fault(name="wear", **more) -> Unknown:
    given = {"healthy": 0.0, "lower": 0.0, "upper": 1.0} | more
    return Unknown(name, unit="", meaning=name, **given)


def drawn(likelihood, size=1, count=60_000, seed=1) -> np.ndarray:
    """Draws of a flat prior in [0, 1] under a likelihood of points (N, d)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(20 * count, size))
    return points[rng.uniform(size=len(points)) < likelihood(points)][:count]


def absent_by_integral(likelihood, low, high) -> float:
    """P(absent) with half the prior in [low, high] and half over the rest of [0, 1]."""
    x = (np.arange(400_000) + 0.5) / 400_000
    inside = (x > low) & (x < high)
    seen = likelihood(x)
    spike, slab = 0.5 * seen[inside].mean(), 0.5 * seen[~inside].mean()
    return spike / (spike + slab)


@pytest.mark.parametrize(("healthy", "middle", "width"), [(0.0, 0.03, 0.02), (0.5, 0.5, 0.2)])
def test_a_fault_alone_has_the_probability_of_the_integral(healthy, middle, width):
    one = fault(healthy=healthy)

    def likelihood(x):
        return np.exp(-0.5 * ((x - middle) / width) ** 2)

    expected = 1.0 - absent_by_integral(likelihood, healthy - 0.02, healthy + 0.02)
    found = FaultSets.of_draws([one], drawn(lambda points: likelihood(points[:, 0])))
    assert found.probabilities["wear"] == pytest.approx(expected, abs=0.02)


def test_a_fault_that_nothing_is_known_of_stays_as_likely_as_not():
    one = fault(healthy=0.5)
    found = FaultSets.of_draws([one], drawn(lambda points: np.ones(len(points))))
    assert found.probabilities["wear"] == pytest.approx(0.5, abs=0.02)


def test_of_two_that_make_up_for_one_another_one_is_present():
    """Only the sum is known: 0.3. Both absent is impossible, and both present is the rarer way."""

    def likelihood(points):
        return np.exp(-0.5 * ((points.sum(axis=1) - 0.3) / 0.02) ** 2)

    both = [fault("a"), fault("b")]
    found = FaultSets.of_draws(both, drawn(likelihood, 2, count=20_000))
    assert found.faulty == pytest.approx(1.0)
    # by integral over the four quarters of the prior
    x = (np.arange(2000) + 0.5) / 2000
    seen = likelihood(np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)).reshape(2000, 2000)
    near = x < 0.02
    one_absent = seen[np.ix_(near, ~near)].mean() * 0.25
    neither = seen[np.ix_(~near, ~near)].mean() * 0.25
    expected = (one_absent + neither) / (2.0 * one_absent + neither)
    assert found.probabilities["a"] == pytest.approx(expected, abs=0.03)


def test_few_draws_where_all_are_absent_are_not_enough():
    values = np.random.default_rng(3).uniform(0.1, 1.0, (4000, 6))
    values[:5] = 0.0
    assert FaultSets.of_draws([fault(name) for name in "abcdef"], values) is None
