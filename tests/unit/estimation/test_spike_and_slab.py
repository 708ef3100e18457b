"""Probabilities of faults against sums over a grid, and against draws of a naive sampler."""

import numpy as np
import pytest

from ematwin.estimation.spike_and_slab import FaultSet, FaultSets, fault_sets
from ematwin.models.chart import Chart
from ematwin.models.unknown import Alias, Unknown


def fault(name, healthy=0.0, **more) -> Unknown:
    return Unknown(name, "", name, healthy, 0.0, 1.0, **more)


def on_a_grid(mean, covariance, count=400):
    """Probabilities of the four sets of two faults in [0, 1], absent at zero, by sums."""
    x = (np.arange(count) + 0.5) / count
    precision = np.linalg.inv(covariance)

    def density(a, b):
        away = np.stack(np.broadcast_arrays(a - mean[0], b - mean[1]), axis=-1)
        return np.exp(-0.5 * np.einsum("...i,ij,...j", away, precision, away))

    found = np.array([
        density(0.0, 0.0), density(x, 0.0).mean(), density(0.0, x).mean(),
        density(x[:, None], x[None]).mean(),
    ])  # fmt: skip
    return found / found.sum()


@pytest.mark.parametrize("mean", [(0.0, 0.0), (0.05, 0.1), (0.3, -0.02), (-0.3, 0.1)], ids=str)
@pytest.mark.parametrize("alike", [0.0, -0.95, 0.8])
def test_sets_have_the_probabilities_of_sums_over_a_grid(mean, alike):
    errors = np.array([0.05, 0.03])
    covariance = np.outer(errors, errors) * np.array([[1.0, alike], [alike, 1.0]])
    found = fault_sets(Chart([fault("a"), fault("b")]), np.array(mean), covariance)
    own = {one.faults: one.probability for one in found.sets}
    sets = [frozenset(), frozenset("a"), frozenset("b"), frozenset("ab")]
    expected = on_a_grid(mean, covariance)
    for names, share in zip(sets, expected, strict=True):
        assert own.get(names, 0.0) == pytest.approx(share, abs=0.02), names


@pytest.mark.parametrize("rise", [0.0, 4.0])
def test_minima_have_the_probabilities_of_their_integrals(rise):
    """Two minima of two faults: one sharp, and one wide that is as dense at most."""
    chart = Chart([fault("a"), fault("b")])
    means = np.array([[0.3, 0.3], [0.7, 0.0]])
    widths = np.array([[0.02, 0.03], [0.05, 0.04]])
    around = [
        fault_sets(chart, mean, np.diag(width**2), mean)
        for mean, width in zip(means, widths, strict=True)
    ]
    found = FaultSets.over(around, [0.0, rise])
    x = (np.arange(2000) + 0.5) / 2000

    def integral(mean, width):
        a, b = (np.exp(-0.5 * ((x - m) / s) ** 2) for m, s in zip(mean, width, strict=True))
        absent = np.exp(-0.5 * (mean / width) ** 2)  # a fault is absent, or anywhere
        return (a.mean() + absent[0]) * (b.mean() + absent[1])

    first, second = (integral(*one) for one in zip(means, widths, strict=True))
    expected = first / (first + second * np.exp(-0.5 * rise))
    assert found.minima[0] == pytest.approx(expected, abs=0.01)
    assert sum(one.probability for one in found.sets) == pytest.approx(1.0)
    only = found.minima[1] * around[1].probabilities["b"] + found.minima[0]
    assert found.probabilities["b"] == pytest.approx(only, abs=1e-6)


def test_a_drift_is_more_probable_than_three_faults_that_look_alike():
    """Turns missing from three phases answer as weaker magnets do."""
    faults = [fault(name) for name in ("a", "b", "c")]
    drift = Unknown("magnets", "", "", 1.0, 0.1, 10.0, "nominal", logarithmic=True, spread=0.02)
    chart = Chart([*faults, drift])
    # data see each fault less the drift, to 0.001; the drift has its prior alone
    width = float(chart.widths[3])
    rows = np.array([[1.0, 0.0, 0.0, width], [0.0, 1.0, 0.0, width], [0.0, 0.0, 1.0, width]])
    precision = rows.T @ rows / 0.001**2
    precision[3, 3] += (width / 0.02) ** 2
    z = chart.from_values(np.array([[0.0, 0.0, 0.0, 1.0]]))[0]
    seen = rows @ z + 0.03
    slope = rows.T @ seen / 0.001**2 + z * np.array([0.0, 0.0, 0.0, (width / 0.02) ** 2])
    covariance = np.linalg.inv(precision)
    found = fault_sets(chart, covariance @ slope, covariance)
    assert found.sets[0].faults == frozenset()
    assert found.faulty < 0.05
    assert np.log(found.drawn.of("magnets")).mean() == pytest.approx(0.03, abs=0.002)


def test_a_fault_is_what_it_is_if_it_is_there():
    mean, errors = np.array([0.3, 0.01]), np.array([0.02, 0.02])
    found = fault_sets(Chart([fault("a"), fault("b")]), mean, np.diag(errors**2))
    assert found.probabilities["a"] == pytest.approx(1.0)
    assert found.is_improbable("a") is False
    assert found.given("a").of("a").std() == pytest.approx(0.02, rel=0.05)
    b = found.given("b").of("b")  # within its bounds
    assert b.min() >= 0.0
    draws = np.random.default_rng(0).normal(0.01, 0.02, 100_000)
    assert b.mean() == pytest.approx(draws[draws > 0.0].mean(), rel=0.05)


@pytest.mark.parametrize("rank", [4, 2])
def test_what_has_no_bounds_follows_the_faults_as_the_covariance_says(rank):
    chart = Chart([
        Unknown(name, "", "", 0.0, 0.0, 1.0, role)
        for name, role in zip("abcd", ("nuisance", "fault", "nominal", "fault"), strict=True)
    ])  # fmt: skip
    root = 0.03 * np.random.default_rng(7).standard_normal((4, rank))
    found = fault_sets(chart, np.full(4, 0.5), root @ root.T)
    assert found.sets[0].faults == {"b", "d"}
    x, size = found.drawn.values, np.sqrt(np.diag(root @ root.T))
    assert np.abs(x.mean(axis=0) - 0.5).max() < 0.06 * size.max()
    unit = np.outer(size, size)
    assert np.cov(x.T) / unit == pytest.approx(root @ root.T / unit, abs=0.06)


def test_a_bound_of_a_fault_moves_what_goes_with_it():
    chart = Chart([Unknown("a", "", "", 0.5, 0.0, 1.0, "nuisance"), fault("b")])
    covariance = 0.05**2 * np.array([[1.0, 0.9], [0.9, 1.0]])
    x = fault_sets(chart, np.array([0.5, 0.0]), covariance).given("b")
    mean = np.sqrt(2.0 / np.pi) * 0.05  # of a half-normal distribution
    assert x.of("b").mean() == pytest.approx(mean, rel=0.05)
    assert x.of("a").mean() - 0.5 == pytest.approx(0.9 * mean, rel=0.1)


def test_a_drift_explains_what_an_improbable_fault_did():
    """Two parallel faults and a drift act alike; one fault is there for certain, and more."""
    chart = Chart([fault("a"), fault("b"), Unknown("c", "", "", 0.5, 0.0, 1.0, "nominal")])
    common, own = np.array([1.0, 1.0, -1.0]), np.diag([0.001, 0.001, 0.001]) ** 2
    covariance = 0.02**2 * np.outer(common, common) + own
    mean = np.array([0.015, 0.315, 0.49])
    found = fault_sets(chart, mean, covariance)
    assert found.presence("a") < 0.05 < found.presence("b")
    gain = covariance[1:, 0] / covariance[0, 0]
    expected = [0.0, *(mean[1:] - gain * mean[0])]
    assert found.points[0] == pytest.approx(expected, abs=1e-6)
    assert found.points[0][1:] == pytest.approx([0.3, 0.505], abs=1e-3)


def test_what_is_smaller_than_matters_is_no_fault():
    found = fault_sets(Chart([fault("a")]), np.array([0.015]), np.array([[0.001**2]]))
    assert found.presence("a") == pytest.approx(1.0)
    assert found.probabilities["a"] < 0.01
    assert found.faulty < 0.01


def test_a_magnitude_with_a_direction_is_one_fault():
    size, turn = fault("size"), fault("turn", 0.5, direction_of="size")
    chart = Chart([size, turn])
    error = 0.02
    for reach in (0.0, 0.05, 0.1):
        found = fault_sets(chart, np.array([reach, 0.0]), np.diag([error**2] * 2))
        r = (np.arange(4000) + 0.5) / 4000
        phi = np.linspace(-np.pi, np.pi, 400, endpoint=False)
        away = (r[:, None] * np.cos(phi) - reach) ** 2 + (r[:, None] * np.sin(phi)) ** 2
        there = np.exp(-0.5 * away / error**2).mean()
        absent = np.exp(-0.5 * reach**2 / error**2)
        assert found.presence("size") == pytest.approx(there / (there + absent), abs=0.03)


def test_a_mean_far_outside_of_its_bounds_leaves_a_value_at_the_bound():
    for away in (5.0, 30.0, 1000.0):  # standard errors
        error = 0.01
        found = fault_sets(Chart([fault("a")]), np.array([-away * error]), np.array([[error**2]]))
        # Mills: the mass beyond is the density at the bound over the slope of its logarithm
        assert found.presence("a") == pytest.approx(error / away / (1.0 + error / away), rel=0.5)
        assert found.given("a").of("a").mean() == pytest.approx(error / away, rel=0.5)


def test_a_fault_that_nothing_is_known_of_is_as_likely_as_not_and_anywhere():
    covariance = np.array([[0.5**2, 0.01], [0.01, 0.05**2]])
    found = fault_sets(Chart([fault("a"), fault("b")]), np.array([3.0, 0.3]), covariance)
    assert found.presence("a") == pytest.approx(0.5, abs=0.03)
    np.testing.assert_allclose(
        np.quantile(found.given("a").of("a"), [0.1, 0.9]), [0.1, 0.9], atol=0.05
    )
    assert found.presence("b") > 0.95


def test_a_set_that_is_next_to_impossible_has_no_draws():
    mean, errors = np.array([0.3, 0.4]), np.array([0.001, 0.002])
    found = fault_sets(Chart([fault("a"), fault("b")]), mean, np.diag(errors**2))
    for name, error in zip("ab", errors, strict=True):
        assert found.given(name).of(name).std() == pytest.approx(error, rel=0.05)


def test_a_fault_whose_sets_are_all_impossible_answers_as_if_it_were_absent():
    faults = (fault("a"), fault("b"))
    sets = [
        FaultSet(frozenset(name), share, np.full((10, 2), value))
        for name, share, value in (("a", 1.0, 0.4), ("b", 0.0, 0.7))
    ]
    found = FaultSets(faults, tuple(sets))
    assert found.probabilities == {"a": 1.0, "b": 0.0}
    assert found.given("b").of("b").mean() == found.given("a").of("b").mean()


def test_what_an_unknown_multiplies_moves_with_it_and_healthy_stays():
    scale = Unknown("scale", "", "", 1.0, 0.1, 3.0, "nuisance", spread=0.2)
    chart = Chart([fault("a"), fault("b"), scale])
    mean = chart.from_values(np.array([[0.4, 0.0, 1.0]]))[0]
    width = np.array([0.001, 0.001, 0.2 / scale.width])
    plain = fault_sets(chart, mean, np.diag(width**2))
    found = plain.multiplied(Alias("scale", {"a": -1.0, "b": -1.0}, multiplies=True), 1.0)
    assert found.presence("a") == plain.presence("a") > 0.99
    a, b, drawn = found.sets[0].values.T
    assert np.std(a / drawn) < 0.01 < 0.05 < np.std(a)
    assert np.all(b == 0.0)
