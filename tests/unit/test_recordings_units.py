"""One resolver of names and units, for recordings of every kind of actuator."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ematwin.errors import InputError, RecordError
from ematwin.models.bldc.channels import phase_currents
from ematwin.models.reading import channels_of, read
from ematwin.models.registry import model_of
from ematwin.recordings.channel import Channel
from ematwin.recordings.channel_map import ChannelMap
from ematwin.recordings.collect import collect
from ematwin.recordings.formats.base import open_file
from ematwin.recordings.read import assumptions, read_file
from ematwin.recordings.recording import Recording
from ematwin.recordings.units import bare, is_unit, unit_factor, unit_in_name

TIME = np.arange(200) / 100.0
WAVE = np.sin(3.0 * TIME)
KINDS = ["bldc", "ball-screw"]
COMMAND = {"bldc": ("command", "rad"), "ball-screw": ("set_point", "m")}
LOOKED_FOR = {"bldc": {"current": WAVE}, "ball-screw": {"position_error": WAVE, "current": WAVE}}


def saved(path: Path, columns: dict[str, Any], units: dict[str, str] | None = None) -> Path:
    fields = [
        pa.field(
            name, pa.float64(), metadata={"unit": units[name]} if name in (units or {}) else None
        )
        for name in columns
    ]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), path)
    return path


def with_command(kind: str, name: str) -> dict[str, Any]:
    return {"time": TIME, name: 1e3 * WAVE, **LOOKED_FOR[kind]}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "spelling", ["{}_{}", "{} [{}]", "{} ({})", "{} / {}", "{}[{}]"],
)  # fmt: skip
def test_a_unit_beside_a_name_is_understood_for_every_kind(
    tmp_path: Path, kind: str, spelling: str
) -> None:
    name, si_unit = COMMAND[kind]
    path = saved(
        tmp_path / "bench.parquet", with_command(kind, spelling.format(name, f"m{si_unit}"))
    )
    found = read(path, actuator=kind)
    np.testing.assert_allclose(getattr(found, name), WAVE, atol=1e-12)
    assert found.provenance["columns"][name]["unit_from"] == "name"
    assert found.units[name] == si_unit


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_in_the_map_is_understood_for_every_kind(tmp_path: Path, kind: str) -> None:
    """It stands in the map alone: the channel is called `Demand` and nothing else."""
    name, si_unit = COMMAND[kind]
    path = saved(tmp_path / "bench.parquet", with_command(kind, "Demand"))
    for entry in (f"Demand [m{si_unit}]", {"channel": "Demand", "unit": f"m{si_unit}"}):
        found = read(path, {name: entry}, actuator=kind)
        np.testing.assert_allclose(getattr(found, name), WAVE, atol=1e-12)
        assert found.provenance["columns"][name]["unit_from"] == "map"


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_in_the_file_is_understood_for_every_kind(tmp_path: Path, kind: str) -> None:
    name, si_unit = COMMAND[kind]
    columns = with_command(kind, name)
    found = read(saved(tmp_path / "b.parquet", columns, {name: f"m{si_unit}"}), actuator=kind)
    np.testing.assert_allclose(getattr(found, name), WAVE, atol=1e-12)
    assert found.provenance["columns"][name]["unit_from"] == "file"


def test_degrees_in_a_name_of_the_bench_are_no_radians(tmp_path: Path) -> None:
    """`--column command=ref_deg` once took them for radians."""
    columns = {"t": TIME, "ref_deg": np.degrees(WAVE), "current": WAVE}
    found = read(saved(tmp_path / "bench.parquet", columns), {"command": "ref_deg"})
    np.testing.assert_allclose(found.command, WAVE)
    assert found.provenance["columns"]["command"]["unit_from"] == "name"


@pytest.mark.parametrize(
    ("name", "si_unit", "unit"),
    [
        ("set_point_mm", "m", "mm"), ("travel_um", "m", "um"), ("gap_nm", "m", "nm"),
        ("time_ms", "s", "ms"), ("command_deg", "rad", "deg"), ("torque_Nm", "N*m", "Nm"),
        ("speed_rpm", "rad/s", "rpm"), ("speed_deg_s", "rad/s", "deg/s"),
        ("speed_rad_per_s", "rad/s", "rad/s"), ("velocity_mm_s", "m/s", "mm/s"),
        ("SET_POINT_MM", "m", "mm"), ("COMMAND_DEG", "rad", "deg"), ("DRIVE_MA", "A", "ma"),
        ("drive_mA", "A", "mA"), ("drive_a", "A", "A"), ("drive_A", "A", "A"),
        ("I_a / mA", "A", "mA"), ("Travel (mm)", "m", "mm"),
        ("drive_raw", "A", None), ("command_set", "rad", None), ("command_mm", "rad", None),
        ("mm", "m", None), ("_mm", "m", None), ("set_point_", "m", None), ("speed_s", "m", None),
    ],
)  # fmt: skip
def test_where_units_stand_in_names(name: str, si_unit: str, unit: str | None) -> None:
    assert unit_in_name(name, si_unit)[1] == (unit or "")


def test_nanometres_and_newton_metres_are_told_apart() -> None:
    assert unit_factor("nm", "m", "it") == pytest.approx(1e-9)
    assert unit_factor("nm", "N*m", "it") == 1.0


def test_a_name_is_bared_of_units_only() -> None:
    assert bare("Phase A [mA]") == "Phase A"
    assert bare("I_a / mA") == "I_a"
    assert bare("bench / left") == "bench / left"
    assert bare("bench/ia") == "bench/ia"


def test_a_letter_of_a_series_is_no_ampere(tmp_path: Path) -> None:
    assert unit_in_name("phase_a", "A", ["phase_a", "phase_b", "phase_c"])[1] == ""
    columns = {"time": TIME, "set_point": WAVE, "error": WAVE}
    columns |= {f"current_{k}": WAVE for k in "abc"}
    path = saved(tmp_path / "bench.parquet", columns)
    with pytest.raises(RecordError, match="no channel for current "):
        read(path, actuator="ball-screw")
    assert read(path, {"current": "current_a"}, actuator="ball-screw").current is not None


def test_a_whole_name_goes_before_a_name_with_a_unit(tmp_path: Path) -> None:
    """`current_a` is phase a where there is one, and a current in A where there is none."""
    phases = {"time": TIME, "command": WAVE, "current_a": WAVE, "i_b": -WAVE}
    found = read(saved(tmp_path / "phases.parquet", phases))
    assert phase_currents(found) is not None
    np.testing.assert_array_equal(found.current_c, 0.0 * WAVE)
    account = found.provenance["columns"]
    assert account["current_a"]["unit_from"] == account["current_b"]["unit_from"] == "assumed"
    motion = {"time": TIME, "set_point": WAVE, "error": WAVE, "current_a": WAVE}
    found = read(saved(tmp_path / "motion.parquet", motion), actuator="ball-screw")
    np.testing.assert_array_equal(found.current, WAVE)


def test_the_plain_name_wins_over_an_alias_and_both_over_a_suffix(tmp_path: Path) -> None:
    others = {"time": TIME, "current": WAVE}
    spare = np.zeros(TIME.size)
    path = saved(tmp_path / "a.parquet", {**others, "cmd": spare, "command": WAVE})
    np.testing.assert_array_equal(read(path).command, WAVE)
    path = saved(tmp_path / "b.parquet", {**others, "command_deg": spare, "cmd": WAVE})
    np.testing.assert_array_equal(read(path).command, WAVE)
    path = saved(tmp_path / "c.parquet", {**others, "setpoint": spare, "cmd": WAVE})
    with pytest.raises(RecordError, match="several channels for command: setpoint, cmd"):
        read(path)


def test_channels_in_groups_have_units_in_their_names_too(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["bench/time_ms"] = 1e3 * TIME
        file["bench/command_deg"] = np.degrees(WAVE)
        file["bench/i_eq"] = WAVE
    np.testing.assert_allclose(read(tmp_path / "run.h5").command, WAVE)


def test_a_unit_of_another_kind_behind_a_needed_name_is_refused(tmp_path: Path) -> None:
    columns = {"time": TIME, "command_kg": WAVE, "current": WAVE}
    with pytest.raises(RecordError, match=r"command .*'command_kg'.* kind rad; received 'kg'"):
        read(saved(tmp_path / "bench.parquet", columns))


@pytest.mark.parametrize("unit", ["mm", "N", "m/s", "[mm]", "µm"])
def test_units_of_linear_actuators_are_recognised_in_tables(unit: str) -> None:
    assert is_unit(unit)


@pytest.mark.parametrize("kind", KINDS)
def test_assumed_units_are_said_for_every_kind(tmp_path: Path, kind: str) -> None:
    name, si_unit = COMMAND[kind]
    columns = {"time [s]": TIME, name: WAVE, **LOOKED_FOR[kind]}
    (said,) = assumptions(read(saved(tmp_path / "bench.parquet", columns), actuator=kind))
    assert said.startswith("Neither the map nor the file states a unit, so SI was taken: ")
    assert f"{name} in {si_unit}" in said
    assert "current in A" in said
    assert "time in s" not in said
    assert said.endswith(".")


def test_what_is_stated_is_no_assumption(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    rows = [f"{t},{w},{w}" for t, w in zip(TIME, WAVE, strict=True)]
    path.write_text("\n".join(["t [s],command [deg],i [A]", *rows, ""]))
    found = read(path)
    assert "table read with" in found.provenance["assumed"][0]
    assert assumptions(found) == []
    assert assumptions(Recording(TIME, {"command": WAVE})) == []


def test_the_pipeline_takes_any_channels(tmp_path: Path) -> None:
    """A kind of somebody else's: its channels are all that reading knows of it."""
    channels = (
        Channel("voltage", "V", "commanded voltage", ("u",)),
        Channel("speed", "rad/s", "motor speed"),
    )
    needs = ((("voltage",),), (("speed",),))
    columns = {"t": TIME, "u_mV": 1e3 * WAVE, "speed_rpm": WAVE}
    path = saved(tmp_path / "bench.parquet", columns)
    (found,) = read_file(path, channels, needs=needs, inputs=["voltage"])
    np.testing.assert_allclose(found.voltage, WAVE)
    np.testing.assert_allclose(found.speed, WAVE * np.pi / 30.0)
    assert found.units == {"voltage": "V", "speed": "rad/s"}
    wanted = ChannelMap((*channels, Channel("torque", "N*m", "torque")))
    with open_file(path) as file, pytest.raises(RecordError, match="no channel for torque"):
        collect(file, wanted, (*needs, (("torque",),)))


def test_a_map_is_for_the_channels_of_a_kind() -> None:
    screw, motor = channels_of("rm1605"), channels_of()
    assert list(ChannelMap.of({"demand": "x"}, screw).columns) == ["set_point"]
    with pytest.raises(InputError, match="no column 'demand'"):
        ChannelMap.of({"demand": "x"}, motor)
    with pytest.raises(InputError, match="three phases"):
        ChannelMap.of({"phase_order": "acb"}, screw)
    assert [one.name for one in ChannelMap(screw).channels][:2] == ["time", "set_point"]
    with pytest.raises(InputError, match="no column 'current_a'"):
        ChannelMap.of(ChannelMap.of({"i_a": "x"}, motor), screw)


@pytest.mark.parametrize("name", ["command_deg", "command [deg]", "command / deg"])
def test_a_scenario_takes_units_in_names_as_a_recording_does(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path / "bench.parquet", {"time_ms": 1e3 * TIME, name: np.degrees(WAVE)})
    command, _ = model_of("bldc").load_scenario(path).histories(TIME)
    np.testing.assert_allclose(command, WAVE, atol=1e-12)
