"""Times and rates: what is brought to a constant rate keeps what it was."""

from pathlib import Path

import numpy as np
import pytest

from ematwin.errors import InputError, RecordError
from ematwin.recordings.recording import is_regular
from ematwin.recordings.sampling import onto, tidy_time, to_constant_rate

PATH = Path("bench.csv")
RATE = 100_000.0
TIME = np.arange(20_000) / RATE
MEANS = {"current_a"}


def lowered(values: np.ndarray, rate: float, name: str = "output_position") -> tuple:
    columns = {name: values.copy()}
    time, columns, said = to_constant_rate(TIME.copy(), columns, rate, PATH, means=MEANS)
    assert said
    assert is_regular(time)
    return time, columns[name]


@pytest.mark.parametrize("rate", [20_000.0, 25_000.0, 7_000.0, 30_000.0, 44_100.0])
def test_what_the_new_rate_can_hold_is_kept(rate: float) -> None:
    tone = np.sin(2 * np.pi * 500.0 * TIME + 0.3)
    time, values = lowered(tone, rate)
    inside = slice(60, -60)
    wanted = np.sin(2 * np.pi * 500.0 * time + 0.3)
    np.testing.assert_allclose(values[inside], wanted[inside], atol=2e-4)


@pytest.mark.parametrize("rate", [20_000.0, 7_000.0, 30_000.0])
@pytest.mark.parametrize("name", ["output_position", "current_a"])
def test_what_the_new_rate_cannot_hold_is_gone_and_does_not_alias(rate: float, name: str) -> None:
    for frequency in (0.51 * rate, 0.9 * rate, 1.01 * rate, 45_000.0):
        tone = np.sin(2 * np.pi * frequency * TIME + 0.3)
        _, values = lowered(tone, rate, name)
        assert np.abs(values[60:-60]).max() < 5e-4, frequency


@pytest.mark.parametrize("rate", [50_000.0, 20_000.0, 12_500.0, 7_000.0])
def test_currents_keep_the_convention_of_a_record(rate: float) -> None:
    """A mean over the interval that ends at the time, before and after."""

    def mean_before(time: np.ndarray, interval: float) -> np.ndarray:
        w = 2 * np.pi * 300.0
        return (np.cos(w * (time - interval)) - np.cos(w * time)) / (w * interval)

    time, values = lowered(mean_before(TIME, 1 / RATE), rate, "current_a")
    wanted = mean_before(time, 1 / rate)
    # a low-pass is no mean: at 300 Hz the mean over 1/7000 s is lower by 0.3 %
    allowed = 1e-3 + (np.pi * 300.0 / rate) ** 2 / 6
    np.testing.assert_allclose(values[60:-60], wanted[60:-60], atol=allowed)
    shift = np.sin(np.pi * 300.0 * (1 / rate - 1 / RATE))
    assert allowed < 0.5 * shift or rate == 50_000.0  # the test would see a missing shift


def test_lines_and_levels_are_kept_to_the_ends() -> None:
    _, level = lowered(np.full(TIME.size, 3.0), 20_000.0)
    np.testing.assert_allclose(level, 3.0, rtol=1e-12)
    time, line = lowered(2.0 * TIME - 1.0, 20_000.0)
    np.testing.assert_allclose(line, 2.0 * time - 1.0, atol=1e-12)


def test_a_rate_is_raised_by_interpolation() -> None:
    slow = np.arange(2000) / 10_000.0
    tone = np.sin(2 * np.pi * 100.0 * slow)
    time, columns, said = to_constant_rate(slow, {"command": tone}, 40_000.0, PATH)
    assert time.size == 7997
    np.testing.assert_allclose(columns["command"], np.sin(2 * np.pi * 100.0 * time), atol=2e-3)
    assert "adds no information" in said[0]


def test_the_recorded_rate_changes_nothing() -> None:
    values = np.random.default_rng(0).normal(size=TIME.size)
    time, columns, said = to_constant_rate(TIME, {"command": values}, RATE, PATH)
    assert time is TIME
    assert columns["command"] is values
    assert said == []


def test_jitter_is_evened_out() -> None:
    rng = np.random.default_rng(2)
    jittered = TIME + rng.uniform(-0.3, 0.3, TIME.size) / RATE
    tone = np.sin(2 * np.pi * 200.0 * jittered)
    time, columns, said = to_constant_rate(jittered, {"command": tone}, None, PATH)
    assert is_regular(time)
    np.testing.assert_allclose(columns["command"], np.sin(2 * np.pi * 200.0 * time), atol=1e-4)
    assert "uneven times" in said[0]


def test_lost_single_samples_are_bridged_and_counted() -> None:
    kept = np.ones(TIME.size, dtype=bool)
    kept[[500, 900, 901, 7000]] = False
    tone = np.sin(2 * np.pi * 200.0 * TIME)
    time, columns, said = to_constant_rate(TIME[kept], {"command": tone[kept]}, None, PATH)
    assert time.size == TIME.size
    np.testing.assert_allclose(columns["command"], tone, atol=1e-3)
    assert "single samples were missing 3 times" in said[0]


def test_steps_of_a_command_do_not_overshoot_where_times_are_uneven() -> None:
    rng = np.random.default_rng(2)
    jittered = TIME + rng.uniform(-0.3, 0.3, TIME.size) / RATE
    step = np.where(jittered > 0.1, 1.0, 0.0)
    _, columns, _ = to_constant_rate(jittered, {"command": step}, None, PATH)
    assert columns["command"].min() >= 0.0
    assert columns["command"].max() <= 1.0


def test_interpolation_in_blocks_is_seamless() -> None:
    long = np.arange(150_000) / RATE
    tone = np.sin(2 * np.pi * 400.0 * long)
    time, columns, _ = to_constant_rate(long, {"command": tone}, 30_000.0, PATH)
    wanted = np.sin(2 * np.pi * 400.0 * time)
    np.testing.assert_allclose(columns["command"][60:-60], wanted[60:-60], atol=2e-4)


def test_too_short_for_the_filter_is_refused() -> None:
    with pytest.raises(RecordError, match="too short"):
        to_constant_rate(TIME[:50], {"command": TIME[:50]}, 1000.0, PATH)


@pytest.mark.parametrize("rate", ["fast", -1.0, 0.0, np.nan, "5 kA"])
def test_impossible_rates_are_refused(tmp_path: Path, rate: object) -> None:
    from ematwin.models.reading import read

    with pytest.raises(InputError, match="resample_to"):
        read(tmp_path / "any.csv", resample_to=rate)  # type: ignore[arg-type]


def test_a_slow_base_is_brought_to_a_fast_one_and_back() -> None:
    slow = np.arange(0, 200) / 1000.0
    smooth = np.sin(2 * np.pi * 20.0 * slow)
    fast = onto(slow, smooth, TIME[:19_000], RATE, False)
    np.testing.assert_allclose(fast, np.sin(2 * np.pi * 20.0 * TIME[:19_000]), atol=1e-3)
    noisy = np.sin(2 * np.pi * 20.0 * TIME) + np.sin(2 * np.pi * 9_990.0 * TIME)
    down = onto(TIME, noisy, slow, 1000.0, False)
    np.testing.assert_allclose(down[20:-20], smooth[20:-20], atol=1e-3)


def test_a_gap_of_a_slow_base_stays_a_hole() -> None:
    slow = np.arange(0, 200) / 1000.0
    kept = (slow < 0.05) | (slow > 0.08)
    fast = onto(slow[kept], slow[kept], TIME[:19_000], RATE, False)
    hole = np.isnan(fast)
    assert TIME[:19_000][hole].min() == pytest.approx(0.049, abs=2e-5)
    assert TIME[:19_000][hole].max() == pytest.approx(0.081, abs=2e-5)


@pytest.mark.parametrize("digits", [3, 4, 5])
def test_rounded_times_are_put_on_their_grid(digits: int) -> None:
    exact = np.arange(10_001) / 19_841.0
    time, said = tidy_time(np.round(exact, digits), PATH)
    np.testing.assert_allclose(time, exact, atol=10.0**-digits)
    assert (time.size - 1) / (time[-1] - time[0]) == pytest.approx(19_841.0, rel=1e-4)
    assert "too few digits" in said[0]


def test_single_precision_times_are_put_on_their_grid() -> None:
    exact = 10.0 + np.arange(20_000) / RATE
    time, said = tidy_time(exact.astype(np.float32).astype(float), PATH)
    np.testing.assert_allclose(np.diff(time), 1 / RATE, rtol=1e-4)
    assert said


def test_calendar_times_are_counted_from_the_first() -> None:
    time, said = tidy_time(1.7e9 + TIME, PATH)
    assert time[0] == 0.0
    assert "counted from its first sample" in said[0]
    assert is_regular(time) or np.abs(np.diff(time) * RATE - 1).max() < 0.05


def test_regular_times_are_left_alone() -> None:
    time, said = tidy_time(TIME, PATH)
    assert time is TIME
    assert said == []


def test_jitter_is_no_rounding() -> None:
    rng = np.random.default_rng(3)
    jittered = TIME + rng.uniform(-0.3, 0.3, TIME.size) / RATE
    time, said = tidy_time(jittered, PATH)
    assert time is jittered
    assert said == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t[::-1], "falls"),
        (lambda t: np.r_[t[:500], t[400:]], "falls at 1 places: sample 500"),
        (lambda t: np.r_[t[:500] ** 1.1, t[499] ** 1.1, t[500:] ** 1.1], "repeats"),
        (lambda t: np.where(t > 0.1, np.nan, t), "NaN or infinite in"),
        (lambda t: t[:1], "at least two"),
        (lambda t: np.r_[t, 1e300], "which no clock does"),
    ],
)
def test_times_that_make_no_record_are_refused(change, said: str) -> None:
    with pytest.raises(RecordError, match=said):
        tidy_time(change(TIME), PATH)
