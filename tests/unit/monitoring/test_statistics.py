"""The healthy population, the health index, its threshold, and names of faults."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.models.ball_screw.model import MODEL
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.base import Reported
from ematwin.monitoring.by_population import worn
from ematwin.monitoring.index import (
    DRIFT,
    WEIGHTS,
    clear_limit,
    health_index,
    limit_of,
    prediction_bound,
    single_reach,
)
from ematwin.monitoring.population import (
    Population,
    Signature,
    basis,
    fit_mean,
    nearest_fault,
)
from ematwin.monitoring.population_calibration import Thresholds

REPORTED = MODEL.monitoring.reported(MODEL, BallScrew.load())

# Population


def healthy(random, runs: int, motions: int, within: float, between: float):
    """Features (N, 2), loads and runs: a parabola in the load, and scatter of two kinds."""
    groups = np.repeat(np.arange(runs), motions)
    load = random.normal(50.0, 200.0, groups.size)
    mean = np.column_stack([1.0 + 1e-3 * load, 5.0 - 2e-6 * load**2])
    day = between * random.normal(size=(runs, 2))
    return mean + day[groups] + within * random.normal(size=mean.shape), load, groups


def test_a_parabola_over_the_load_is_found():
    """But for the twentieth by which the ridge holds slope and curvature down."""
    random = np.random.default_rng(0)
    load = np.linspace(-300.0, 300.0, 400)
    values = np.column_stack([2.0 + 0.5 * load / 200.0, 1.0 - 0.2 * ((load / 200.0) ** 2 - 1.0)])
    found = fit_mean(load, 200.0, values + 0.01 * random.normal(size=values.shape))
    np.testing.assert_allclose(found, [[2.0, 1.0], [0.5, 0.0], [0.0, -0.2]], atol=0.05)


def test_one_load_leaves_slope_and_curvature_alone():
    """Slope and curvature would be anything; the mean at that load is what was measured."""
    found = fit_mean(np.full(20, 150.0), 150.0, np.full((20, 1), 3.0))
    assert basis(np.array([150.0]), 150.0) @ found == pytest.approx(3.0, rel=0.02)
    assert abs(found[2, 0]) < 1e-9


def test_spread_has_a_part_within_runs_and_one_between_them():
    random = np.random.default_rng(1)
    features, load, groups = healthy(random, 200, 5, within=0.1, between=0.3)
    population = Population.of(features, load, groups, 200.0)
    np.testing.assert_allclose(population.within, 0.1, rtol=0.1)
    np.testing.assert_allclose(population.between, np.hypot(0.3, 0.1 / np.sqrt(5)), rtol=0.15)
    np.testing.assert_allclose(population.spread, np.hypot(population.within, population.between))


def test_scores_of_another_healthy_run_are_standard_at_any_load():
    random = np.random.default_rng(2)
    population = Population.of(*healthy(random, 500, 4, 0.1, 0.3), 200.0)
    features, load, _ = healthy(random, 2000, 1, 0.1, 0.3)
    scores = population.scores(features, load)
    np.testing.assert_allclose(scores.mean(0), 0.0, atol=0.15)
    np.testing.assert_allclose(scores.std(0), 1.0, rtol=0.1)
    assert np.abs(np.corrcoef(load, scores.T)[0, 1:]).max() < 0.1


def test_runs_of_one_motion_and_equal_features_give_finite_scores():
    features = np.ones((4, 2))
    population = Population.of(features, np.array([1.0, 2.0, 3.0, 4.0]), np.arange(4), 2.0)
    assert np.isfinite(population.scores(features, np.ones(4))).all()


def test_without_a_covariate_the_mean_is_one_and_its_value_is_not_looked_at():
    random = np.random.default_rng(4)
    features, groups = random.normal(3.0, 0.2, (300, 2)), np.repeat(np.arange(100), 3)
    population = Population.of(features, np.full(300, np.nan), groups, None)
    assert population.coefficients.shape == (1, 2)
    np.testing.assert_allclose(population.mean(np.zeros(2)), 3.0, atol=0.05)
    scores = population.scores(features, np.full(300, np.nan))
    np.testing.assert_allclose(scores.mean(0), 0.0, atol=1e-9)


def test_single_recordings_take_their_scatter_from_their_standard_errors():
    random = np.random.default_rng(5)
    features = random.normal(0.0, 0.1, (4, 2))
    errors = np.array([0.3, 0.0])
    single = Population.of(features, np.zeros(4), np.arange(4), None, errors)
    np.testing.assert_allclose(single.within, [0.3, 1e-12])
    # where runs have several, their own scatter is measured
    twice = Population.of(
        np.repeat(features, 2, 0) + np.tile([[0.05], [-0.05]], (4, 1)), np.zeros(8),
        np.repeat(np.arange(4), 2), None, errors,
    )  # fmt: skip
    np.testing.assert_allclose(twice.within, 0.05 * np.sqrt(2.0))


def test_what_lies_on_a_bound_scatters_by_its_standard_error_at_least():
    """All healthy shorts are zero: the bound hides that each might as well be 0.01."""
    features, errors = np.zeros((8, 2)), np.array([0.01, 0.01])
    groups, cut = np.repeat(np.arange(4), 2), np.array([True, False])
    population = Population.of(features, np.zeros(8), groups, None, errors, cut)
    np.testing.assert_allclose(population.within, [0.01, 1e-12])
    assert population.scores(np.full((1, 2), 0.02), np.zeros(1))[0, 0] == pytest.approx(2.0)


# Index

KINDS = ("model",) * 3 + ("mean",) * 20 + ("band",) * 30


def test_the_index_of_the_mean_is_zero_and_one_deviation_all_over_is_one():
    scores = np.vstack([np.zeros(53), np.ones(53), -2.0 * np.ones(53)])
    np.testing.assert_allclose(health_index(scores, KINDS), [0.0, 1.0, 2.0])


def test_a_magnitude_of_the_twin_counts_as_many_statistics():
    scores = np.zeros((2, 53))
    scores[0, 0] = scores[1, -1] = 3.0
    magnitude, statistic = health_index(scores, KINDS)
    assert magnitude > 1.5 * statistic


@given(st.integers(0, 52), st.floats(-1e9, 1e9))
def test_one_glitch_counts_no_more_than_its_limit(place, glitch):
    scores = np.zeros((1, 53))
    scores[0, place] = glitch
    limit = limit_of(KINDS[place], KINDS.count(KINDS[place]))
    largest = scores.copy()
    largest[0, place] = limit
    assert health_index(scores, KINDS)[0] <= health_index(largest, KINDS)[0]


@pytest.mark.parametrize("count", [1, 3, 7, 20])
def test_a_single_magnitude_reaches_as_far_however_many_there_are(count):
    assert limit_of("model", 3) == WEIGHTS["model"][1]
    kinds = ("model",) * count + ("mean",) * 20 + ("band",) * 30
    scores = np.ones((1, count + 50))
    scores[0, :count] = 0.0
    scores[0, 0] = 1e6
    assert health_index(scores, kinds)[0] == pytest.approx(single_reach(kinds))
    assert single_reach(kinds) == pytest.approx(np.sqrt(0.15 * 64.0 / 3.0 + 0.85))
    # without bands the other kinds weigh more
    assert single_reach(("model", "mean")) == pytest.approx(np.sqrt((0.15 * 64 / 3 + 0.35) / 0.5))


# Threshold


@pytest.mark.parametrize(("runs", "motions"), [(3, 4), (6, 3), (12, 2), (40, 1)])
@pytest.mark.parametrize("between", [0.0, 0.2, 0.6])
def test_a_motion_of_a_new_run_exceeds_the_bound_at_about_the_rate(runs, motions, between):
    """On logarithms that are normal.

    Three runs of a rig whose index differs by 60 % from run to run, five times what is typical, are
    taken for somewhat less scattered than they are.
    """
    random = np.random.default_rng(runs)
    groups = np.repeat(np.arange(runs), motions)
    exceeded = []
    for _ in range(1500):
        day = between * random.normal(size=runs + 1)
        log_index = day[groups] + 0.2 * random.normal(size=groups.size)
        bound = prediction_bound(np.exp(log_index), groups, 0.1)
        exceeded.append(np.exp(day[-1] + 0.2 * random.normal()) > bound)
    assert 0.02 < np.mean(exceeded) < (0.18 if (runs, between) == (3, 0.6) else 0.14)


def test_a_lower_rate_asks_for_a_higher_bound():
    random = np.random.default_rng(0)
    index, groups = np.exp(0.2 * random.normal(size=24)), np.repeat(np.arange(6), 4)
    bounds = [prediction_bound(index, groups, rate) for rate in (0.3, 0.1, 0.03, 0.01)]
    assert bounds == sorted(bounds)
    assert bounds[0] > np.exp(np.log(index).mean())


def test_fewer_motions_of_a_run_have_a_higher_threshold():
    limits = Thresholds(motion=1.3, run=0.7, run_size=5.0, false_alarm_rate=0.1)
    assert limits.of(1) == pytest.approx(1.3)
    assert limits.of(5) == pytest.approx(0.7)
    assert limits.of(9) == limits.of(5)
    steps = [limits.of(n) for n in range(1, 6)]
    assert steps == sorted(steps, reverse=True)
    # what is within a run averages out, what is between runs does not
    noise = Thresholds(motion=1.0, run=0.5, run_size=4.0, false_alarm_rate=0.1)
    assert noise.of(2) == pytest.approx(np.sqrt(0.5))
    alike = Thresholds(motion=1.0, run=1.0, run_size=4.0, false_alarm_rate=0.1)
    assert alike.of(2) == 1.0


def test_drift_of_one_magnitude_and_one_level_stays_below_the_clear_limit():
    """Added to scores at the threshold; two magnitudes, or both channels, would be too much."""
    scores = np.full((1, 53), 1.2)
    limit = clear_limit(1.2, KINDS, channels=2)
    random = np.random.default_rng(7)
    moved = np.zeros((1, 53))
    moved[0, 0] = DRIFT
    moved[0, 3:13] = DRIFT  # the level of one of two channels
    alike = [
        health_index(scores * random.choice([-1.0, 1.0], 53) + moved, KINDS)[0] for _ in range(200)
    ]
    assert np.mean(np.square(alike)) == pytest.approx(limit**2, rel=0.02)
    assert clear_limit(1.2, KINDS, channels=1) > limit > 1.2
    assert clear_limit(1.2, ("model",) * 3, channels=1) > 1.2  # nothing but magnitudes


# Names


NAMED = {one.name: one.named for one in REPORTED if one.named}


@pytest.mark.parametrize(("magnitude", "fault"), NAMED.items())
def test_physics_names_the_magnitude_that_rose_furthest(magnitude, fault):
    scores = {"friction": 3.5, "backlash": 3.5, "gain": 0.0, "roughness": 3.5, magnitude: 9.0}
    assert worn(scores, REPORTED) == fault


def test_what_wear_does_not_do_stays_unnamed():
    """Less friction, less play, another gain, or nothing clear."""
    for scores in (
        {"friction": -20.0, "backlash": -20.0, "gain": 0.0, "roughness": -20.0},
        {"friction": 0.0, "backlash": 0.0, "gain": 30.0, "roughness": 0.0},
        {"friction": 2.9, "backlash": 2.9, "gain": 0.0, "roughness": 2.9},
    ):
        assert worn(scores, REPORTED) == ""


def test_a_gain_that_falls_is_named_where_either_sense_is_a_fault():
    reported = [
        Reported("friction", "", "made up", named="friction"),
        Reported("gain", "", "made up", named="gain", either=True),
    ]
    scores = {one.name: 0.0 for one in reported} | {"gain": -14.0, "friction": 6.0}
    assert worn(scores, reported) == "gain"
    # but less friction than healthy is none
    scores |= {"gain": 0.0, "friction": -20.0}
    assert worn(scores, reported) == ""


def signatures() -> tuple[Signature, ...]:
    """Two faults: one grows with the load, the other does not."""
    first, second = np.zeros((3, 10)), np.zeros((3, 10))
    first[0, :5] = first[1, :5] = 4.0
    second[0, 5:] = 4.0
    return (Signature("dry", first, "made up"), Signature("worn", second, "made up"))


def test_a_signature_names_what_lies_near_it_at_its_load():
    random = np.random.default_rng(0)
    load = np.array([100.0, 300.0])
    for signature in signatures():
        scores = basis(load, 200.0) @ signature.coefficients + random.normal(size=(2, 10))
        assert nearest_fault(scores, load, 200.0, signatures()) == signature.fault


def test_what_no_signature_explains_stays_unnamed():
    scores = np.zeros((1, 10))
    assert nearest_fault(scores, np.zeros(1), 200.0, signatures()) == ""
    scores[0, 5:] = -4.0  # the other way
    assert nearest_fault(scores, np.zeros(1), 200.0, signatures()) == ""
