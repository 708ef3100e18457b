"""The healthy population, the health index, its threshold, and names of faults."""

import numpy as np
import pytest

from ematwin.models.ball_screw.model import MODEL
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.base import Reported
from ematwin.monitoring.by_population import worn
from ematwin.monitoring.index import (
    prediction_bound,
)
from ematwin.monitoring.population import (
    Population,
    Signature,
    basis,
    fit_mean,
    nearest_fault,
)

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
