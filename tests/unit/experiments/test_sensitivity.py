"""Sobol indices of an answer, against functions whose indices are known."""

import json

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError
from ematwin.experiments.sensitivity import indices, sampled


def indices_of(function, bounds, samples):
    points = sampled(np.array(bounds), samples, 1)
    answers = function(points.reshape(-1, len(bounds)))
    return indices(answers.reshape(*points.shape[:2], -1))


def test_ishigami_has_its_published_indices():
    """Ishigami and Homma 1990; a = 7, b = 0.1: 0.3139, 0.4424, 0 and 0.5576, 0.4424, 0.2437."""

    def ishigami(x):
        return np.sin(x[:, 0]) * (1.0 + 0.1 * x[:, 2] ** 4) + 7.0 * np.sin(x[:, 1]) ** 2

    first, total = indices_of(ishigami, [[-np.pi, np.pi]] * 3, 4096)
    assert first == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)
    assert total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.02)


def test_times_count_by_their_variance():
    """y(t) = a x_1 sin t + b x_2 cos t: shares are a^2 <sin^2> and b^2 <cos^2> over their sum."""
    t = np.linspace(0.0, 1.0, 30)

    def answer(x):
        return 3.0 * x[:, :1] * np.sin(t) + 2.0 * x[:, 1:] * np.cos(t)

    parts = np.array([9.0 * np.sum(np.sin(t) ** 2), 4.0 * np.sum(np.cos(t) ** 2)])
    for found in indices_of(answer, [[0.0, 1.0]] * 2, 1024):
        assert found == pytest.approx(parts / parts.sum(), abs=0.01)


def test_faults_of_an_actuator_share_its_current():
    found = ematwin.sensitivity(actuator="rm1605", exact=True, samples=32)
    assert {"friction", "backlash", "gain"} <= set(found.names)
    for total in found.total.values():
        assert np.all(total > -0.05)
        assert total.sum() > 0.5
    assert found.answers == 32 * (len(found.names) + 2)
    json.dumps(found.as_dict(), allow_nan=False)
    assert found.rows("current")


def test_samples_are_a_power_of_two():
    with pytest.raises(InputError, match="power of two, received 100"):
        ematwin.sensitivity(actuator="rm1605", samples=100)
