"""Phases of a command, and what is measured in each."""

import numpy as np
import pytest

from ematwin.models.phases import phases

INTERVAL = 0.04


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
    assert [phase.moving for phase in found] == [True, True, False, False, True, True]


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


# Features
