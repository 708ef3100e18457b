"""The healthy population, and the probabilities of what may have changed."""

import numpy as np
import pytest

from ematwin.estimation.verdict import UNNAMED
from ematwin.monitoring.population import Causes, Direction, Parabola, Population

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
    found = Parabola.of(values + 0.01 * random.normal(size=values.shape), load, 200.0)
    expected = [[2.0, 1.0], [0.5, 0.0], [0.0, -0.2]]
    np.testing.assert_allclose(found.coefficients, expected, atol=0.05)
    np.testing.assert_allclose(found.at(load), values, atol=0.1)


def test_without_a_covariate_a_parabola_is_the_mean():
    values = np.random.default_rng(0).normal(size=(7, 3))
    np.testing.assert_allclose(Parabola.of(values, np.zeros(7), 1.0).at(0.0), values.mean(0))


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


# Causes

SIZE = 20


def always(shift: np.ndarray) -> Parabola:
    return Parabola(1.0, np.outer([1.0, 0.0, 0.0], shift))


ANYTHING = Direction(UNNAMED, always(np.zeros(SIZE)), around=np.ones(SIZE, dtype=bool))


def causes(random, *taught: Direction, runs: int = 8) -> Causes:
    """Independent scores of 20 kinds; the first one names "dry" where it is raised."""
    scores, groups = random.normal(size=(5 * runs, SIZE)), np.repeat(np.arange(runs), 5)
    first = np.eye(SIZE)[0]
    moved = [Direction("dry", always(first)), Direction(UNNAMED, always(-first)), ANYTHING]
    return Causes(scores, groups, np.zeros((1, SIZE)), [*moved, *taught])


def probabilities(of: Causes, scores: np.ndarray) -> dict[str, float]:
    rows = np.atleast_2d(scores)
    found = of.posterior(rows, np.zeros(len(rows)))
    total = sum(found.probabilities.values()) + found.healthy
    assert total == pytest.approx(1.0)
    return {"healthy": found.healthy, **found.probabilities}


def lead(of: Causes, scores: np.ndarray) -> str:
    found = probabilities(of, scores)
    name = max(found, key=lambda key: found[key])
    assert found[name] > 0.95, found
    return name


def test_healthy_recordings_are_seldom_called_changed():
    random = np.random.default_rng(0)
    of = causes(random)
    healthy = [probabilities(of, random.normal(size=SIZE))["healthy"] for _ in range(200)]
    assert np.mean(np.array(healthy) < 0.05) < 0.03
    assert np.median(healthy) > 0.7


def test_a_raised_quantity_names_its_fault_and_a_lowered_one_none():
    of = causes(np.random.default_rng(0))
    shift = np.eye(SIZE)[0]
    assert lead(of, 12.0 * shift) == "dry"
    assert lead(of, -12.0 * shift) == UNNAMED


def test_what_no_direction_explains_is_a_change_without_a_name():
    random = np.random.default_rng(1)
    found = probabilities(causes(random), 6.0 * random.choice([-1.0, 1.0], SIZE))
    assert found["healthy"] < 1e-3
    assert found["dry"] < 0.5 < found[UNNAMED]


def test_recordings_with_a_fault_name_what_lies_along_them_at_another_size():
    random = np.random.default_rng(2)
    worn = np.r_[np.zeros(10), np.full(10, 4.0)]
    of = causes(random, Direction("worn", always(worn), taught=True))
    for size in (0.5, 1.0, 2.0):
        assert lead(of, size * worn + 0.5 * random.normal(size=SIZE)) == "worn"
    opposite = probabilities(of, -worn)
    assert opposite["healthy"] < 1e-3
    assert opposite["worn"] < 0.6
    assert of.posterior(worn[None], np.zeros(1)).likeness == {"worn"}


def test_motions_of_a_run_tell_more_than_one_of_them():
    random = np.random.default_rng(3)
    of = causes(random)
    shift = 3.5 * np.eye(SIZE)[0]
    one, five = (probabilities(of, np.tile(shift, (n, 1)))["healthy"] for n in (1, 5))
    assert five < 0.5 * one


def test_what_scatters_together_is_no_change_where_it_moves_together():
    """Scores that differ between runs by a common share, and one that departs from the others."""
    random = np.random.default_rng(4)
    common = 3.0 * random.normal(size=(30, 1))
    scores = common + 0.3 * random.normal(size=(30, SIZE))
    of = Causes(scores, np.arange(30), np.zeros((1, SIZE)), [ANYTHING])
    assert lead(of, np.full(SIZE, 3.0)) == "healthy"
    assert lead(of, 3.0 * np.sign(np.arange(SIZE) % 2 - 0.5)) == UNNAMED
