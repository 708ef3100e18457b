"""Profile of a fault whose rise is smooth, or rough."""

import numpy as np
import pytest

from ematwin.estimation.profile import ROUGH, Profile, smoothed
from naive.toy import fault

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


def test_a_longer_profile_has_the_density_of_a_wider_one():
    narrow = profile_of(parabola(0.01), (0.3 - 0.0196, 0.3 + 0.0196), 1.0)
    wide = narrow.reaching(0.3 - 0.0392, 0.31)
    assert wide.interval == (0.3 - 0.0392, 0.3 + 0.0196)  # never shorter
    below = VALUES < 0.3
    assert wide.rise[below] == pytest.approx(parabola(0.02)[below])
    assert wide.rise[~below] == pytest.approx(narrow.rise[~below])
    assert share_below(wide) == pytest.approx(2.0 / 3.0 * 0.3173, abs=0.005)
    assert share_below(narrow) == pytest.approx(0.0228, abs=0.003)


def share_below(profile: Profile) -> float:
    """Probability of a value two narrow errors below the middle, or less."""
    values, mass = profile.density(fault("gap"))
    return float(mass[values < 0.28].sum())
