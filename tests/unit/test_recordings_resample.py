"""Times and rates: what is brought to a constant rate keeps what it was."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ematwin
from bench_files import write_mdf
from ematwin.errors import RecordError
from ematwin.models.registry import model_of
from ematwin.recordings.recording import Recording

RATE = 100_000.0
TIME = np.arange(20_000) / RATE


def read(time, values, rate=None, name="command"):
    zero = np.zeros(time.size)
    columns = {"command": zero, "current_a": zero, "current_b": zero, name: values}
    record = ematwin.read(pd.DataFrame({"time": time, **columns}), resample_to=rate)
    assert rate is None or record.sample_rate == pytest.approx(rate)
    return record


def changes(record: Recording) -> str:
    return " ".join(text for text in record.provenance["changed"] if "derived" not in text)


def tone(frequency: float, time: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * time + 0.3)


@pytest.mark.parametrize("rate", [20_000.0, 25_000.0, 7_000.0, 30_000.0, 44_100.0])
def test_what_the_new_rate_can_hold_is_kept(rate: float) -> None:
    record = read(TIME, tone(500.0, TIME), rate)
    away = record.command - tone(500.0, record.time)
    np.testing.assert_allclose(away[60:-60], 0.0, atol=2e-4)
    assert "the rate was lowered" in changes(record)


@pytest.mark.parametrize("rate", [20_000.0, 7_000.0, 30_000.0])
@pytest.mark.parametrize("name", ["output_position", "current_a"])
def test_what_the_new_rate_cannot_hold_is_gone_and_does_not_alias(rate: float, name: str) -> None:
    for frequency in (0.51 * rate, 0.9 * rate, 1.01 * rate, 45_000.0):
        record = read(TIME, tone(frequency, TIME), rate, name)
        assert np.abs(record.channels[name][60:-60]).max() < 5e-4, frequency


@pytest.mark.parametrize("rate", [50_000.0, 20_000.0, 12_500.0, 7_000.0])
def test_currents_keep_the_convention_of_a_record(rate: float) -> None:
    """A mean over the interval that ends at the time, before and after."""

    def mean_before(time: np.ndarray, interval: float) -> np.ndarray:
        w = 2 * np.pi * 300.0
        return (np.cos(w * (time - interval)) - np.cos(w * time)) / (w * interval)

    record = read(TIME, mean_before(TIME, 1 / RATE), rate, "current_a")
    wanted = mean_before(record.time, 1 / rate)
    # a low-pass is no mean: at 300 Hz the mean over 1/7000 s is lower by 0.3 %
    allowed = 1e-3 + (np.pi * 300.0 / rate) ** 2 / 6
    np.testing.assert_allclose(record.current_a[60:-60], wanted[60:-60], atol=allowed)
    shift = np.sin(np.pi * 300.0 * (1 / rate - 1 / RATE))
    assert allowed < 0.5 * shift or rate == 50_000.0  # the test would see a missing shift


def test_a_rate_is_raised_by_interpolation() -> None:
    slow = np.arange(2000) / 10_000.0
    record = read(slow, tone(100.0, slow), 40_000.0)
    assert len(record) == 7997
    np.testing.assert_allclose(record.command, tone(100.0, record.time), atol=2e-3)
    assert "adds no information" in changes(record)


def test_the_recorded_rate_changes_nothing() -> None:
    values = np.random.default_rng(0).normal(size=TIME.size)
    record = read(TIME, values, RATE)
    np.testing.assert_array_equal(record.time, TIME)
    np.testing.assert_array_equal(record.command, values)
    assert not changes(record)


def test_jitter_is_evened_out_and_steps_do_not_overshoot() -> None:
    jittered = TIME + np.random.default_rng(2).uniform(-0.3, 0.3, TIME.size) / RATE
    record = read(jittered, tone(200.0, jittered))
    np.testing.assert_allclose(record.command, tone(200.0, record.time), atol=1e-4)
    assert "uneven times" in changes(record)
    stepped = read(jittered, np.where(jittered > 0.1, 1.0, 0.0)).command
    assert (stepped.min(), stepped.max()) == (0.0, 1.0)


def test_lost_single_samples_are_bridged_and_counted() -> None:
    time = np.delete(TIME, [500, 900, 901, 7000])
    record = read(time, tone(200.0, time))
    np.testing.assert_allclose(record.command, tone(200.0, TIME), atol=1e-3)
    assert "single samples were missing 3 times" in changes(record)


def test_too_short_for_the_filter_is_refused() -> None:
    with pytest.raises(RecordError, match="too short"):
        read(TIME[:50], TIME[:50], 1000.0)


def two_bases(path, command, current):
    """Read an MDF file with a group for the command and one for the current, a mean."""
    groups = (
        (command[0], {"command": (command[1], "rad")}),
        (current[0], {"current": (current[1], "A")}),
    )
    return ematwin.read(write_mdf(path / "run.mf4", *groups))


def test_a_slow_base_is_brought_to_a_fast_one_and_back(tmp_path: Path) -> None:
    slow = np.arange(200) / 1000.0
    record = two_bases(tmp_path, (slow, tone(20.0, slow)), (TIME, TIME))
    np.testing.assert_allclose(record.command, tone(20.0, record.time), atol=1e-3)
    noisy = tone(20.0, TIME) + tone(9_990.0, TIME)
    record = two_bases(tmp_path, (TIME, noisy), (slow, slow))
    away = record.command - tone(20.0, record.time)
    np.testing.assert_allclose(away[20:-20], 0.0, atol=1e-3)


def test_a_gap_of_a_slow_base_stays_a_hole(tmp_path: Path) -> None:
    slow = np.arange(200) / 1000.0
    slow = slow[(slow < 0.05) | (slow > 0.08)]
    with pytest.raises(RecordError, match=r"from 0\.0490\d* to 0\.080\d* s"):
        two_bases(tmp_path, (slow, slow), (TIME, TIME))


@pytest.mark.parametrize("digits", [3, 4, 5])
def test_rounded_times_are_put_on_their_grid(digits: int) -> None:
    exact = np.arange(10_001) / 19_841.0
    record = read(np.round(exact, digits), exact)
    np.testing.assert_allclose(record.time, exact, atol=10.0**-digits)
    assert record.sample_rate == pytest.approx(19_841.0, rel=1e-4)
    assert "too few digits" in changes(record)


@pytest.mark.parametrize("missing", [[1000], [100, 150, 900, 1200, 1210, 2000, 2500, 2501]])
def test_rows_that_were_lost_stretch_no_others(missing: list[int]) -> None:
    """Times in ms at 1 kHz look as if they were rounded from somewhat less."""
    exact = np.round(np.arange(3001) / 1000.0, 3)
    left = np.delete(exact, missing)
    record = read(left, left)
    np.testing.assert_allclose(record.time, exact, atol=1e-9)
    assert "single samples were missing" in changes(record)


def test_times_of_single_precision_and_of_a_calendar_are_put_right() -> None:
    exact = 10.0 + np.arange(20_000) / RATE
    record = read(exact.astype(np.float32).astype(float), exact)
    np.testing.assert_allclose(np.diff(record.time), 1 / RATE, rtol=1e-4)
    record = read(1.7e9 + TIME, TIME)
    assert record.time[0] == 0.0
    assert "counted from its first sample" in changes(record)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t[::-1], "must increase"),
        (lambda t: np.r_[t[:10], t[5:]], r"sample 10 .* follows .*first of 1 such places"),
        (lambda t: np.r_[t[:500] ** 1.1, t[499] ** 1.1, t[500:] ** 1.1], "sample 500 "),
        (lambda t: np.where(t > 0.1, np.nan, t), "NaN or infinite in"),
        (lambda t: t[:1], "at least two"),
        (lambda t: np.r_[t, 1e300], "reaches 1e"),
    ],
)
def test_times_that_make_no_record_are_refused(change, said):
    time = change(TIME)
    with pytest.raises(RecordError, match=said):
        read(time, np.zeros(time.size))


# Sampled faster than it is compared


def test_fast_currents_are_averaged_to_those_of_a_slower_simulation() -> None:
    slow, fast = (ematwin.simulate("monitor", sample_rate=rate) for rate in (20e3, 100e3))
    found = model_of("bldc").averaged(fast)
    assert len(found) == len(slow)
    np.testing.assert_allclose(found.time, slow.time, atol=1e-12)
    away = np.abs(found.current - slow.current)
    # steps of 10 and 50 us: they differ in the one or two samples behind an impact
    assert np.sqrt(np.mean(away**2)) < 0.015 * np.sqrt(np.mean(slow.current**2))
    assert np.median(away) < 1e-4 * np.sqrt(np.mean(slow.current**2))


def test_power_is_a_product_of_samples_and_keeps_all_of_them() -> None:
    fast = ematwin.simulate("monitor", sample_rate=100e3)
    with_supply = fast.changed(bus_current=np.ones(len(fast)))
    assert model_of("bldc").averaged(with_supply) is with_supply


def test_a_fast_recording_is_identified_and_shown_as_it_is_compared() -> None:
    faults = {"friction": 0.3, "backlash": 0.05}
    fast = ematwin.simulate("reference", faults=faults, sample_rate=100e3)
    found = ematwin.identify(fast, exact=True)
    assert found.faults.as_dict()["friction"] == pytest.approx(0.3, abs=0.01)
    assert found.faults.as_dict()["backlash"] == pytest.approx(0.05, abs=0.01)
    assert found.recording is not None
    assert found.recording.sample_rate == pytest.approx(20e3)
    assert any("averaged from 100000" in text for text in found.provenance["changed"])
    assert len(fast) == 50_001  # that of the caller is left alone
