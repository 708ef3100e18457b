"""Holes and saturated samples: never passed over in silence."""

from pathlib import Path

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError, RecordError
from ematwin.recordings.cleaning import runs, saturated, sound_samples
from ematwin.testing.reader_contract import bench_channels

PATH = Path("bench.csv")


def holed(**holes: slice) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    columns = bench_channels()
    time = columns.pop("time")
    for name, place in holes.items():
        columns[name][place] = np.nan
    return time, columns


def test_sound_columns_pass_unchanged() -> None:
    time, columns = holed()
    sound = sound_samples(time, columns, "refuse", PATH)
    assert sound.time is time
    assert sound.columns is columns
    assert not sound.changed
    assert not sound.warnings


def test_a_nan_stretch_is_refused_with_place_and_length() -> None:
    time, columns = holed(current_b=slice(700, 760), current_c=slice(100, 110))
    said = r"current_b has no values in a stretch of 60 samples from 0\.035 to 0\.03795 s"
    with pytest.raises(RecordError, match=said + r".*so have current_c.*longest"):
        sound_samples(time, columns, "refuse", PATH)


def test_a_gap_is_refused_with_place_and_length() -> None:
    time, columns = holed()
    kept = np.ones(time.size, dtype=bool)
    kept[700:760] = False
    with pytest.raises(RecordError, match=r"a gap of 0\.00305 s from 0\.03495 to 0\.038 s"):
        sound_samples(time[kept], {n: v[kept] for n, v in columns.items()}, "refuse", PATH)


def test_the_longest_sound_stretch_is_taken_when_asked() -> None:
    time, columns = holed(current_a=slice(1500, 1510))
    kept = np.ones(time.size, dtype=bool)
    kept[300:400] = False
    columns = {name: values[kept] for name, values in columns.items()}
    sound = sound_samples(time[kept], columns, "longest", PATH)
    assert sound.time[0] == time[400]
    assert sound.time[-1] == time[1499]
    assert all(np.isfinite(values).all() for values in sound.columns.values())
    assert "only the longest" in sound.changed[0]
    assert sound.warnings


def test_holes_are_masked_when_asked() -> None:
    time, columns = holed(current_a=slice(1500, 1510), current_b=slice(1505, 1520))
    sound = sound_samples(time, columns, "mask", PATH)
    assert sound.masked == [(pytest.approx(time[1499]), pytest.approx(time[1520]))]
    filled = sound.columns["current_a"][1499:1511]
    np.testing.assert_allclose(np.diff(filled, 2), 0.0, atol=1e-12)
    assert sound.warnings


def test_a_command_is_not_invented_over_a_long_hole() -> None:
    time, columns = holed(command=slice(500, 700))
    with pytest.raises(RecordError, match="command cannot be masked from"):
        sound_samples(time, columns, "mask", PATH, inputs=["command"])
    time, columns = holed(command=slice(500, 520))
    assert len(sound_samples(time, columns, "mask", PATH, inputs=["command"]).masked) == 1


def test_a_record_that_would_be_mostly_masked_is_refused() -> None:
    time, columns = holed(current_a=slice(100, 1300))
    with pytest.raises(RecordError, match="more than half"):
        sound_samples(time, columns, "mask", PATH)


def test_a_column_without_any_value_is_refused() -> None:
    time, columns = holed(current_a=slice(None))
    for policy in ("refuse", "longest", "mask"):
        with pytest.raises(RecordError, match="current_a holds no value at all"):
            sound_samples(time, columns, policy, PATH)  # type: ignore[arg-type]


def test_a_record_of_holes_only_is_refused() -> None:
    time, columns = holed(current_a=slice(0, None, 2), current_b=slice(1, None, 2))
    with pytest.raises(RecordError, match="no two consecutive samples"):
        sound_samples(time, columns, "longest", PATH)


def test_event_based_times_are_refused() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.exponential(5e-5, 2000) ** 2 * 1e5)
    with pytest.raises(RecordError, match="no constant rate"):
        sound_samples(time, {"command": time.copy()}, "longest", PATH)


def test_the_policy_is_checked_before_the_file_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gaps must be refuse, longest, mask"):
        ematwin.read(tmp_path / "none.csv", gaps="ignore")  # type: ignore[arg-type]


def test_masked_stretches_stand_in_the_provenance(tmp_path: Path) -> None:
    import h5py

    time, columns = holed(current_a=slice(1500, 1510))
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["time"] = time
        for name, values in columns.items():
            file[name] = values
    record = ematwin.read(tmp_path / "run.h5", gaps="mask")
    assert record.provenance["masked_s"] == [[time[1499], time[1510]]]
    assert "masked" in record.provenance["warnings"][0]
    ematwin.write(record, tmp_path / "own.parquet")  # the provenance is plain values
    assert ematwin.read(tmp_path / "own.parquet").provenance == record.provenance


def test_runs() -> None:
    assert runs(np.array([1, 0, 1, 1, 0, 1], dtype=bool)) == [(0, 1), (2, 4), (5, 6)]
    assert runs(np.zeros(3, dtype=bool)) == []


SINE = 5.0 * np.sin(2 * np.pi * 25.0 * np.arange(20_000) / 20_000.0)


def test_a_clipped_current_is_recognised() -> None:
    flags, limits = saturated(np.clip(SINE, -4.0, 4.5))
    np.testing.assert_array_equal(flags, (SINE >= 4.5) | (SINE <= -4.0))
    assert limits == [4.5, -4.0]


def test_a_clipped_current_with_noise_is_recognised() -> None:
    noisy = SINE + np.random.default_rng(0).normal(0, 0.05, SINE.size)
    flags, _ = saturated(np.clip(noisy, -4.0, 4.0))
    assert flags.sum() > 0.95 * (np.abs(noisy) >= 4.0).sum()


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_smooth_peak_in_steps_of_the_converter_is_not_saturated(bits: int) -> None:
    step = 2 * 25.0 / 2**bits
    for amplitude in np.linspace(3.0, 5.0, 41):
        flags, _ = saturated(np.round(amplitude / 5.0 * SINE / step) * step)
        assert not flags.any(), amplitude


def test_rest_and_constants_are_not_saturated() -> None:
    assert not saturated(np.zeros(100))[0].any()
    assert not saturated(np.maximum(SINE, 0.0))[0].any()
    assert not saturated(np.full(100, 2.0))[0].any()
    assert not saturated(np.full(100, np.nan))[0].any()
    assert not saturated(np.random.default_rng(0).normal(size=1000))[0].any()


def test_a_declared_full_scale_is_believed(tmp_path: Path) -> None:
    flags, limits = saturated(np.clip(SINE, -4.0, 4.0), (-10.0, 10.0))
    assert not flags.any()
    flags, limits = saturated(np.clip(SINE, -4.0, 4.0), (-4.0, 4.0))
    assert flags.sum() == (np.abs(SINE) >= 0.999 * 4.0).sum()
    assert limits == [-4.0, 4.0]


def test_saturation_is_counted_and_warned_of(tmp_path: Path) -> None:
    import h5py

    channels = bench_channels()
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, values in channels.items():
            file[name] = values
        file["current_a"][:] = np.clip(1e3 * channels["current_a"], -1500, 1500)
    entry = {"channel": "current_a", "unit": "mA", "full_scale": 1500.0}
    names = {"i_b": "current_b", "i_c": "current_c"}
    for table in ({**names, "i_a": "current_a [mA]"}, {**names, "i_a": entry}):
        record = ematwin.read(tmp_path / "run.h5", table)
        expected = int((np.abs(channels["current_a"]) >= 1.5).sum())
        assert record.provenance["saturated_samples"]["current_a"] == expected
        assert any("current_a sits at" in said for said in record.provenance["warnings"])
