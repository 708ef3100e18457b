"""What is read from a walk along a fault, where its rise is smooth and where it is rough."""

import numpy as np
import pytest

from ematwin.estimation.walk import ROUGH, Walk, smoothed

VALUES = np.linspace(0.2, 0.4, 21)


def walk_of(rise: np.ndarray, interval: tuple[float, float], rough: float) -> Walk:
    return Walk("gap", VALUES, rise, VALUES[:, None], interval, "bounded", (), rough)


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
    assert walk_of(parabola(0.03), (0.24, 0.36), rough).rough
    assert not walk_of(parabola(0.03), (0.24, 0.36), 0.9 * ROUGH).rough


def test_too_few_points_tell_no_roughness():
    assert smoothed(VALUES[:3], np.array([5.0, 0.0, 2.0]))[1] == 0.0


def test_a_walk_that_reaches_further_has_the_density_of_a_wider_one():
    narrow = walk_of(parabola(0.01), (0.3 - 0.0196, 0.3 + 0.0196), 1.0)
    wide = narrow.reaching(0.3 - 0.0392, 0.31)
    assert wide.interval == (0.3 - 0.0392, 0.3 + 0.0196)  # never shorter
    below = VALUES < 0.3
    assert wide.rise[below] == pytest.approx(parabola(0.02)[below])
    assert wide.rise[~below] == pytest.approx(narrow.rise[~below])
    assert wide.share_beyond(0.28, 1.0, (0.0, 1.0)) == pytest.approx(2.0 / 3.0 * 0.3173, abs=0.005)
    assert narrow.share_beyond(0.28, 1.0, (0.0, 1.0)) == pytest.approx(0.0228, abs=0.003)
