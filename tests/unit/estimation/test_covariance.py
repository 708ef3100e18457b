"""Covariance: against closed forms, and silent where nothing is determined."""

import numpy as np

from ematwin import Recording
from ematwin.estimation.covariance import covariance
from ematwin.estimation.problem import Problem
from ematwin.models.comparison import Comparison
from ematwin.models.unknown import Unknown

A = Unknown("a", "", "", 0.0, -4.0, 4.0)
B = Unknown("b", "", "", 1.0, 0.1, 10.0)


class Linear(Comparison):
    """y = a u + b v with white noise of a known size."""

    model_error = 1.0

    def __init__(self, u: np.ndarray, v: np.ndarray, noise: float, seed: int = 1) -> None:
        self.u, self.v, self.noise = u, v, noise
        y = 0.5 * u + 2.0 * v + noise * np.random.default_rng(seed).standard_normal(u.size)
        self.recording = Recording(np.arange(u.size) * 1e-3, {"y": y})
        self.actuator, self.scale = None, float((y**2).sum())

    def responses(self, candidates, count):  # type: ignore[no-untyped-def]
        return {"y": np.outer(candidates["a"], self.u) + np.outer(candidates["b"], self.v)}

    def measured(self):  # type: ignore[no-untyped-def]
        return {"y": self.recording.y}

    def captions(self):  # type: ignore[no-untyped-def]
        return {"y": ("y", "")}

    def residuals(self, candidates, count):  # type: ignore[no-untyped-def]
        return (self.responses(candidates, count)["y"] - self.recording.y) / self.noise


def bases() -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, 1.0, 4000)
    return np.sin(40.0 * t), np.cos(57.0 * t)


def least_squares(u: np.ndarray, v: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(np.column_stack([u, v]), y, rcond=None)[0]


def test_white_noise_gives_the_covariance_of_least_squares() -> None:
    u, v = bases()
    found = []
    for seed in range(8):
        comparison = Linear(u, v, 0.3, seed)
        best = least_squares(u, v, comparison.recording.y)
        found.append(covariance(Problem([comparison], [A, B]), best))
    basis = np.column_stack([u, v])
    expected = 0.3**2 * np.linalg.inv(basis.T @ basis)
    assert np.allclose(np.mean(found, axis=0), expected, rtol=0.25, atol=0.1 * expected[0, 0])


def test_ranges_of_any_width_give_values_in_their_own_units() -> None:
    u, v = bases()
    comparison = Linear(u, v, 0.3)
    best = least_squares(u, v, comparison.recording.y)
    narrow = covariance(Problem([comparison], [A, B]), best)
    wide = Unknown("a", "", "", 0.0, -400.0, 400.0)
    assert np.allclose(covariance(Problem([comparison], [wide, B]), best), narrow, rtol=1e-6)
    assert np.allclose(covariance(Problem([comparison], [A, B]), best, 2.5), 6.25 * narrow)


def test_what_does_not_move_the_answer_is_not_determined() -> None:
    u, _ = bases()
    comparison = Linear(u, np.zeros(u.size), 0.3)
    found = covariance(Problem([comparison], [A, B]), np.array([0.5, 2.0]))
    assert np.isfinite(found[0, 0])
    assert found[1, 1] == np.inf
    assert found[0, 1] == 0.0


def test_two_unknowns_that_do_the_same_are_both_undetermined() -> None:
    u, _ = bases()
    found = covariance(Problem([Linear(u, u, 0.3)], [A, B]), np.array([0.5, 2.0]))
    assert (np.diag(found) == np.inf).all()


def test_a_twin_that_diverges_determines_nothing() -> None:
    u, v = bases()
    broken = Linear(np.full(u.size, 1e300), v, 1e-300)
    with np.errstate(all="ignore"):
        found = covariance(Problem([broken], [A, B]), np.array([0.5, 2.0]))
    assert (np.diag(found) == np.inf).all()
