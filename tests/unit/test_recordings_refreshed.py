"""Registers that a device refreshes by its own clock: `ematwin.recordings.sampling`."""

import numpy as np
import pytest

import ematwin
from ematwin.recordings.sampling import sampled

PERIOD = 0.008
STEP = 2.0 * np.pi / 4096.0


def motion(time):
    return 0.9 * np.sin(4.0 * time) + 0.2 * np.sin(15.0 * time)


def reads(clock, interval=0.01, seconds=6.0):
    """Times of reads, and what they show of a register that is refreshed every ``clock`` s."""
    rng = np.random.default_rng(7)
    time = np.arange(0.0, seconds, interval)
    time[1:] += rng.uniform(-0.05, 0.05, time.size - 1) * interval
    shown = clock * np.floor(time / clock - 0.3) + 0.3 * clock if clock else time
    return time, STEP * np.round(motion(shown) / STEP)


@pytest.mark.parametrize("interval", [0.002, 0.01, 0.02])
@pytest.mark.parametrize("clock", [0.99 * PERIOD, PERIOD, 1.0006 * PERIOD])
def test_reads_come_to_the_times_at_which_they_were_true(clock, interval):
    time, values = reads(clock, interval)
    moved, period = sampled(time, values, PERIOD)
    assert period == pytest.approx(clock, rel=5e-4)
    before, after = np.abs(values - motion(time)), np.abs(moved - motion(time))
    assert after.mean() < 0.3 * before.mean()


@pytest.mark.parametrize("clock", [0.0, 0.001])
def test_reads_that_are_samples_stay(clock):
    assert sampled(*reads(clock), PERIOD) is None


def test_reads_too_rare_for_the_clock_stay():
    time, values = reads(PERIOD)
    assert sampled(1e3 * time, values, PERIOD) is None


def test_false_reads_do_not_hide_the_clock():
    time, values = reads(PERIOD)
    values[[100, 300]] = -3.14
    moved, _ = sampled(time, values, PERIOD)
    sound = np.abs(moved - motion(time)) < 0.1
    assert sound.sum() >= time.size - 6
    assert np.abs(moved - motion(time))[sound].mean() < 2e-3


def test_positions_of_a_servo_are_read_so_and_said_to_be():
    pandas = pytest.importorskip("pandas")
    time, values = reads(PERIOD)
    table = pandas.DataFrame({"time": time, "goal_position": motion(time), "position": values})
    run = ematwin.read(table, actuator="sts3215")
    assert np.abs(run.channels["position"] - motion(run.time)).mean() < 2e-3
    assert any("after it was sampled" in text for text in run.provenance["changed"])
