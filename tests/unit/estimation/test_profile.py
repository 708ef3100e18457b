"""Profile of a fault whose rise is smooth, or rough."""

import numpy as np
import pytest

from ematwin.estimation.profile import ROUGH, Profile, smoothed

VALUES = np.linspace(0.2, 0.4, 21)


def profile_of(rise: np.ndarray, interval: tuple[float, float], rough: float) -> Profile:
    return Profile("gap", VALUES, rise, VALUES[:, None], interval, "bounded", (), rough)


def parabola(error: float) -> np.ndarray:
    return ((VALUES - 0.3) / error) ** 2


def test_a_parabola_is_not_rough_and_stays_as_it_is():
    rise, rough = smoothed(VALUES, parabola(0.03))
    assert rough == pytest.approx(0.0, abs=1e-9)
    assert rise == pytest.approx(parabola(0.03))


def test_scatter_of_the_rise_is_its_roughness():
    up_and_down = np.where(np.arange(len(VALUES)) % 2, 1.0, -1.0)
    _, rough = smoothed(VALUES, parabola(0.03) + 1.0 + up_and_down)
    assert rough == pytest.approx(1.0, rel=0.05)
    assert profile_of(parabola(0.03), (0.24, 0.36), rough).rough
    assert not profile_of(parabola(0.03), (0.24, 0.36), 0.9 * ROUGH).rough


def test_too_few_points_tell_no_roughness():
    assert smoothed(VALUES[:3], np.array([5.0, 0.0, 2.0]))[1] == 0.0
