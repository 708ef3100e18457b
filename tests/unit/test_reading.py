"""`read` and `write` for every kind of actuator: one recording, several, when they began."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ematwin
from bench_files import write_hdf5, write_mdf, write_tdms
from ematwin import Recording, read, write
from ematwin.errors import InputError, RecordError
from ematwin.testing.reader_contract import bench_channels

OLD = Path(__file__).parents[1] / "data" / "0.1"
TIME = np.arange(100) / 25.0
SET_POINT = np.interp(TIME, [0.0, 1.0, 3.0, 4.0], [0.0, 0.03, 0.03, 0.0])
BEGAN = datetime(2026, 11, 21, 8, 0, 0, 1000)


def motion(seed: int = 0, **labels: str) -> Recording:
    error, current = np.random.default_rng(seed).normal(size=(2, TIME.size))
    channels = {"set_point": SET_POINT, "position_error": 1e-3 * error, "current": np.abs(current)}
    return Recording(TIME, channels, labels=labels, source="made")


def phases(seed: int = 0, **labels: str) -> Recording:
    columns = bench_channels(0.01)
    columns["load"] = np.random.default_rng(seed).normal(size=columns["time"].size)
    return Recording(**columns, labels=labels)


def saved(path: Path, columns: dict[str, Any]) -> Path:
    pq.write_table(pa.table(columns), path)
    return path


def same(found: Recording, wanted: Recording) -> None:
    assert set(found.channels) == set(wanted.channels)
    for name, values in wanted.columns():
        np.testing.assert_allclose(getattr(found, name), values, rtol=1e-12, atol=1e-15)


# Files of version 0.1


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_record_of_version_0_1_is_read(suffix: str) -> None:
    found = read(OLD / f"record.{suffix}")
    assert len(found) == 401
    assert found.sample_rate == pytest.approx(4000.0)
    assert list(found.channels) == [
        "command", "current_a", "current_b", "current_c",
        "motor_position", "motor_speed", "output_position", "output_speed",
    ]  # fmt: skip
    assert found.provenance["faults"]["friction"] == 0.25
    assert found.provenance["noise"]["bits"] == 12
    assert found.units["motor_speed"] == "rad/s"
    lowered = read(OLD / f"record.{suffix}", resample_to=2000)
    assert lowered.sample_rate == pytest.approx(2000.0)
    assert lowered.provenance["seed"] == 3


def test_a_table_of_motions_of_version_0_1_is_read() -> None:
    found = read(OLD / "motions.csv", actuator="rm1605", split=True)
    assert [one.labels for one in found] == [
        {"run": str(run), "motion": str(n)} for run in range(1, 5) for n in (1, 2)
    ]
    assert {len(one) for one in found} == {325}
    assert found[0].interval == pytest.approx(0.04)
    assert max(float(one.set_point.max()) for one in found) == pytest.approx(0.12, abs=1e-3)


# Which kind


@pytest.mark.parametrize("actuator", ["ball-screw", "rm1605", OLD / "rm1605.toml", "object"])
def test_an_actuator_says_which_channels_there_are(tmp_path: Path, actuator: Any) -> None:
    chosen = ematwin.load_actuator("rm1605") if actuator == "object" else actuator
    write([motion()], tmp_path / "bench.csv")
    same(read(tmp_path / "bench.csv", actuator=chosen), motion())


def test_the_kind_is_the_brushless_one_if_nothing_is_said(tmp_path: Path) -> None:
    columns = bench_channels(0.01)
    path = saved(tmp_path / "bench.parquet", columns)
    for actuator in (None, "bldc", "rotary", "servo48", OLD / "servo48.toml"):
        same(read(path, actuator=actuator), Recording(**columns))


def test_channels_of_another_kind_are_recognised_in_the_refusal(tmp_path: Path) -> None:
    write([motion()], tmp_path / "bench.csv")
    said = r"no channel for command .*has the channels of the kind ball-screw"
    with pytest.raises(RecordError, match=said):
        read(tmp_path / "bench.csv")
    with pytest.raises(RecordError, match="no channel for command") as caught:
        read(saved(tmp_path / "odd.parquet", {"time": TIME, "speed": TIME}))
    assert "of the kind" not in str(caught.value)


def test_a_file_of_ours_says_itself_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "own.parquet"
    write(motion(run="1"), path)
    for actuator in (None, "rm1605"):
        found = read(path, actuator=actuator)
        same(found, motion())
        assert found.labels == {"run": "1"}
        assert found.units == {"set_point": "m", "position_error": "m", "current": "A"}
    strange = Recording(TIME, {"pressure": SET_POINT}, units={"pressure": "Pa"})
    write(strange, path)
    same(read(path), strange)
    assert read(path).units == {"pressure": "Pa"}


def test_a_file_of_ours_of_another_kind_is_refused(tmp_path: Path) -> None:
    write(phases(), tmp_path / "own.parquet")
    with pytest.raises(RecordError, match="no channel for position_error, nor for position"):
        read(tmp_path / "own.parquet", actuator="rm1605")


# One or several


def test_a_table_of_motions_is_not_read_as_one(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    write([motion(1), motion(2), motion(3)], path)
    said = r"bench\.csv holds 3 motions: time falls back to 0 s at sample 100.*split=True"
    with pytest.raises(RecordError, match=said):
        read(path, actuator="rm1605")
    found = read(path, actuator="rm1605", split=True)
    assert [len(one) for one in found] == [100, 100, 100]
    same(found[2], motion(3))


def test_tables_of_any_kind_are_split(tmp_path: Path) -> None:
    made = [phases(1, condition="dry"), phases(2, condition="dry"), phases(3, condition="wet")]
    for name in ("bench.csv", "bench.parquet"):
        write(made, tmp_path / name)
        found = read(tmp_path / name, split=True)
        assert [one.labels for one in found] == [one.labels for one in made]
        for one, wanted in zip(found, made, strict=True):
            same(one, wanted)
            assert one.source == name
        (chosen,) = read(tmp_path / name, split=True, where={"condition": ["wet"]})
        same(chosen, made[2])


def test_a_choice_of_one_motion_needs_no_list(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    write([motion(1, run="1"), motion(2, run="2"), motion(3, run="2")], path)
    same(read(path, actuator="rm1605", where={"run": ["1"]}), motion(1))
    with pytest.raises(RecordError, match="holds 2 motions that fit the choice"):
        read(path, actuator="rm1605", where={"run": ["2"]})
    both = read(path, actuator="rm1605", split=True, where=[{"run": ["1"]}, {"run": ["2"]}])
    assert [one.run for one in both] == ["1", "2", "2"]


def test_several_files_give_a_list_in_their_order(tmp_path: Path) -> None:
    for n in (3, 1, 2):
        write(phases(n), tmp_path / f"{n}.parquet")
    seen: list[float] = []
    paths = [tmp_path / f"{n}.parquet" for n in (3, 1, 2)]
    found = read(paths, progress=seen.append)
    assert [one.source for one in found] == ["3.parquet", "1.parquet", "2.parquet"]
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    assert len(read(paths[:1])) == 1


def test_all_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    """A folder is put right at once, not file by file."""
    record = ematwin.simulate()
    for n in (1, 3):
        write(record, tmp_path / f"r{n}.csv")
    (tmp_path / "r2.csv").write_text("time,foo\n0,1\n1,2\n2,3\n")
    (tmp_path / "r4.csv").write_text("garbage")
    with pytest.raises(RecordError) as told:
        read(sorted(tmp_path.iterdir()))
    assert "r2.csv has no channel for command" in str(told.value)
    assert str(told.value).endswith(" Of 4 files 1 more cannot be read: r4.csv.")


def test_labels_stand_in_text_channels_of_other_formats(tmp_path: Path) -> None:
    columns = bench_channels(0.01)
    time = columns["time"]
    signals = {"state": np.array([b"dry"] * time.size), **columns}
    del signals["time"]
    write_mdf(tmp_path / "run.mf4", (time, signals), encoding="utf-8")
    texts = {"bench/state": ["dry"] * time.size}
    write_tdms(tmp_path / "run.tdms", {f"bench/{n}": v for n, v in columns.items()} | texts)
    for name, label in (("run.mf4", "state"), ("run.tdms", "bench/state")):
        (found,) = read(tmp_path / name, split=True)
        assert found.labels == {label: "dry"}
        same(found, Recording(**columns))


def test_several_with_different_channels_are_no_table(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="a table needs the same in all"):
        write([motion(), phases()], tmp_path / "bench.csv")
    with pytest.raises(InputError, match="no recordings to write"):
        write([], tmp_path / "bench.csv")
    assert list(tmp_path.iterdir()) == []


def test_units_of_a_table_cannot_be_taken_for_names(tmp_path: Path) -> None:
    """The equivalent current in A is not written as `current_a`, which is phase a."""
    columns = bench_channels(0.01)
    one = Recording(
        columns["time"], {"command": columns["command"], "current": columns["current_a"]}
    )
    write([one, one], tmp_path / "bench.csv")
    head = (tmp_path / "bench.csv").read_text().splitlines()[0]
    assert head.replace('"', "") == "time [s],command [rad],current [A]"
    for found in read(tmp_path / "bench.csv", split=True):
        same(found, one)


# When it began


def with_clock(path: Path) -> Path:
    """Channels of a bench with clock times."""
    columns = bench_channels(0.01)
    stamps = np.datetime64(BEGAN, "us") + np.rint(columns["time"] * 1e6).astype("timedelta64[us]")
    named = {"t": stamps, "cmd": columns["command"], "i": columns["current_a"]}
    if path.suffix == ".parquet":
        return saved(path, named)
    if path.suffix == ".tdms":
        return write_tdms(path, {f"a/{name}": values for name, values in named.items()})
    rows = zip(stamps, named["cmd"].tolist(), named["i"].tolist(), strict=True)
    lines = [f"{str(t).replace('T', ' ')};{c!r};{i!r}" for t, c, i in rows]
    path.write_text("\n".join(["t;cmd;i", *lines, ""]))
    return path


@pytest.mark.parametrize(
    ("name", "zone"), [("run.csv", None), ("run.parquet", None), ("run.tdms", UTC)]
)
def test_clock_times_say_when_a_recording_began(tmp_path: Path, name: str, zone: Any) -> None:
    found = read(with_clock(tmp_path / name))
    assert found.start == BEGAN.replace(tzinfo=zone)
    assert abs(found.time[0]) < 1e-6


def test_clock_times_of_a_zone_keep_it(tmp_path: Path) -> None:
    stamps = pa.array(np.datetime64(BEGAN, "us") + np.arange(3), pa.timestamp("us", "UTC"))
    columns = {"t": stamps, "cmd": [0.0, 1.0, 2.0], "i": [0.0, 1.0, 2.0]}
    assert read(saved(tmp_path / "run.parquet", columns)).start == BEGAN.replace(tzinfo=UTC)
    rows = [f"2026-11-21T08:00:00.{n:03d}Z;{n};{n}" for n in range(1, 50)]
    (tmp_path / "run.csv").write_text("\n".join(["t;cmd;i", *rows, ""]))
    assert read(tmp_path / "run.csv").start == BEGAN.replace(tzinfo=UTC)


def test_missing_clock_times_are_missing_times() -> None:
    frame = pd.DataFrame({"t": pd.date_range("2026-11-21", periods=50, freq="ms"), "cmd": 0.0})
    frame["i"] = np.arange(50.0)
    assert read(frame).sample_rate == pytest.approx(1000.0)
    frame.loc[[0, 7], "t"] = pd.NaT
    with pytest.raises(RecordError, match="time is NaN or infinite in 2 samples"):
        read(frame)


def test_formats_with_a_start_state_it(tmp_path: Path) -> None:
    columns = bench_channels(0.01)
    began = BEGAN.replace(tzinfo=UTC)
    names = {"cmd": "command", "i": "current_a"}
    for name, version in (("run.mf4", "4.10"), ("run.mdf", "3.30")):
        groups = [(columns["time"], {key: columns[n]}) for key, n in names.items()]
        write_mdf(tmp_path / name, *groups, version=version, start=began)
        found = read(tmp_path / name)
        assert found.start is not None
        assert abs(found.start - began) <= timedelta(milliseconds=1)
    wave = {"wf_increment": 5e-5, "wf_start_time": np.datetime64(BEGAN, "us")}
    waves = {f"a/{name}": (columns[n], wave) for name, n in names.items()}
    assert read(write_tdms(tmp_path / "run.tdms", waves)).start == began


def test_a_file_that_does_not_say_when_it_began_leaves_it_open(tmp_path: Path) -> None:
    columns = bench_channels(0.01)
    assert read(saved(tmp_path / "run.parquet", columns)).start is None
    numbers = {**columns, "time": 1.7e9 + columns["time"]}  # somebody's calendar, but whose?
    assert read(saved(tmp_path / "epoch.parquet", numbers)).start is None
    assert read(write_hdf5(tmp_path / "run.h5", columns)).start is None


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("zone", [None, UTC])
def test_start_labels_units_and_provenance_survive_their_file(tmp_path, suffix, zone):
    made = phases(1, run="7", condition="größer")
    made.start = BEGAN.replace(tzinfo=zone)
    made.provenance["by"] = ["hand"]
    write(made, tmp_path / f"own{suffix}")
    found = read(tmp_path / f"own{suffix}")
    assert found.start == made.start
    assert found.labels == made.labels
    assert found.provenance == made.provenance
    assert found.units["load"] == "N*m"
    for name, values in made.columns():
        assert getattr(found, name).tobytes() == values.tobytes()
    part = found.between(0.002, 0.004)
    assert part.start == made.start  # the moment of time zero, not of the first sample
    assert part.labels == made.labels
    lowered = read(tmp_path / f"own{suffix}", where={"run": ["7"]})
    assert lowered.labels == made.labels


# One pipeline


def test_a_position_of_another_rate_gives_its_error(tmp_path: Path) -> None:
    path = tmp_path / "motion.mf4"
    fast = np.arange(0.0, 4.0, 0.01)
    write_mdf(
        path, (TIME, {"Demand": (100.0 * np.sin(TIME), "mm")}),
        (fast, {"position": (99.0 * np.sin(fast), "mm"), "drive_current": (1.0 + fast, "A")}),
    )  # fmt: skip
    found = read(path, actuator="ball-screw")
    assert found.sample_rate == pytest.approx(100.0)
    assert list(found.channels) == ["set_point", "position_error", "current"]
    wanted = 1e-3 * np.sin(found.time)
    np.testing.assert_allclose(found.position_error[50:-50], wanted[50:-50], atol=1e-5)
    account = found.provenance["columns"]["position_error"]
    assert account == {"derived": "set_point - position"}
    said = found.provenance["changed"]
    assert any(one.startswith("set_point, sampled every 0.04 s") for one in said)
    assert any("brought to the times of position, current" in one for one in said)


def test_phases_sampled_at_different_times_give_no_third(tmp_path: Path) -> None:
    columns = bench_channels(0.1)
    time = columns["time"]
    together = {name: columns[name] for name in ("command", "current_a")}
    later = (time + 1e-5, {"current_b": columns["current_b"]})
    write_mdf(tmp_path / "run.mf4", (time, together), later)
    with pytest.raises(RecordError, match=r"different times .* current_c cannot be derived"):
        read(tmp_path / "run.mf4")


def test_means_of_a_file_of_ours_stay_means_at_another_rate(tmp_path: Path) -> None:
    """A brushless current is a mean over the interval before; a ball screw's is not."""
    time = np.arange(4000) / 1000.0
    ramp = Recording(time, {"command": time, "current": time})
    write(ramp, tmp_path / "mean.parquet")
    found = read(tmp_path / "mean.parquet", resample_to=100)
    np.testing.assert_allclose(found.current[5:-5] - found.time[5:-5], -0.0045, atol=1e-9)
    ramp = Recording(time, {"set_point": time, "position_error": time, "current": time})
    write(ramp, tmp_path / "value.parquet")
    found = read(tmp_path / "value.parquet", resample_to=100)
    np.testing.assert_allclose(found.current, found.time, atol=1e-9)
