"""Motions in files: where one ends and the next begins, which channel is what, in which unit."""

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from ematwin.errors import EmatwinError, RecordError
from ematwin.models.ball_screw.model import check_signals
from ematwin.models.reading import read
from ematwin.recordings.recording import Recording
from refusals import refusal_of

read_motions = partial(read, actuator="rm1605", split=True)
refusal = partial(refusal_of, kind=RecordError)

SAMPLES, INTERVAL = 60, 0.04
TIME = np.arange(SAMPLES) * INTERVAL
SET_POINT = np.interp(TIME, [0.0, 1.0, 1.4, 2.4], [0.0, 0.03, 0.03, 0.0])


def made(seed: int = 0, **labels: str) -> Recording:
    random = np.random.default_rng(seed)
    error = 1e-3 * random.normal(size=SAMPLES)
    channels = {
        "set_point": SET_POINT, "position_error": error, "current": 1.0 + random.random(SAMPLES),
    }  # fmt: skip
    return Recording(TIME, channels, labels=labels, source="made")


MOTIONS = [
    made(n, condition=condition, run=run, motion=motion)
    for n, (condition, run, motion) in enumerate(
        [("normal", "1", "1"), ("normal", "1", "2"), ("normal", "2", "1"), ("dry", "1", "1")]
    )
]


def table(**changed: Any) -> dict[str, Any]:
    """Columns of two motions of one run, in SI; None leaves one out."""
    columns: dict[str, Any] = {
        "run": ["a"] * 2 * SAMPLES,
        "time": np.tile(TIME, 2),
        "set_point": np.tile(SET_POINT, 2),
        "position_error": np.r_[MOTIONS[0].position_error, MOTIONS[1].position_error],
        "current": np.r_[MOTIONS[0].current, MOTIONS[1].current],
    }
    columns |= changed
    return {name: values for name, values in columns.items() if values is not None}


def saved(path: Path, columns: dict[str, Any]) -> Path:
    if path.suffix == ".csv":
        pa.csv.write_csv(pa.table(columns), path)
    else:
        pq.write_table(pa.table(columns), path)
    return path


def refused(path: Path, **options: Any) -> str:
    text = refusal(lambda: read_motions(path, **options))
    assert path.name in text
    return text


# Where motions begin


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_motion_begins_where_a_label_changes_though_time_goes_on(tmp_path, suffix):
    going_on = np.arange(2 * SAMPLES) * INTERVAL
    for label in (np.repeat([1, 2], SAMPLES), ["dry"] * SAMPLES + ["wet"] * SAMPLES):
        found = read_motions(saved(tmp_path / f"bench{suffix}", table(time=going_on, day=label)))
        assert [motion.time.size for motion in found] == [SAMPLES, SAMPLES]
        assert [m.labels["day"] for m in found] in (["1", "2"], ["dry", "wet"])


def test_a_signal_is_no_label(tmp_path):
    """A column that changes all the time neither splits a motion nor labels it."""
    noise = np.random.default_rng(0).normal(size=2 * SAMPLES)
    for values in (noise, np.round(noise).astype(int), [f"{x:.3f}" for x in noise]):
        found = read_motions(saved(tmp_path / "bench.parquet", table(temperature=values)))
        assert [motion.labels for motion in found] == [{"run": "a"}] * 2


@pytest.mark.parametrize("stated", ["name", "file"])
def test_a_load_that_steps_within_a_motion_is_no_label(tmp_path, stated):
    """A load that nobody mapped would cut each motion where it sets in."""
    step = np.tile(np.repeat([0.0, 10.0], SAMPLES // 2), 2)
    name = "force [N]" if stated == "name" else "force"
    path = saved(tmp_path / "bench.parquet", table(**{name: step}))
    if stated == "file":
        columns = pq.read_table(path)
        place = columns.column_names.index(name)
        pq.write_table(
            columns.cast(
                columns.schema.set(place, columns.field(place).with_metadata({"unit": "N"}))
            ),
            path,
        )
    assert [motion.labels for motion in read_motions(path)] == [{"run": "a"}] * 2


def test_a_load_that_holds_through_each_motion_labels_it(tmp_path):
    loads = np.repeat([0.0, 10.0], SAMPLES)
    found = read_motions(saved(tmp_path / "bench.parquet", table(**{"force [N]": loads})))
    assert [motion.labels["force [N]"] for motion in found] == ["0", "10"]


# Labels


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (pa.array([7] * 2 * SAMPLES, pa.int8()), "7"),
        (pa.array([20261121.0] * 2 * SAMPLES), "20261121"),
        (pa.array([0.1] * 2 * SAMPLES, pa.float32()), "0.1"),
        (pa.array([12.5] * 2 * SAMPLES), "12.5"),
        (pa.array(["dry"] * 2 * SAMPLES).dictionary_encode(), "dry"),
        (pa.array([True] * 2 * SAMPLES), "true"),
        (pa.array([None] * 2 * SAMPLES, pa.string()), ""),
        (pa.array(["größer"] * 2 * SAMPLES), "größer"),
    ],
)
def test_labels_are_texts_and_numbers_of_any_type(tmp_path, values, text):
    path = saved(tmp_path / "bench.parquet", table(day=values))
    assert {motion.labels["day"] for motion in read_motions(path)} == {text}


def test_labels_of_a_csv_are_taken_as_they_are_written(tmp_path):
    path = tmp_path / "bench.csv"
    rows = [
        f"07, too dry,{t:.2f},{s:.6f},0.001,{1 + s:.6f}"
        for t, s in zip(TIME, SET_POINT, strict=True)
    ]
    path.write_text("\n".join(["day,state,time,set_point,error,current", *rows, ""]))
    (motion,) = read_motions(path)
    assert motion.labels == {"day": "07", "state": "too dry"}


# Channels and units


@pytest.mark.parametrize("name", ["time", "set_point", "position_error", "current"])
def test_a_missing_channel_is_named(tmp_path, name):
    text = refused(saved(tmp_path / "bench.parquet", table(**{name: None})))
    assert re.search(rf"no channel for {name}( \(|,| nor|;).*it has run", text), text
    assert f'{name}="' in text


# What cannot be right


def test_a_hole_in_a_motion_is_refused(tmp_path):
    columns = {name: np.delete(np.asarray(v), np.s_[20:30]) for name, v in table().items()}
    path = saved(tmp_path / "bench.parquet", columns)
    assert "a gap of 0.44 s from 0.76 to 1.2 s" in refused(path)
    assert "run a" in refused(path)
    first, second = read(path, actuator="rm1605", split=True, gaps="longest")
    assert first.time.size == 40 - 10
    assert second.time.size == SAMPLES


def test_a_motion_of_few_samples_is_refused(tmp_path):
    columns = {name: values[: SAMPLES + 19] for name, values in table().items()}
    text = refused(saved(tmp_path / "bench.parquet", columns))
    assert "a motion of 19 samples is too short; at least 20" in text
    columns = {name: values[: SAMPLES + 20] for name, values in table().items()}
    assert len(read_motions(saved(tmp_path / "bench.parquet", columns))) == 2


def test_it_is_said_where_only_time_that_falls_back_tells_motions_apart(tmp_path):
    said = f"a new motion begins wherever time falls back, first at sample {SAMPLES}"
    for label, told in ((["a"] * 2 * SAMPLES, True), (["a"] * SAMPLES + ["b"] * SAMPLES, False)):
        motions = read_motions(saved(tmp_path / "bench.parquet", table(run=label)))
        assert [said in one.provenance["assumed"] for one in motions] == [told, told]


def test_times_that_fall_are_no_motions_of_one_sample(tmp_path):
    columns = table()
    columns["time"] = np.asarray(columns["time"])[::-1]
    text = refused(saved(tmp_path / "bench.parquet", columns))
    assert "time must increase: sample 1" in text


@pytest.mark.parametrize(
    ("name", "factor", "said"),
    [
        ("set_point", 1e4, "spans 300 m, which no actuator travels; its unit is probably mm"),
        ("current", 3e3, "its unit is probably mA"),
    ],
)
def test_a_size_that_no_actuator_has_names_the_likely_unit(tmp_path, name, factor, said):
    columns = table(**{name: factor * table()[name]})
    motion = read_motions(saved(tmp_path / "bench.parquet", columns))[0]
    assert said in refusal(lambda: check_signals(motion))


def test_a_table_without_rows_is_refused(tmp_path):
    for suffix in (".csv", ".parquet"):
        columns = {name: np.asarray(values)[:0] for name, values in table().items()}
        path = saved(tmp_path / f"bench{suffix}", columns)
        assert path.name in refusal(lambda path=path: read_motions(path), kind=EmatwinError)


# The motion itself


def test_a_motion_that_was_not_chosen_need_not_be_sound(tmp_path):
    columns = table(run=["1"] * SAMPLES + ["2"] * SAMPLES)
    columns["current"] = np.where(np.arange(2 * SAMPLES) == 100, np.nan, columns["current"])
    path = saved(tmp_path / "bench.parquet", columns)
    (motion,) = read_motions(path, where={"run": ["1"]})
    assert motion.run == "1"
    with pytest.raises(RecordError, match="current has no values"):
        read_motions(path)
