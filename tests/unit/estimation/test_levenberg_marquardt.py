"""Levenberg-Marquardt in batches; its ends at bounds are compared in test_problem."""

import numpy as np

from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt

LOWER, UPPER = np.zeros(3), np.ones(3)


def clip(z: np.ndarray) -> np.ndarray:
    return np.clip(z, LOWER, UPPER)


def run(residuals, start, iterations=25):
    descent = LevenbergMarquardt.start(start, residuals, damping=0.1)
    for _ in range(iterations):
        descent.iterate(residuals, LOWER, UPPER, clip)
    return descent


def curved(z: np.ndarray) -> np.ndarray:
    t = np.linspace(0.0, 1.0, 60)
    model = z[:, :1] * np.exp(-3.0 * z[:, 1:2] * t) + z[:, 2:] * t
    truth = 0.7 * np.exp(-3.0 * 0.4 * t) + 0.2 * t
    return model - truth


def test_diverged_simulations_are_stepped_around() -> None:
    def broken(z: np.ndarray) -> np.ndarray:
        r = curved(z)
        r[z[:, 0] > 0.8] = np.inf
        return r

    end = run(broken, np.array([[0.3, 0.3, 0.3]])).best(1)
    assert np.allclose(end.points[0], [0.7, 0.4, 0.2], atol=1e-3)
