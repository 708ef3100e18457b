"""The column map: its three ways in, its refusals, and what it does to numbers."""

from pathlib import Path

import h5py
import numpy as np
import pytest

import ematwin
from bench_files import write_hdf5
from ematwin.errors import FileError, InputError, RecordError
from ematwin.models.bldc.channels import CHANNELS
from ematwin.recordings.channel import ChannelMap
from ematwin.testing.reader_contract import bench_channels

TOML = """
sample_rate = "20 kHz"
phase_order = "bca"
gear_ratio = 500

[columns]
command = { channel = "Setpoint", unit = "deg", side = "motor" }
i_a = "Phase A [mA]"
current_b = { channel = "Phase B", unit = "mA", sign = -1, scale = 2.0, offset = 0.5 }

[csv]
delimiter = ";"
"""


def of(given: object) -> ChannelMap:
    return ChannelMap.of(given, CHANNELS)  # type: ignore[arg-type]


def parse(texts: list[str], base: ChannelMap | None = None) -> ChannelMap:
    return ChannelMap.parse(texts, CHANNELS, base)


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """SI values under names of a bench."""
    channels = bench_channels(0.01)
    names = ("t", "Setpoint", "Phase A", "Phase B", "Phase C")
    columns = zip(names, channels.values(), strict=True)
    return write_hdf5(tmp_path / "bench.h5", {f"run/{name}": values for name, values in columns})


PHASES = {"i_a": "Phase A", "i_b": "Phase B", "i_c": "Phase C"}


def test_toml_mapping_and_strings_say_the_same(tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(TOML)
    from_file = of(file)
    flat = of(
        {
            "cmd": {"channel": "Setpoint", "unit": "deg", "side": "motor"},
            "i_a": "Phase A [mA]",
            "ib": {"channel": "Phase B", "unit": "mA", "sign": -1, "scale": 2.0, "offset": 0.5},
            "sample_rate": 20_000,
            "phase_order": "bca",
            "gear_ratio": 500,
            "delimiter": ";",
        }
    )
    assert from_file == flat
    assert of(from_file.as_table()) == flat
    over = parse(["i_a=Phase 1", 'sample_rate="10 kHz"'], from_file)
    assert over.columns["current_a"].channel == "Phase 1"
    assert over.sample_rate == 10_000
    assert over.columns["command"] == flat.columns["command"]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"i_d": "x"}, "no column 'i_d'"),
        ({"i_a": "x", "current_a": "y"}, "twice"),
        ({"i_a": {"channel": "x", "sign": 2}}, "sign must be 1 or -1"),
        ({"i_a": {"channel": "x", "scale": 0}}, "scale"),
        ({"i_a": {"channel": "x", "factor": 2}}, "factor is not a name"),
        ({"i_a": 5}, "current_a"),
        ({"phase_order": "abb"}, "phase_order"),
        ({"sample_rate": -5}, "sample_rate"),
        ({"sample_rate": "20 kA"}, "sample_rate"),
        ({"sample_rate": 5, "t": "x"}, "one of the two"),
        ({"cmd": {"channel": "x", "side": "motor"}}, "gear_ratio"),
        ({"i_a": {"channel": "x", "side": "motor"}}, "no shaft"),
        ({"i_a": {"channel": "x", "unwrap": True}}, "not an angle"),
        ({"csv": {"decimal": "x"}}, "decimal"),
        ({"csv": 5}, "csv"),
        ({"without": "lode"}, "no column 'lode'"),
        ({"without": 5}, "without"),
        ({"load": "x", "without": "load"}, "load is mapped and left out"),
        (7, "mapping"),
    ],
)
def test_impossible_maps_are_refused_in_a_sentence(table: object, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        of(table)
    assert "\n" not in str(caught.value)


def test_a_text_holds_a_name_and_a_channel() -> None:
    assert parse(["t='a=b [ms]'"]).columns["time"].channel == "a=b [ms]"
    for text in ("i_a", "=x", "i_a=", "nothing=x"):
        with pytest.raises(InputError):
            parse([text])


def test_a_map_file_that_is_missing_or_damaged_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="column map"):
        of(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("columns = [")
    with pytest.raises(InputError, match="not valid TOML"):
        of(tmp_path / "bad.toml")
    (tmp_path / "odd.toml").write_text("[columns]\nspeed = 'x'")
    with pytest.raises(InputError, match=r"odd\.toml.*motor_speed"):
        of(tmp_path / "odd.toml")


def test_unit_scale_offset_and_sign_are_applied_in_that_sense(bench: Path) -> None:
    entry = {"channel": "Phase A", "unit": "mA", "sign": -1, "scale": 2.0, "offset": 100.0}
    record = ematwin.read(bench, {**PHASES, "i_a": entry, "cmd": "Setpoint [deg]"})
    channels = bench_channels(0.01)
    np.testing.assert_allclose(record.current_a, -1e-3 * (2.0 * channels["current_a"] + 100.0))
    np.testing.assert_allclose(record.command, np.radians(channels["command"]))
    account = record.provenance["columns"]
    assert account["current_a"]["sign"] == -1
    assert account["command"]["unit"] == "deg"
    assert account["command"]["unit_from"] == "map"
    assert account["current_b"]["unit_from"] == "assumed"
    assert any("current_b in A" in said for said in record.provenance["assumed"])


def test_angles_and_loads_change_the_side_of_the_gear(bench: Path) -> None:
    names = {"channel": "Setpoint"}
    table = {
        **PHASES,
        "cmd": {**names, "side": "motor"},
        "load": {**names, "side": "motor"},
        "theta_m": {**names, "side": "output"},
        "gear_ratio": 500,
    }
    record = ematwin.read(bench, table)
    command = bench_channels(0.01)["command"]
    np.testing.assert_allclose(record.command, command / 500)
    assert record.load is not None
    np.testing.assert_allclose(record.load, command * 500)
    assert record.motor_position is not None
    np.testing.assert_allclose(record.motor_position, command * 500)


def test_a_map_adds_to_what_the_names_of_the_file_say(bench: Path) -> None:
    channels = bench_channels(0.01)
    with h5py.File(bench, "a") as file:
        for name in ("load", "theta_m", "current", "x/omega_m", "y/omega_m", "output_position"):
            file[name] = channels["command"]
        file["output_position"].attrs["unit"] = "kg"
    found = ematwin.read(bench, {**PHASES, "cmd": "Setpoint"})
    assert {"load", "motor_position"} <= found.channels.keys()
    assert "current" not in found.channels  # the map gives its phases
    assert not {"motor_speed", "output_position"} & found.channels.keys()
    left_out = " ".join(found.provenance["warnings"])
    assert "motor_speed was left out: bench.h5 has several channels for it" in left_out
    assert "output_position was left out: output_position is in kg" in left_out
    said = " ".join(found.provenance["assumed"])
    assert "beside the map, these were found by their names: load, motor_position" in said
    without = ematwin.read(bench, {**PHASES, "cmd": "Setpoint", "without": ["load", "theta_m"]})
    assert not {"load", "motor_position"} & without.channels.keys()
    assert parse(["without=load, theta_m"]).without == ("load", "motor_position")


def test_phase_order_names_what_the_given_channels_carry(bench: Path) -> None:
    record = ematwin.read(bench, {**PHASES, "cmd": "Setpoint", "phase_order": "bca"})
    channels = bench_channels(0.01)
    np.testing.assert_array_equal(record.current_b, channels["current_a"])
    np.testing.assert_array_equal(record.current_c, channels["current_b"])
    np.testing.assert_array_equal(record.current_a, channels["current_c"])
    assert any("phase order bca" in said for said in record.provenance["changed"])


def test_a_third_phase_is_derived_and_said(bench: Path) -> None:
    record = ematwin.read(bench, {"i_a": "Phase A", "i_c": "Phase C", "cmd": "Setpoint"})
    np.testing.assert_allclose(record.current_b, bench_channels(0.01)["current_b"], atol=1e-12)
    assert record.provenance["columns"]["current_b"] == {"derived": "-(current_a + current_c)"}


def test_time_may_come_from_a_rate(bench: Path) -> None:
    record = ematwin.read(bench, {**PHASES, "cmd": "Setpoint", "sample_rate": "10 kHz"})
    assert record.sample_rate == pytest.approx(10_000)
    assert record.time[0] == 0.0


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({**PHASES, "cmd": "Setpoint", "i_a": "Phase D"},
         "no channel 'Phase D'; the closest are 'run/Phase"),
        ({"cmd": "Setpoint", "i_a": "Phase A"},
         "no channel for current_b and current_c, nor for current"),
        ({**PHASES, "without": "command"}, "no channel for command"),
    ],
)  # fmt: skip
def test_a_missing_channel_is_named(bench: Path, columns: dict[str, str], said: str) -> None:
    with pytest.raises(RecordError, match=said):
        ematwin.read(bench, columns)


def test_a_wrapped_angle_is_counted_on(tmp_path: Path) -> None:
    channels = bench_channels(0.01)
    angle = 300.0 * channels["time"] + 1.0
    path = write_hdf5(tmp_path / "wrapped.h5", {**channels, "theta": np.degrees(angle) % 360.0})
    entry = {"channel": "theta", "unit": "deg", "unwrap": True}
    table = {**{name: name for name in channels}, "theta_m": entry}
    record = ematwin.read(path, table)
    assert record.motor_position is not None
    np.testing.assert_allclose(record.motor_position, angle, atol=1e-9)


def test_the_map_is_followed_where_the_file_states_another_unit(bench: Path) -> None:
    with h5py.File(bench, "a") as file:
        file["run/Phase A"].attrs["units"] = "A"
        file["run/Phase B"].attrs["unit"] = "V"
    probe = {"channel": "Phase B", "scale": 10.0}
    entries = {**PHASES, "cmd": "Setpoint", "i_a": "Phase A [mA]", "i_b": probe}
    record = ematwin.read(bench, entries)
    np.testing.assert_allclose(record.current_a, 1e-3 * bench_channels(0.01)["current_a"])
    # a scale without a unit leads to SI
    np.testing.assert_allclose(record.current_b, 10.0 * bench_channels(0.01)["current_b"])
    assert record.provenance["warnings"] == [
        "The map gives current_a in mA, the file in A; the map was followed."
    ]
