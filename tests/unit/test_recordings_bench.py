"""Whole files of each kind, as benches write them: several rates, holes, names, units, memory."""

import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from asammdf import MDF

import ematwin
from bench_files import write_hdf5, write_mdf, write_tdms
from commands import fresh
from ematwin.errors import EmatwinError, FileError, InputError, MissingExtraError, RecordError
from ematwin.models.bldc.channels import phase_currents
from ematwin.recordings.formats.base import known_suffixes, open_file
from ematwin.testing.reader_contract import bench_channels

CHANNELS = bench_channels()
TIME = CHANNELS["time"]
PHASES = {"i_a": "ia", "i_b": "ib"}


def clock_times() -> np.ndarray:
    microseconds = np.rint(TIME * 1e6).astype("timedelta64[us]")
    return np.datetime64("2026-11-21T08:00:00", "us") + microseconds


def test_mdf_groups_of_several_rates_come_onto_the_times_of_the_currents(tmp_path: Path) -> None:
    slow = TIME[::10] + 0.002
    phases = {"ia": (1e3 * CHANNELS["current_a"], "mA"), "ib": (CHANNELS["current_b"], "A")}
    path = write_mdf(
        tmp_path / "run7.mf4",
        (TIME, {**phases, "speed": (np.zeros(TIME.size), "rpm")}),
        (slow, {"Soll": (np.degrees(np.sin(40 * slow)), "deg")}),
        (slow, {"speed": (30.0 / np.pi * slow, "1/min")}),
    )
    table = {**PHASES, "cmd": "Soll", "omega_m": "group 2/speed"}
    record = ematwin.read(path, table)
    assert record.sample_rate == pytest.approx(20_000)
    assert record.time[0] == pytest.approx(0.002)
    np.testing.assert_allclose(record.command, np.sin(40 * record.time), atol=1e-5)
    np.testing.assert_allclose(record.current_a, CHANNELS["current_a"][40:], atol=1e-12)
    assert record.motor_speed is not None
    np.testing.assert_allclose(record.motor_speed, record.time, atol=1e-9)
    changed = record.provenance["changed"]
    assert any(said.startswith("command, sampled every 0.0005 s") for said in changed)
    assert record.provenance["format"] == "MDF"
    with pytest.raises(RecordError, match="2 channels named 'speed'"):
        ematwin.read(path, {**table, "omega_m": "speed"})


def test_times_of_the_format_go_before_a_channel_of_clock_times(tmp_path: Path) -> None:
    stamps = 1.7e9 + np.round(TIME, 2)
    signals = {"timestamp": stamps, "i": CHANNELS["current_a"], "cmd": CHANNELS["command"]}
    path = write_mdf(tmp_path / "run.mf4", (TIME, signals))
    np.testing.assert_allclose(ematwin.read(path).time, TIME, atol=1e-9)


def test_mdf_invalid_samples_are_holes(tmp_path: Path) -> None:
    invalid = np.zeros(TIME.size, dtype=bool)
    invalid[500:520] = True
    names = {"ia": "current_a", "ib": "current_b", "cmd": "command"}
    signals = {theirs: CHANNELS[ours] for theirs, ours in names.items()}
    path = write_mdf(tmp_path / "run.mf4", (TIME, signals), invalidation_bits=invalid)
    with pytest.raises(RecordError, match="current_a has no values in a stretch of 20 samples"):
        ematwin.read(path, PHASES)


def test_mdf_text_channels_are_refused(tmp_path: Path) -> None:
    signals = {"state": np.array([b"on"] * TIME.size), "i": CHANNELS["current_a"]}
    path = write_mdf(tmp_path / "run.mf4", (TIME, signals), encoding="utf-8")
    with pytest.raises(RecordError, match=r"'state'.*real numbers"):
        ematwin.read(path, {"cmd": "state", "i": "i"})


def test_mdf_groups_that_share_no_time_are_refused(tmp_path: Path) -> None:
    path = write_mdf(
        tmp_path / "run.mf4",
        (TIME, {"i": CHANNELS["current_a"]}), (TIME + 5.0, {"cmd": CHANNELS["command"]}),
    )  # fmt: skip
    with pytest.raises(RecordError, match="share no time"):
        ematwin.read(path)


def test_tdms_without_waveform_takes_a_time_channel(tmp_path: Path) -> None:
    columns = {
        "bench/clock": clock_times(), "bench/cmd": CHANNELS["command"],
        "bench/ia": CHANNELS["current_a"].astype(np.float32), "bench/ib": CHANNELS["current_b"],
    }  # fmt: skip
    parts = (slice(0, 900), slice(900, None))
    segments = [{name: values[part] for name, values in columns.items()} for part in parts]
    path = write_tdms(tmp_path / "run.tdms", *segments)
    record = ematwin.read(path, {**PHASES, "t": "clock"})
    np.testing.assert_allclose(record.time, TIME, atol=1e-7)  # npTDMS cuts clock times to 1 us
    np.testing.assert_allclose(record.current_a, CHANNELS["current_a"], atol=1e-6)
    with pytest.raises(RecordError, match=r"no channel for time.*give sample_rate"):
        ematwin.read(path, PHASES)


def test_tdms_waveforms_of_several_rates_and_starts(tmp_path: Path) -> None:
    start = np.datetime64("2026-11-21T08:00:00.000000", "us")
    fast = {"wf_increment": 5e-5, "wf_start_offset": 0.0, "wf_start_time": start}
    late = start + np.timedelta64(10_000, "us")
    slow = {"wf_increment": 5e-4, "wf_start_offset": 0.001, "wf_start_time": late}
    line = np.arange(150) * 5e-4 + 0.011
    phases = {name: (CHANNELS[f"current_{name[-1]}"], fast) for name in ("a/ia", "a/ib")}
    path = write_tdms(tmp_path / "run.tdms", {**phases, "b/cmd": (line, slow)})
    record = ematwin.read(path, PHASES)
    assert record.time[0] == pytest.approx(0.011)
    np.testing.assert_allclose(record.command, record.time, atol=1e-9)


def test_matlab_matrices_and_structures_in_lists(tmp_path: Path) -> None:
    path = tmp_path / "sim.mat"
    phases = np.column_stack([CHANNELS[f"current_{k}"] for k in "abc"])
    scipy.io.savemat(
        path,
        {
            "out": {"time": TIME, "signals": {"values": phases, "label": "currents"}},
            "Soll": np.rint(1e5 * CHANNELS["command"]).astype(np.int16),
        },
    )
    with open_file(path) as file:
        columns = [f"out.signals.values[{n}]" for n in range(3)]
        assert file.names == (*columns, "out.time", "Soll")
    table = {f"i_{k}": f"out.signals.values[{n}]" for n, k in enumerate("abc")}
    record = ematwin.read(path, {**table, "cmd": {"channel": "Soll", "scale": 1e-5}})
    np.testing.assert_array_equal(phase_currents(record), phases)
    np.testing.assert_allclose(record.command, CHANNELS["command"], atol=6e-6)


def test_hdf5_tables_matrices_and_lying_vectors(tmp_path: Path) -> None:
    table = np.zeros(TIME.size, dtype=[("t", "f8"), ("cmd", "f4")])
    table["t"], table["cmd"] = TIME, CHANNELS["command"]
    currents = np.stack([CHANNELS[f"current_{k}"] for k in "abc"])
    others = {"note": "text", "empty": h5py.Empty("f8"), "short": np.arange(5.0)}
    path = write_hdf5(tmp_path / "run.hdf5", {"table": table, "currents": currents, **others})
    record = ematwin.read(path, {"i_a": "currents[0]", "i_b": "currents[1]"})
    np.testing.assert_array_equal(record.current_b, CHANNELS["current_b"])
    np.testing.assert_array_equal(record.time, TIME)
    with pytest.raises(RecordError, match=r"load of .* has 5 samples, time has 2000"):
        ematwin.read(path, {"i_a": "currents[0]", "i_b": "currents[1]", "load": "short"})


@pytest.mark.parametrize(
    ("suffix", "module", "package"),
    [
        (".mat", "pymatreader", "pymatreader"),
        (".mf4", "asammdf", "asammdf"),
        (".tdms", "nptdms", "npTDMS"),
        (".h5", "h5py", "h5py"),
    ],
)
def test_a_missing_library_names_the_command(tmp_path, monkeypatch, suffix, module, package):
    path = tmp_path / f"run{suffix}"
    path.write_bytes(b"anything")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{package}.*ematwin\[io\]"):
        ematwin.read(path)


def test_damaged_mdf_files_leave_nothing_on_stderr(tmp_path: Path) -> None:
    path = write_mdf(tmp_path / "run.mf4", (TIME, {"i": CHANNELS["current_a"]}))
    path.write_bytes(path.read_bytes()[:-2000])
    code = (
        "import ematwin, sys\n"
        "try: ematwin.read(sys.argv[1])\n"
        "except ematwin.EmatwinError as error: print(error)\n"
    )
    done = fresh(code, path)
    assert done.err == ""
    assert "may be truncated" in done.out


def test_an_mdf_channel_outside_its_record_is_refused(tmp_path: Path) -> None:
    """The library would read foreign memory, and crash."""
    signals = {name: CHANNELS[name] for name in ("command", "current_a")}
    path = write_mdf(tmp_path / "run.mdf", (TIME, signals), version="3.30")
    with MDF(path) as mdf:
        place = mdf.groups[0].channels[2].address
    content = bytearray(path.read_bytes())
    start = content.index(b"\x80\x00\x40\x00", place)  # 16 byte into the record, 64 bits long
    content[start : start + 2] = b"\xff\xf0"
    path.write_bytes(bytes(content))
    with pytest.raises(FileError, match="ends at bit"):
        ematwin.read(path, {"cmd": "command", "i": "current_a"})


def test_absurd_values_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {**CHANNELS, "current_b": np.where(TIME[7] == TIME, 1e200, 0.0)})
    with pytest.raises(RecordError, match=r"current_b .* reaches 1e\+200 A at sample 7"):
        ematwin.read(path)


def test_a_plugged_in_reader_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib.metadata import EntryPoint

    from ematwin.recordings.formats import base

    entry = EntryPoint(
        "h5x", "ematwin.recordings.formats.binary_files:Hdf5File", group="ematwin.readers"
    )
    monkeypatch.setattr(base, "entry_points", lambda group: [entry])
    with open_file(write_hdf5(tmp_path / "run.h5x", {"time": TIME})) as opened:
        assert opened.names == ("time",)
    assert ".h5x" in known_suffixes()


PEAK = """
import sys
import ematwin
record = ematwin.read(sys.argv[1], resample_to=20_000.0)
assert len(record) > 190_000
# of this process alone: ru_maxrss also counts what the parent held when it started this one
with open("/proc/self/status") as status:
    print(next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024)
"""


def test_ten_seconds_at_100_khz_stay_well_under_500_mb(tmp_path: Path) -> None:
    channels = bench_channels(duration=10.0, sample_rate=100_000.0)
    others = ("motor_position", "motor_speed", "output_position", "output_speed")
    channels |= dict.fromkeys(others, channels["command"])
    path = write_hdf5(tmp_path / "long.h5", channels)
    assert float(fresh(PEAK, path).out) < 350.0  # MB


def test_what_is_no_file_of_a_known_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="There is no file"):
        ematwin.read(tmp_path / "none.csv")
    with pytest.raises(InputError, match="must end in"):
        ematwin.read(tmp_path / "run.xyz")
    for suffix in known_suffixes():
        path = tmp_path / f"folder{suffix}"
        path.mkdir()
        with pytest.raises(EmatwinError, match="is a folder"):
            ematwin.read(path)
