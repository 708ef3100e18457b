"""Phases of a command, and what is measured in each."""

import numpy as np
import pytest

from ematwin.models.phases import phases
from ematwin.monitoring.measure import BANDS, Motion, band_levels
from made_up_rig import rig

INTERVAL = 0.04


MODEL = ("friction", "backlash", "gain")


CHANNELS = ("current", "position_error")


def out_and_back(way: int = 100, rest: int = 60, shift: float = 0.0) -> np.ndarray:
    """A set point, m; its corners ``shift`` of a sample late."""
    corners = np.array([0, way, way + rest, 2 * way + rest]) + shift
    return np.interp(np.arange(2 * way + rest), corners, [0.0, 0.1, 0.1, 0.0])


def test_out_rest_and_back_have_a_transient_and_a_steady_part_each():
    found = phases(out_and_back(), INTERVAL, 1.4)
    assert [phase.title for phase in found] == [
        "out, transient", "out, steady", "rest, transient", "rest, steady", "back, transient",
        "back, steady",
    ]  # fmt: skip


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5, 0.9])
def test_a_corner_between_two_samples_is_one_change(shift):
    found = phases(out_and_back(shift=shift), INTERVAL, 1.4)
    assert [phase.name for phase in found] == ["out"] * 2 + ["rest"] * 2 + ["back"] * 2
    for phase, first in zip(found[::2], (0, 100, 160), strict=True):
        assert phase.samples.start == pytest.approx(first, abs=2)
        assert phase.samples.stop - phase.samples.start == 35  # 1.4 s


def test_phases_that_come_again_are_numbered():
    twice = np.r_[out_and_back(), out_and_back()]
    names = [phase.name for phase in phases(twice, INTERVAL, 1.4) if phase.steady]
    assert names == ["out", "rest", "back", "out 2", "rest 2", "back 2"]


@pytest.mark.parametrize("period", [20, 50, 100, 200, 400, 2000])
def test_a_sine_is_cut_into_equal_parts(period):
    sine = 0.05 * np.sin(2.0 * np.pi * np.arange(320) / period)
    found = phases(sine, INTERVAL, 1.4)
    assert [phase.name for phase in found] == [f"part {n}" for n in range(1, 9)]
    assert not any(phase.steady for phase in found)
    assert {phase.samples.stop - phase.samples.start for phase in found} == {40}


def values(current: np.ndarray, error: np.ndarray) -> dict[str, float]:
    magnitudes = {"friction": 1.1, "backlash": 2e-4, "gain": 0.9, "load": 100.0}
    of = Motion(out_and_back(), INTERVAL, 1.4, CHANNELS)
    found = of.features(rig(), magnitudes, np.array([current, error]))
    assert [one.name for one in found] == [one.name for one in of.layout(rig())]
    return {one.name: one.value for one in found}


def test_means_say_where_a_residual_lies():
    current = np.zeros(260)
    current[105:130] = 0.5  # while the rest settles
    seen = values(current, np.full(260, 1e-3))
    assert seen["current mean, out, steady"] == 0.0
    assert [seen[f"current part {n}, rest, transient"] for n in (2, 3)] == [0.5, 0.5]
    assert seen["current mean, rest, steady"] == 0.0
    assert seen["error mean, back, steady"] == pytest.approx(1e-3)
    assert [seen[name] for name in MODEL] == [1.1, 2e-4, 0.9]


@pytest.mark.parametrize("band", range(len(BANDS) - 1))
def test_a_swing_shows_in_its_own_band(band):
    nyquist_share = 0.5 * (BANDS[band] + BANDS[band + 1])
    swing = np.sin(np.pi * nyquist_share * np.arange(100) + 0.3)
    levels = band_levels(swing)
    assert int(np.argmax(levels)) == band
    # ten times the amplitude is a step of ln 10, in each band
    np.testing.assert_allclose(
        np.array(band_levels(10.0 * swing)) - levels, np.log(10.0), rtol=1e-6
    )


def test_noise_of_every_length_has_the_level_of_its_standard_deviation():
    random = np.random.default_rng(1)
    for size in (24, 60, 200):
        levels = [band_levels(0.3 * random.normal(size=size)) for _ in range(400)]
        power = np.exp(2.0 * np.array(levels)).mean(0)
        np.testing.assert_allclose(np.sqrt(power[1:]), 0.3, rtol=0.1)
