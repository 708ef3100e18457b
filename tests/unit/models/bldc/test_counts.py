"""Positions in counts: recognised, said, and smoothed without delay."""

import numpy as np
import pytest

from ematwin.models.bldc.counts import SmoothingSpline, said_of_steps, step_of
from ematwin.models.registry import load_actuator
from ematwin.models.simulating import simulate

TIME = np.arange(8_000) / 20_000.0
ANGLE = 3.0 * np.sin(2.0 * np.pi * 12.0 * TIME) + 0.4 * np.sin(2.0 * np.pi * 90.0 * TIME)


@pytest.mark.parametrize("steps", [500, 2_000, 10_000, 20_000])
@pytest.mark.parametrize("offset", [0.0, 0.37])
def test_counts_are_recognised_wherever_they_begin(steps, offset):
    size = 2.0 * np.pi / steps
    counted = size * np.floor(ANGLE / size + 0.2) + offset * size
    assert step_of(counted) == pytest.approx(size, rel=1e-6)
    assert step_of(np.round(counted, 6)) == pytest.approx(size, rel=1e-3)  # digits of a file
    assert step_of(counted.astype(np.float32).astype(float)) == pytest.approx(size, rel=1e-3)


@pytest.mark.parametrize(
    "position",
    [
        ANGLE,
        ANGLE + 1e-3 * np.random.default_rng(1).standard_normal(ANGLE.size),
        ANGLE.astype(np.float32).astype(float),
        np.round(ANGLE, 6),
        np.zeros(100),
    ],
    ids=["smooth", "noisy", "single precision", "six digits", "at rest"],
)
def test_other_positions_are_no_counts(position):
    assert step_of(position) == 0.0


def test_a_smoothing_spline_is_that_of_scipy():
    from scipy.interpolate import make_smoothing_spline

    noisy = ANGLE + 1e-3 * np.random.default_rng(2).standard_normal(ANGLE.size)
    theirs = make_smoothing_spline(TIME, noisy, lam=20_000.0 / (2.0 * np.pi * 700.0) ** 4)
    ours = SmoothingSpline(TIME, noisy, 700.0)
    fine = np.arange(3 * 5_000 + 1) / 60_000.0
    for order in (0, 1, 2):
        scale = np.abs(theirs(TIME, order)).max()
        np.testing.assert_allclose(ours(TIME, order), theirs(TIME, order), atol=1e-8 * scale)
        found = ours.finely(5_001, 3, order)
        np.testing.assert_allclose(found, theirs(fine, order), atol=1e-8 * scale)
        np.testing.assert_allclose(found, ours(fine, order), atol=1e-9 * scale)


def test_a_drive_records_its_counts_and_is_told_so():
    actuator = load_actuator("servo48-drive")
    record = simulate("reference", "step", actuator=actuator)
    of_motor, of_output = said_of_steps(record, actuator)
    assert of_motor.startswith("The motor position comes in steps, 10,000 in a turn (of an encoder")
    assert of_output.startswith("The output position comes in steps, 8,388,608 in a turn")
    assert said_of_steps(simulate("reference", "step"), actuator) == []
