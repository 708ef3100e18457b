"""Which channel is which, proposed: right where the file tells, a question where it does not."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ematwin
from bench_files import german_csv, write_mdf
from ematwin.errors import RecordError
from ematwin.models.proposing import propose_map
from ematwin.recordings.proposal import Proposal
from ematwin.recordings.survey import survey
from ematwin.testing.reader_contract import bench_channels

CHANNELS = bench_channels()
TIME, COMMAND = CHANNELS["time"], CHANNELS["command"]
A, B, C = (CHANNELS[f"current_{letter}"] for letter in "abc")
LOAD = np.where(TIME > 0.05, 10.0, 0.0)
DEGREES = np.degrees(COMMAND)


def proposed(folder: Path, columns: dict[str, np.ndarray], actuator: str = "servo48") -> Proposal:
    """The map that is proposed for ``bench.csv`` in a folder, which is written with these."""
    return propose_map(german_csv(folder / "bench.csv", columns), actuator)


def channel_of(proposal: Proposal) -> dict[str, str]:
    return {name: entry.channel for name, entry in proposal.entries.items()}


def test_an_ugly_german_file_is_understood_and_its_map_reads_it(tmp_path: Path) -> None:
    columns = {
        "Zeit [ms]": 1e3 * TIME, "Sollwert Lage [°]": DEGREES, "Strom U [mA]": 1e3 * A,
        "Strom V [mA]": 1e3 * B, "Strom W [mA]": 1e3 * C, "Lastmoment [Nm]": LOAD,
        "Temp Motor [°C]": np.full(TIME.size, 23.5), "Sollwert Strom [A]": A,
    }  # fmt: skip
    proposal = proposed(tmp_path, columns)
    assert channel_of(proposal) == {
        "time": "Zeit [ms]", "command": "Sollwert Lage [°]", "load": "Lastmoment [Nm]",
        "current_a": "Strom U [mA]", "current_b": "Strom V [mA]", "current_c": "Strom W [mA]",
    }  # fmt: skip
    assert proposal.is_complete
    assert not proposal.questions
    assert "Temp Motor [°C]" in proposal.unused
    (tmp_path / "map.toml").write_text(proposal.as_toml(), encoding="utf-8")
    record = ematwin.read(tmp_path / "bench.csv", tmp_path / "map.toml")
    np.testing.assert_allclose(record.command, COMMAND, atol=1e-8)
    np.testing.assert_allclose(record.current_b, B, atol=1e-6)


def test_units_that_nobody_states_are_told_only_where_one_is_plausible(tmp_path: Path) -> None:
    columns = {"Zeit": 1e3 * TIME, "Sollwert": DEGREES, "Strom U": 1e3 * A, "Strom V": 1e3 * B}
    proposal = proposed(tmp_path, columns)
    units = {name: entry.unit for name, entry in proposal.entries.items()}
    assert units == {"time": "ms", "current_a": "mA", "current_b": "mA", "command": ""}
    assert proposal.entries["command"].units == ("rad", "deg")
    assert not proposal.is_complete
    assert any("rad or deg are equally plausible" in one.sentence for one in proposal.questions)
    assert '# command = { channel = "Sollwert", unit = "deg" }' in proposal.as_toml()
    assert "command" not in proposal.columns()
    reason = " ".join(proposal.entries["time"].reasons)
    assert "a sample every 5e-05 s" in reason
    assert "sampled at 20 Hz" in reason  # why not seconds, in the words of the kind's own check


def test_degrees_beyond_the_end_stops_cannot_be_radians(tmp_path: Path) -> None:
    wide = 100.0 * DEGREES
    columns = {"Zeit [s]": TIME, "Sollwert": wide, "Strom U [A]": A, "Strom V [A]": B}
    entry = proposed(tmp_path, columns).entries["command"]
    assert (entry.unit, entry.unit_from) == ("deg", "plausibility")
    assert "would be refused" in entry.reasons[-1]


@pytest.mark.parametrize(
    ("names", "asked"),
    [
        (["Soll 1 [deg]", "Soll 2 [deg]"], "“Soll 1 [deg]” and “Soll 2 [deg]” are equally likely"),
        (["links/Sollwert [deg]", "rechts/Sollwert [deg]"], "equally likely to be command"),
    ],
)
def test_two_channels_that_are_equally_likely_are_asked_for(tmp_path, names, asked):
    commands = dict.fromkeys(names, DEGREES)
    columns = {"Zeit [s]": TIME, **commands, "Strom U [A]": A, "Strom V [A]": B}
    proposal = proposed(tmp_path, columns)
    assert "command" not in proposal.entries
    assert asked in proposal.questions[0].sentence
    assert len(proposal.questions[0].lines) == 2
    assert not proposal.is_complete


def test_an_angle_without_a_shaft_goes_by_how_far_it_moves(tmp_path: Path) -> None:
    known = {"Zeit [s]": TIME, "Setpoint [deg]": DEGREES, "Phase A [A]": A, "Phase B [A]": B}
    for factor, name in ((0.97, "output_position"), (500.0, "motor_position")):
        proposal = proposed(tmp_path, {**known, "Position [deg]": factor * DEGREES})
        assert channel_of(proposal)[name] == "Position [deg]"
        assert "times as far as the command" in proposal.entries[name].reasons[0]
    proposal = proposed(tmp_path, {**known, "Position [deg]": 3.0 * DEGREES})  # of neither shaft
    assert not {"output_position", "motor_position"} & proposal.entries.keys()
    assert "motor_position or output_position" in proposal.questions[0].sentence


def test_other_quantities_are_not_taken_for_what_they_resemble(tmp_path: Path) -> None:
    columns = {
        "t [s]": TIME, "Speed setpoint [rpm]": A, "Current setpoint [A]": A,
        "Motor torque [Nm]": B, "Position limit [deg]": C, "U_a [V]": A,
    }  # fmt: skip
    proposal = proposed(tmp_path, columns)
    assert set(proposal.entries) == {"time", "voltage_a"}
    needed = [one.sentence for one in proposal.questions if one.needed]
    assert any("command" in sentence for sentence in needed)
    assert any("current" in sentence for sentence in needed)


def test_units_that_a_file_states_are_surveyed_and_mapped(tmp_path: Path) -> None:
    path = tmp_path / "run.mf4"
    signals = {"Setpoint": (DEGREES, "deg"), "Phase A": (A, "A"), "Phase B": (B, "A")}
    write_mdf(path, (TIME, signals))
    found = survey(path)
    proposal = propose_map(path, found=found)
    assert {"command", "current_a", "current_b"} <= set(proposal.columns())
    record = ematwin.read(path, proposal.columns())
    assert record.sample_rate == pytest.approx(20_000)
    np.testing.assert_allclose(record.command, COMMAND, atol=1e-8)
    np.testing.assert_allclose(record.current_b, B, atol=1e-8)
    command = found[proposal.entries["command"].channel]
    assert command.unit == "deg"
    assert command.high == pytest.approx(np.degrees(0.005), rel=1e-3)
    assert command.samples == TIME.size


def test_another_kind_is_asked_for_its_own_channels(tmp_path: Path) -> None:
    position = 0.1 * np.sin(20.0 * TIME)
    columns = {
        "t [ms]": 1e3 * TIME, "Demand [mm]": 1e3 * position,
        "Following error [mm]": 0.01 * position, "Drive current [A]": A,
    }  # fmt: skip
    proposal = proposed(tmp_path, columns, "rm1605")
    assert channel_of(proposal) == {
        "time": "t [ms]", "set_point": "Demand [mm]", "position_error": "Following error [mm]",
        "current": "Drive current [A]",
    }  # fmt: skip


def test_a_file_of_text_and_holes_is_still_listed(tmp_path: Path) -> None:
    path = tmp_path / "odd.csv"
    rows = [f"{t:.5f};{'on' if t < 0.05 else 'off'};{'' if t > 0.09 else f'{t:.3f}'}" for t in TIME]
    path.write_text("\n".join(["t [s];state;level", *rows, ""]), encoding="utf-8")
    found = survey(path)
    assert found["state"].text == "on, off"
    assert found["level"].missing == int((TIME > 0.09).sum())
    assert found["t [s]"].unit == "s"


@pytest.mark.parametrize(
    ("actuator", "name", "column"),
    [
        ("servo48", "Phase A [A]", "current_a"), ("servo48", "I_a [A]", "current_a"),
        ("servo48", "Strom U [A]", "current_a"), ("servo48", "iL2 [A]", "current_b"),
        ("servo48", "current3 [A]", "current_c"), ("servo48", "theta_m [rad]", "motor_position"),
        ("servo48", "n_mot [rpm]", "motor_speed"), ("servo48", "U_dc [V]", "bus_voltage"),
        ("servo48", "M_Last [Nm]", "load"), ("servo48", "Hinge moment [Nm]", "load"),
        ("servo48", "Zeit [s]", "time"), ("servo48", "SetPoint [deg]", "command"),
        ("rm1605", "Schleppfehler [mm]", "position_error"),
        ("servo48", "607Ah Target position", "command"),  # CiA 402
        ("rm1605", "0x6064", "position"),
        ("servo48", "axis0.controller.input_pos", "command"),  # ODrive
        ("servo400", "axis0.motor.Iq_measured", "current_q"),
        ("servo400", "Id_measured", "current_d"), ("servo400", "Id [A]", "current_d"),
        ("servo400", "q_current", "current_q"),  # moteus
        ("servo400", "vel_estimate", "motor_speed"), ("servo400", "shaft_velocity", "motor_speed"),
        ("servo48", "Goal_Position", "command"),  # Dynamixel, Feetech
        ("servo48", "Present_Load", None), ("servo48", "/joint_states/effort[knee]", None),  # ROS
    ],
)  # fmt: skip
def test_words_of_benches_are_known(actuator: str, name: str, column: str | None) -> None:
    proposal = propose_map(pd.DataFrame({name: COMMAND}), actuator)
    assert channel_of(proposal) == ({column: name} if column else {})


def test_what_may_be_something_else_is_no_load_and_no_voltage(tmp_path: Path) -> None:
    columns = {
        "t [s]": TIME, "Sollwinkel [deg]": DEGREES, "Phase A [mV]": 100.0 * A,
        "Phase B [mV]": 100.0 * B, "Torque actual value": C, "Load position": COMMAND,
        "Motordrehzahl [1/min]": A,
    }  # fmt: skip
    proposal = proposed(tmp_path, columns)
    assert channel_of(proposal) == {
        "time": "t [s]", "command": "Sollwinkel [deg]", "motor_speed": "Motordrehzahl [1/min]",
    }  # fmt: skip
    assert any("the motor's own torque" in one.sentence for one in proposal.questions)


def test_a_map_takes_what_reading_takes(tmp_path: Path) -> None:
    """The plainest name wins in both, and the map says what would do as well."""
    columns = {"time": TIME, "command_deg": DEGREES, "cmd": COMMAND, "current": A}
    proposal = proposed(tmp_path, columns)
    account = ematwin.read(tmp_path / "bench.csv").provenance["columns"]
    assert channel_of(proposal) == {name: one["channel"] for name, one in account.items()}
    assert "“command_deg” would do as well" in " ".join(proposal.entries["command"].reasons)


def test_a_refusal_names_the_channel_that_is_likely_meant(tmp_path: Path) -> None:
    names = {"Zeit [s]": TIME, "Temp Sollwert [°C]": A, "Sollwert Lage [°]": DEGREES, "I [A]": A}
    path = german_csv(tmp_path / "bench.csv", names)
    with pytest.raises(RecordError, match=r'Map it, such as command="Sollwert Lage \[°\]"'):
        ematwin.read(path)
    assert len(ematwin.read(path, {"command": "Sollwert Lage [°]"})) == TIME.size


@pytest.mark.parametrize(
    ("unit", "is_complete"), [(" [mm]", True), ("", False)]
)  # position stands in for the position error, which the recording holds
def test_a_position_in_place_of_its_error_is_mapped(tmp_path, unit, is_complete):
    wave = 100.0 * np.sin(20.0 * TIME)
    columns = {"t [s]": TIME, f"demand{unit}": wave, f"position{unit}": 0.9 * wave, "I [A]": A}
    proposal = proposed(tmp_path, columns, "rm1605")
    assert proposal.is_complete == is_complete
    assert set(proposal.entries) == {"time", "set_point", "position", "current"}
