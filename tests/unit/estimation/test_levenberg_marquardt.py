"""Levenberg-Marquardt in batches, against scipy's and against closed forms."""

import numpy as np
from scipy.optimize import least_squares

from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt

LOWER, UPPER = np.zeros(3), np.ones(3)


def clip(z: np.ndarray) -> np.ndarray:
    return np.clip(z, LOWER, UPPER)


def run(residuals, start: np.ndarray, iterations: int = 25) -> LevenbergMarquardt:  # type: ignore[no-untyped-def]
    descent = LevenbergMarquardt.start(start, residuals, damping=0.1)
    for _ in range(iterations):
        descent.iterate(residuals, LOWER, UPPER, clip)
    return descent


def curved(z: np.ndarray) -> np.ndarray:
    t = np.linspace(0.0, 1.0, 60)
    model = z[:, :1] * np.exp(-3.0 * z[:, 1:2] * t) + z[:, 2:] * t
    truth = 0.7 * np.exp(-3.0 * 0.4 * t) + 0.2 * t
    return model - truth


def test_finds_the_parameters_of_a_curve_from_several_starts() -> None:
    starts = np.array([[0.1, 0.9, 0.9], [0.9, 0.1, 0.5], [0.5, 0.5, 0.0]])
    descent = run(curved, starts)
    assert np.allclose(descent.points, [0.7, 0.4, 0.2], atol=1e-4)


def test_ends_where_scipy_ends_when_bounds_are_active() -> None:
    t = np.linspace(0.0, 1.0, 40)

    def residuals(z: np.ndarray) -> np.ndarray:
        return z[:, :1] + z[:, 1:2] * t + z[:, 2:] * t**2 - (1.4 + 0.3 * t - 0.5 * t**2)

    ours = run(residuals, np.array([[0.2, 0.2, 0.2]])).best(1)
    theirs = least_squares(lambda z: residuals(z[None])[0], [0.2, 0.2, 0.2], bounds=(0.0, 1.0))
    assert np.allclose(ours.points[0], theirs.x, atol=1e-4)
    assert np.isclose(ours.costs[0], 2.0 * theirs.cost, rtol=1e-4)


def test_cost_never_rises() -> None:
    descent = LevenbergMarquardt.start(np.array([[0.9, 0.9, 0.9]]), curved, damping=10.0)
    costs = [descent.costs[0]]
    for _ in range(15):
        descent.iterate(curved, LOWER, UPPER, clip)
        costs.append(descent.costs[0])
    assert (np.diff(costs) <= 0.0).all()


def test_diverged_simulations_are_stepped_around() -> None:
    def broken(z: np.ndarray) -> np.ndarray:
        r = curved(z)
        r[z[:, 0] > 0.8] = np.inf
        return r

    end = run(broken, np.array([[0.3, 0.3, 0.3]])).best(1)
    assert np.allclose(end.points[0], [0.7, 0.4, 0.2], atol=1e-3)
