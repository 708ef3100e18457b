"""Trends: filter and smoother beside a dense solution, jumps beside ruptures, pooling."""

from dataclasses import replace

import numpy as np
import pytest
import ruptures
from scipy.special import gammaln, polygamma
from scipy.stats import norm

from ematwin.fleet.learning import learn, shares, weighted_draws
from ematwin.fleet.trend import Series, Trend, Wear, trend
from naive.trend import dense

WEAR = Wear(
    np.array([0.0, 0.1, 0.3, 0.0, 0.0, 0.05]), np.array([0.02, 0.1, 0.2, 0.01, 0.02, 0.2]),
    1e-4, 1e-3, 1.2, 0.005, 0.7, 1.0,
)  # fmt: skip
STEADY = replace(
    WEAR, mean=WEAR.mean * [1, 1, 0, 1, 1, 1], spread=WEAR.spread * [1, 1, 1e-6, 1, 1, 1]
)


def made(seed, n=30, slope=0.1, noise=0.01, overhauls=()):
    random = np.random.default_rng(seed)
    time = np.sort(random.uniform(0.0, 3.0, n))
    value = slope * time + random.normal(0.0, noise, n)
    return Series(time, value, np.full(n, noise), random.normal(size=(n, 2)), overhauls)


@pytest.mark.parametrize("overhauls", [(), (1.5,)])
@pytest.mark.parametrize("lasting", [1.2, -1.2])
def test_level_and_slope_are_those_of_a_dense_solution(overhauls, lasting):
    series, wear = made(1, overhauls=overhauls), replace(WEAR, lasting=lasting)
    found = trend(series, wear)
    variance = wear.variance(series.error)
    variance[list(found.outliers)] = np.inf
    resets = [int(np.searchsorted(series.time, at)) for at in overhauls]
    mean, cov, told = dense(
        series.time, series.value, variance, series.covariates, wear, found.jumps, resets
    )
    np.testing.assert_allclose(found.level, mean[:, 0], atol=1e-7)
    np.testing.assert_allclose(found.smooth[:, 1], mean[:, 1], atol=1e-7)
    np.testing.assert_allclose(found.level_error, np.sqrt(cov[:, 0, 0]), atol=1e-7)
    np.testing.assert_allclose(found.mean, mean[-1, :3], atol=1e-7)
    np.testing.assert_allclose(found.covariance, cov[-1, :3, :3], atol=1e-7)
    assert found.told == pytest.approx(told, abs=1e-9)


@pytest.mark.parametrize("overhauls", [(), (1.5,), (3.5,)])
def test_draws_of_the_wear_end_in_the_states_of_their_own_filters(overhauls):
    series = made(2, overhauls=overhauls)
    value = series.value.copy()
    value[10:] += 0.4
    value[20] += 0.5
    series = replace(series, value=value)
    wear = replace(learn([series], 0.0, 1.0), jump_rate=1e-2)
    found = trend(series, wear)
    assert 10 in found.jumps
    assert 20 in found.outliers
    for draws, mean, cov in found.states:
        for n in range(0, len(mean), 97):
            own = {name: getattr(draws, name)[n] for name in draws._fields[:-1]}
            single = replace(wear, **own, lasting=draws.lasting)
            done = Trend(series, single, found.outliers, found.jumps)
            last = done.mean, done.covariance
            if overhauls == (3.5,):
                last = single.mean[:3], np.diag(single.spread[:3] ** 2)
            np.testing.assert_allclose(mean[n], last[0], rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(cov[n], last[1], rtol=1e-9, atol=1e-12)


def test_a_jump_and_an_outlier_keep_the_dense_solution():
    series = made(2)
    value = series.value.copy()
    value[12:] += 0.4
    value[20] += 0.5
    series = replace(series, value=value)
    found = trend(series, STEADY)
    assert found.jumps == (12,)
    assert found.outliers == (20,)
    variance = STEADY.variance(series.error)
    variance[20] = np.inf
    mean, _, told = dense(series.time, value, variance, series.covariates, STEADY, (12,))
    np.testing.assert_allclose(found.level, mean[:, 0], atol=1e-9)
    assert found.told == pytest.approx(told, abs=1e-8)
    jump = np.log(STEADY.jump_rate * (series.time[12] - series.time[11]))
    outlier = norm.logpdf(0.0, scale=STEADY.size / STEADY.outlier_share)
    assert found.shocks == pytest.approx(jump + outlier, abs=1e-8)


def test_one_odd_estimate_at_the_end_is_an_outlier_until_the_next_confirms_it():
    series = made(3, 200)
    value = series.value.copy()
    value[-2:] += 0.4
    series = replace(series, value=value)
    assert trend(series.part(slice(-1)), STEADY).outliers == (len(value) - 2,)
    assert trend(series, STEADY).jumps == (len(value) - 2,)


@pytest.mark.parametrize("seed", range(5))
def test_jumps_are_where_ruptures_finds_them(seed):
    random = np.random.default_rng(seed)
    n, at = 60, int(random.integers(15, 45))
    value = random.normal(0.0, 0.01, n)
    value[at:] += 0.2
    series = Series(np.linspace(0.0, 2.0, n), value, np.full(n, 0.01), np.zeros((n, 2)))
    quiet = replace(STEADY, mean=np.zeros(5), q_level=1e-6, q_slope=1e-6)
    peer = ruptures.Binseg(model="l2", jump=1).fit(value).predict(n_bkps=1)
    assert trend(series, quiet).jumps == (peer[0],)


def test_no_jump_is_found_in_noise():
    found = [trend(made(seed, 100), STEADY).jumps for seed in range(20)]
    assert sum(map(len, found)) <= 1


def fleet_of(slopes, n, seed, temperature=0.0):
    random = np.random.default_rng(seed)
    every = []
    for slope in slopes:
        time = np.sort(random.uniform(0.0, 3.0, n))
        warm = np.sin(2.0 * np.pi * time)
        value = slope * time + temperature * warm + random.normal(0.0, 0.01, n)
        every.append(Series(time, value, np.full(n, 0.01), np.stack([warm, np.zeros(n)], axis=1)))
    return every


def test_rates_of_the_fleet_are_learnt_with_the_effect_of_temperature():
    slopes = np.random.default_rng(1).normal(0.1, 0.03, 20)
    wear = learn(fleet_of(slopes, 60, 2, temperature=0.02), 0.0, 1.0)
    assert wear.mean[1] == pytest.approx(0.1, abs=0.02)
    assert wear.spread[1] == pytest.approx(np.std(slopes), rel=0.3)
    assert wear.mean[3] == pytest.approx(0.02, abs=0.003)
    assert np.hypot(wear.occasion, 0.01 * wear.scale) == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("law", ["power", "exponential"])
def test_evidence_tells_wear_that_slows_down_from_wear_that_feeds_itself(law):
    several = []
    for seed in range(8):
        random, one = np.random.default_rng(seed), made(seed, 40)
        share = one.time / 3.0
        grown = share**0.6 if law == "power" else np.expm1(3.0 * share) / np.expm1(3.0)
        value = random.uniform(0.2, 0.6) * grown + random.normal(0.0, 0.01, 40)
        several.append(replace(one, value=value))
    wear = learn(several, 0.0, 1.0)
    assert {one.lasting > 0.0 for one in (wear, *wear.others)} == {law == "power"}


def test_variances_are_those_of_the_largest_likelihood_but_for_weak_priors():
    several = fleet_of([0.05, 0.1, 0.15, 0.2], 50, 3)
    wear = learn(several, 0.0, 1.0)

    def told(one):
        return sum(found.told + found.shocks for found in (trend(s, one) for s in several))

    best = told(wear)
    for name in ("q_level", "q_slope", "occasion"):
        for factor in (0.3, 3.0):
            assert told(replace(wear, **{name: factor * getattr(wear, name)})) < best + 1.0


def test_a_new_actuator_begins_with_the_rate_of_its_kind():
    wear = learn(fleet_of([0.09, 0.1, 0.11, 0.1, 0.1], 60, 4), 0.0, 1.0)
    few = fleet_of([0.1], 2, 5)[0]
    assert trend(few, wear).mean[1] == pytest.approx(0.1, abs=0.02)


def test_what_all_recordings_have_in_common_does_not_average_out():
    random = np.random.default_rng(6)
    several = [
        Series(t := np.sort(random.uniform(0, 3, 80)), 0.1 * t + random.normal(0, 0.002, 80),
               np.full(80, 0.02), np.zeros((80, 2)))
        for _ in range(6)
    ]  # fmt: skip
    found = trend(several[0], learn(several, 0.0, 1.0))
    assert 0.015 < found.at(found.time)[1] < 0.025


def test_draws_weigh_as_a_skewed_density_whose_integral_they_give_from_a_poor_start():
    shapes = np.array([1.5, 2.0, 3.0, 5.0, 20.0])  # of gamma variates, whose logarithms are drawn
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((5, 5)))[0]

    def density(points):
        logs = points @ turn
        return 3.0 + (shapes * logs - np.exp(logs) - gammaln(shapes)).sum(axis=1)

    points, weight = weighted_draws(density, np.zeros(5), 0.5 * np.eye(5))
    share = shares(weight)
    assert 1.0 / (share**2).sum() > 500.0  # of 3000
    assert np.log(np.mean(np.exp(weight))) == pytest.approx(3.0, abs=0.1)
    logs = points @ turn
    mean, variance = polygamma(0, shapes), polygamma(1, shapes)
    np.testing.assert_allclose((share @ logs - mean) / variance**0.5, 0.0, atol=0.2)
    np.testing.assert_allclose(share @ (logs - mean) ** 2 / variance, 1.0, atol=0.3)
