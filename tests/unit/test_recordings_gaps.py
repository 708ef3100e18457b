"""Holes and saturated samples: never passed over in silence."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ematwin
from ematwin.errors import RecordError
from ematwin.recordings.recording import Recording
from ematwin.testing.reader_contract import bench_channels

CHANNELS = bench_channels()
TIME = CHANNELS["time"]
SINE = 5.0 * np.sin(2 * np.pi * 25.0 * TIME)


def holed(gap: slice = slice(0), **holes: slice) -> pd.DataFrame:
    table = pd.DataFrame(CHANNELS)
    for name, place in holes.items():
        table.loc[table.index[place], name] = np.nan
    return table.drop(table.index[gap])


def test_sound_columns_pass_unchanged() -> None:
    record = ematwin.read(holed())
    for name, values in CHANNELS.items():
        np.testing.assert_array_equal(getattr(record, name), values)
    assert not record.provenance["changed"]
    assert not record.provenance["warnings"]


@pytest.mark.parametrize(
    ("table", "gaps", "said"),
    [
        (holed(current_b=slice(700, 760), current_c=slice(100, 110)), "refuse",
         r"current_b has no values in a stretch of 60 samples from 0\.035 to 0\.03795 s"
         r".*so have current_c.*longest"),
        (holed(current_b=slice(700, 701)), "refuse", r"no values in one sample at 0\.035 s"),
        (holed(slice(700, 760)), "refuse", r"a gap of 0\.00305 s from 0\.03495 to 0\.038 s"),
        (holed(command=slice(500, 700)), "mask", "command cannot be masked from"),
        (holed(slice(500, 700)), "mask", "time and all columns cannot be masked from"),
        (holed(current_a=slice(100, 1300)), "mask", "more than half"),
        *((holed(current_a=slice(None)), gaps, "current_a holds no value at all")
          for gaps in ("refuse", "longest", "mask")),
        (holed(current_a=slice(0, None, 2), current_b=slice(1, None, 2)), "longest",
         "no two consecutive samples"),
        (pd.DataFrame({**CHANNELS, "time": np.cumsum(
            np.random.default_rng(0).exponential(5e-5, TIME.size) ** 2 * 1e5)}), "longest",
         "no constant rate"),
    ],
)  # fmt: skip
def test_holes_are_refused_with_place_and_length(table: Any, gaps: Any, said: str) -> None:
    with pytest.raises(RecordError, match=said):
        ematwin.read(table, gaps=gaps)


def test_the_longest_sound_stretch_is_taken_when_asked() -> None:
    record = ematwin.read(holed(slice(300, 400), current_a=slice(1500, 1510)), gaps="longest")
    np.testing.assert_array_equal(record.time, TIME[400:1500])
    np.testing.assert_array_equal(record.current_a, CHANNELS["current_a"][400:1500])
    assert "only the longest" in record.provenance["changed"][0]
    assert "Only the longest" in record.provenance["warnings"][0]


def test_holes_are_masked_when_asked(tmp_path: Path) -> None:
    table = holed(current_a=slice(1500, 1510), current_b=slice(1505, 1520), command=slice(9, 12))
    record = ematwin.read(table, gaps="mask")
    assert record.provenance["masked_s"] == [[TIME[8], TIME[12]], [TIME[1499], TIME[1520]]]
    np.testing.assert_allclose(np.diff(record.current_a[1499:1511], 2), 0.0, atol=1e-12)
    assert "masked" in record.provenance["warnings"][0]
    ematwin.write(record, tmp_path / "own.parquet")  # the provenance is plain values
    assert ematwin.read(tmp_path / "own.parquet").provenance == record.provenance


def with_current(values: np.ndarray, **entry: Any) -> Recording:
    table = pd.DataFrame({**CHANNELS, "I": values})
    columns = {"i_a": {"channel": "I", **entry}, "i_b": "current_b", "i_c": "current_c"}
    return ematwin.read(table, columns, gaps="mask")


def saturated(values: np.ndarray, **entry: Any) -> int:
    counts = with_current(values, **entry).provenance.get("saturated_samples", {})
    return int(counts.get("current_a", 0))


def test_a_clipped_current_is_counted_and_warned_of() -> None:
    record = with_current(1e3 * np.clip(SINE, -4.0, 4.5), unit="mA")
    clipped = int(((SINE >= 4.5) | (SINE <= -4.0)).sum())
    assert record.provenance["saturated_samples"] == {"current_a": clipped}
    (warning,) = record.provenance["warnings"]
    assert f"current_a sits at 4.5 and -4 A for {clipped} samples" in warning
    noisy = SINE + np.random.default_rng(0).normal(0, 0.05, SINE.size)
    assert saturated(np.clip(noisy, -4.0, 4.0)) > 0.95 * (np.abs(noisy) >= 4.0).sum()


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_smooth_peak_in_steps_of_the_converter_is_not_saturated(bits: int) -> None:
    step = 2 * 25.0 / 2**bits
    for amplitude in np.linspace(3.0, 5.0, 9):
        assert not saturated(np.round(amplitude / 5.0 * SINE / step) * step), amplitude


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(TIME.size), np.maximum(SINE, 0.0), np.full(TIME.size, 2.0),
        np.random.default_rng(0).normal(size=TIME.size),
    ],
)  # fmt: skip
def test_rest_constants_and_noise_are_not_saturated(values: np.ndarray) -> None:
    assert not saturated(values)


def test_a_declared_full_scale_is_believed() -> None:
    clipped = np.clip(SINE, -4.0, 4.0)
    assert saturated(clipped, full_scale=10.0) == 0
    assert saturated(clipped, full_scale=4.0) == (np.abs(SINE) >= 0.999 * 4.0).sum()


def test_nulls_of_a_parquet_file_are_holes(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    time, missing = np.arange(100_000) / 1e4, rng.random(100_000) < 0.01
    columns = {"time": time, "command": time, "current": pa.array(time, mask=missing)}
    pq.write_table(pa.table(columns), tmp_path / "run.parquet", row_group_size=777)
    record = ematwin.read(tmp_path / "run.parquet", gaps="mask")
    np.testing.assert_allclose(record.current, time, atol=1e-9)  # filled by straight lines
    assert len(record.provenance["masked_s"]) > 500
