"""What is known beforehand: rows of a problem, conditions, and what need not be simulated twice."""

import numpy as np
import pytest

from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Unknown
from naive.toy import Line

SLOPE = Unknown("slope", "A/s", "", 0.0, -5.0, 5.0)
OFFSET = Unknown("offset", "A", "", 0.0, -2.0, 2.0, role="nuisance", spread=0.5)
MASS = Unknown("mass", "kg", "", 2.0, 0.5, 8.0, logarithmic=True)
NAMES = ("slope", "mass", "offset")
MEAN = np.array([0.4, np.log(2.5), -0.1])
COVARIANCE = np.array([[0.5, 0.12, 0.3], [0.12, 0.2, -0.05], [0.3, -0.05, 0.4]])
PRIOR = Prior(NAMES, MEAN, COVARIANCE)


def points_of(problem: Problem, count: int) -> np.ndarray:
    share = np.random.default_rng(3).random((count, len(problem.names)))
    return problem.lower + share * (problem.upper - problem.lower)


def coordinates(points: np.ndarray) -> np.ndarray:
    """Of slope, mass and offset, in the order of the prior."""
    return np.column_stack([points[:, 0], np.log(points[:, 1]), points[:, 2]])


def mahalanobis(away: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Squared distances (N,) of (N, P) deviations, row by row."""
    return np.array([row @ np.linalg.solve(covariance, row) for row in away])


def test_prior_rows_are_the_mahalanobis_distance_in_units_of_the_noise() -> None:
    problem = Problem([Line(1.0, noise=0.1)], [SLOPE, MASS, OFFSET], prior=PRIOR)
    points = points_of(problem, 20)
    rows = problem.split(problem.residuals(points)).priors
    expected = mahalanobis(coordinates(points) - MEAN, COVARIANCE)
    assert np.allclose((rows**2).sum(axis=1), problem.noise**2 * expected)
    data = (problem.split(problem.residuals(points)).data ** 2).sum(axis=1)
    assert np.allclose(problem.costs(points), data + problem.noise**2 * expected)


def test_a_condition_is_what_samples_of_the_joint_distribution_show() -> None:
    x = np.random.default_rng(1).multivariate_normal(MEAN, COVARIANCE, 200_000)
    # of jointly normal values the condition is the regression on what is known, and what it leaves
    known = {"slope": 1.2, "offset": -0.6}
    basis = np.column_stack([np.ones(len(x)), x[:, 0], x[:, 2]])
    weights, *_ = np.linalg.lstsq(basis, x[:, 1], rcond=None)
    left = x[:, 1] - basis @ weights
    found = PRIOR.given(known)
    assert found.names == ("mass",)
    assert found.mean[0] == pytest.approx(weights @ [1.0, 1.2, -0.6], abs=0.01)
    assert found.covariance[0, 0] == pytest.approx(left.var(), rel=0.02)


def test_a_condition_on_one_value_keeps_the_others_correlated() -> None:
    x = np.random.default_rng(2).multivariate_normal(MEAN, COVARIANCE, 400_000)
    near = x[np.abs(x[:, 1] - 1.2) < 0.02][:, [0, 2]]
    found = PRIOR.given({"mass": 1.2})
    assert found.names == ("slope", "offset")
    assert np.allclose(found.mean, near.mean(axis=0), atol=0.03)
    assert np.allclose(found.covariance, np.cov(near.T), atol=0.02)


def test_holding_costs_what_the_full_problem_costs_there() -> None:
    full = Problem(
        [Line(1.0, noise=0.1), Line(2.0, noise=0.1)], [SLOPE, MASS, OFFSET], prior=PRIOR
    ).with_noise(0.3)
    held = {"mass": 3.0, "slope": -0.5}
    small = full.holding(held)
    assert small.names == ("offset",)
    points = points_of(full, 12)
    points[:, 0], points[:, 1] = held["slope"], held["mass"]
    gap = full.costs(points) - small.costs(points[:, 2:])
    # the same but for what the held values themselves are away from their prior
    away = coordinates(points)[:, :2] - MEAN[:2]
    assert np.allclose(gap, 0.3**2 * mahalanobis(away, COVARIANCE[:2, :2]), atol=1e-9)
    assert small.noise == full.noise
