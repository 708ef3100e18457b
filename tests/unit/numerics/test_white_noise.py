"""The white noise on a trace, apart from how it moves."""

import numpy as np
import pytest

from ematwin.numerics.white_noise import white_noise

TIME = np.arange(10_000) / 20_000.0
MOTION = 5.0 * np.sin(2.0 * np.pi * 40.0 * TIME) + 3.0 * TIME


@pytest.mark.parametrize("size", [1e-3, 0.1, 2.0])
def test_noise_is_found_beneath_a_motion(size: float) -> None:
    noise = size * np.random.default_rng(1).standard_normal(TIME.size)
    assert white_noise(MOTION + noise) == pytest.approx(size, rel=0.05)


def test_a_smooth_trace_has_none() -> None:
    assert white_noise(MOTION) < 1e-4


def test_commutations_are_no_noise() -> None:
    noise = 0.1 * np.random.default_rng(2).standard_normal(TIME.size)
    steps = 4.0 * (np.arange(TIME.size) // 200 % 2)
    assert white_noise(MOTION + steps + noise) == pytest.approx(0.1, rel=0.1)


def test_a_few_samples_tell_nothing() -> None:
    assert white_noise(np.array([0.0, 1.0, 0.0, 1.0])) == 0.0
