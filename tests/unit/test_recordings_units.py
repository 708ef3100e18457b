"""Names and units: which numbers of a file are which channel, in SI, where no map says it."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ematwin
from ematwin.errors import RecordError
from ematwin.models.proposing import propose_map
from ematwin.models.registry import model_of
from ematwin.recordings.read import assumptions

TIME = np.arange(200) / 100.0
WAVE = np.sin(3.0 * TIME)
KINDS = {"m": ("rm1605", "set_point"), "A": ("rm1605", "current"), "rad": ("servo48", "command"),
         "rad/s": ("servo48", "motor_speed"), "N*m": ("servo48", "load")}  # fmt: skip


def table(**more: np.ndarray) -> pd.DataFrame:
    """Channels of a brushless actuator and of a ball screw, all the same wave."""
    names = ("command", "current", "set_point", "position_error")
    return pd.DataFrame({"time": TIME, **dict.fromkeys(names, WAVE), **more})


def mapped(name: str, si_unit: str, **entry: str) -> tuple[np.ndarray, dict[str, str]]:
    """A channel of the file mapped for a channel of that unit: its values and its account."""
    actuator, column = KINDS[si_unit]
    columns = {column: {"channel": name, **entry}}
    found = ematwin.read(table(**{name: WAVE}), columns, actuator=actuator)
    return found.channels[column], found.provenance["columns"][column]


@pytest.mark.parametrize(
    ("unit", "si_unit", "factor"),
    [
        ("mA", "A", 1e-3), ("µm", "m", 1e-6), ("um", "m", 1e-6), ("nm", "m", 1e-9),
        ("deg", "rad", np.pi / 180), ("°", "rad", np.pi / 180), ("turn", "rad", 2 * np.pi),
        ("rpm", "rad/s", np.pi / 30), ("1/min", "rad/s", np.pi / 30),
        ("U/min", "rad/s", np.pi / 30), ("°/s", "rad/s", np.pi / 180),
        ("rev/s", "rad/s", 2 * np.pi), ("Nm", "N*m", 1.0), ("nm", "N*m", 1.0),
        ("mNm", "N*m", 1e-3), ("N m", "N*m", 1.0),
    ],
)  # fmt: skip
def test_units_of_benches_are_known(unit: str, si_unit: str, factor: float) -> None:
    for name, entry in (("x", {"unit": unit}), (f"x [{unit}]", {}), (f"x / {unit}", {})):
        if " / " not in name or " " not in unit:
            np.testing.assert_allclose(mapped(name, si_unit, **entry)[0], factor * WAVE)


@pytest.mark.parametrize(
    ("unit", "si_unit"),
    [("%", "rad"), ("Hz", "rad/s"), ("V", "A"), ("counts", "rad"), ("", "A"), ("deg", "rad/s")],
)
def test_a_unit_of_another_kind_is_refused(unit: str, si_unit: str) -> None:
    with pytest.raises(RecordError, match=f"must have a unit of the kind {re.escape(si_unit)}"):
        mapped("x", si_unit, unit=unit)


@pytest.mark.parametrize(
    ("name", "si_unit", "unit"),
    [
        ("set_point_mm", "m", "mm"), ("travel_um", "m", "um"), ("gap_nm", "m", "nm"),
        ("command_deg", "rad", "deg"), ("torque_Nm", "N*m", "Nm"), ("speed_rpm", "rad/s", "rpm"),
        ("speed_deg_s", "rad/s", "deg/s"), ("speed_rad_per_s", "rad/s", "rad/s"),
        ("SET_POINT_MM", "m", "mm"), ("COMMAND_DEG", "rad", "deg"), ("DRIVE_MA", "A", "ma"),
        ("drive_mA", "A", "mA"), ("drive_a", "A", "A"), ("drive_A", "A", "A"),
        ("I_a / mA", "A", "mA"), ("Travel (mm)", "m", "mm"), ("bench / left", "A", None),
        ("drive_raw", "A", None), ("command_set", "rad", None), ("command_mm", "rad", None),
        ("mm", "m", None), ("_mm", "m", None), ("set_point_", "m", None), ("speed_s", "m", None),
        ("Phase [left]", "A", None), ("bench/ia", "A", None),
    ],
)  # fmt: skip
def test_where_units_stand_in_names(name: str, si_unit: str, unit: str | None) -> None:
    account = mapped(name, si_unit)[1]
    assert account["unit_from"] == ("name" if unit else "assumed")
    assert account["unit"] == (unit or si_unit)


@pytest.mark.parametrize("name", ["command_deg", "command [deg]", "command / deg", "cmd(deg)"])
def test_a_name_may_have_a_unit_where_there_is_no_map(tmp_path: Path, name: str) -> None:
    columns = pd.DataFrame({"time_ms": 1e3 * TIME, name: np.degrees(WAVE), "i_eq": WAVE})
    np.testing.assert_allclose(ematwin.read(columns).command, WAVE)
    columns.to_csv(tmp_path / "bench.csv", index=False)
    if name.startswith("command"):  # a scenario has no aliases
        scenario = model_of("bldc").load_scenario(tmp_path / "bench.csv")
        np.testing.assert_allclose(scenario.histories(TIME)[0], WAVE, atol=1e-12)


def test_assumed_units_are_said_and_stated_ones_are_not() -> None:
    (said,) = assumptions(ematwin.read(table().rename(columns={"time": "time [s]"})))
    assert said == (
        "Neither the map nor the file states a unit, so SI was taken: command in rad, current in A."
    )
    frame = pd.DataFrame({"t [s]": TIME, "command [deg]": WAVE, "i [A]": WAVE})
    assert assumptions(ematwin.read(frame)) == []


# Names, where there is no map


@pytest.mark.parametrize(
    ("others", "taken"),
    [
        (["cmd", "command"], "command"),  # the plain name before an alias
        (["command_deg", "cmd"], "cmd"),  # both before a name with a unit
        (["command_deg", "bench"], "command_deg"),
    ],
)
def test_the_plainest_name_wins(others: list[str], taken: str) -> None:
    found = ematwin.read(pd.DataFrame({"time": TIME, **dict.fromkeys(others, WAVE), "i": WAVE}))
    assert found.provenance["columns"]["command"]["channel"] == taken


def test_names_that_mean_the_same_are_refused() -> None:
    with pytest.raises(RecordError, match="several channels for command: setpoint, cmd"):
        ematwin.read(pd.DataFrame({"t": TIME, "setpoint": WAVE, "cmd": WAVE, "i": WAVE}))


def test_a_letter_of_a_series_is_no_ampere() -> None:
    """`current_a` is phase a where there is a phase b, and a current in A else."""
    series = pd.DataFrame({"time": TIME, "set_point": WAVE, "error": WAVE,
                           **{f"current_{k}": WAVE for k in "abc"}})  # fmt: skip
    with pytest.raises(RecordError, match="no channel for current "):
        ematwin.read(series, actuator="rm1605")
    assert ematwin.read(series, {"current": "current_a"}, actuator="rm1605").current is not None
    alone = series.drop(columns=["current_b", "current_c"])
    np.testing.assert_array_equal(ematwin.read(alone, actuator="rm1605").current, WAVE)
    record = ematwin.read(series.rename(columns={"set_point": "command"}))
    account = record.provenance["columns"]
    assert account["current_a"]["unit_from"] == account["current_b"]["unit_from"] == "assumed"


def test_a_unit_of_another_kind_behind_a_needed_name_is_refused() -> None:
    with pytest.raises(RecordError, match=r"command .*'command_kg'.* kind rad; received 'kg'"):
        ematwin.read(pd.DataFrame({"time": TIME, "command_kg": WAVE, "current": WAVE}))


@pytest.mark.parametrize("current", ["current [V]", "current / mm", "i (N m)"])
def test_a_unit_of_another_kind_beside_a_name_is_refused(current: str) -> None:
    frame = pd.DataFrame({"time": TIME, "command": WAVE, current: WAVE})
    with pytest.raises(RecordError, match=r"current .* kind A; received '(V|mm|N m)'"):
        ematwin.read(frame)
    assert ematwin.read(frame, {"i": {"channel": current, "scale": 2}}).current[5] == 2 * WAVE[5]
    asked = [one.sentence for one in propose_map(frame).questions]
    assert any("has the name of current, which is in A and not in" in one for one in asked)
