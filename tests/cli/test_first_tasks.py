"""Three first tasks, from the files of a bench to a right answer, by commands alone."""

import re
import shlex
import tomllib
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pytest

import ematwin
from bench_files import write_mdf
from bldc_inputs import HALF
from commands import inside
from ematwin.cli import main

NOISE = ematwin.Noise(white=0.02, bits=12)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """Run a command in this process, in an empty folder; gives its answer."""
    monkeypatch.chdir(tmp_path)

    def run(command: str) -> str:
        answer = inside(main, "ematwin", *shlex.split(command))
        assert answer.code == 0, answer.err
        return answer.out

    return run


def interval(answer: str, fault: str) -> tuple[float, float]:
    """The interval of a fault in SI, as the verdict states it."""
    said = r"(?:[^,()]*, )?(?:95 % interval )?([\d.]+) to ([\d.]+)"
    found = re.search(rf"{fault} [^(]*\({said}\)", answer)
    assert found, answer
    return float(found[1]), float(found[2])


def recorded(actuator, seed, faults=None, rate=20_000.0):
    """What the sensors of an actuator give on half of the default command."""
    return ematwin.simulate(
        "reference", HALF, faults, actuator, noise=NOISE, seed=seed, sample_rate=rate
    )


def write_mf4(path: str, record: ematwin.Recording) -> None:
    """MDF4 as a bench writes it: mA and degrees, three rates, a clock that began earlier."""
    currents = {"I_U": record.current_a, "I_V": record.current_b, "I_W": record.current_c}
    clock = record.time + 12.34
    write_mdf(
        Path(path),
        (clock, {name: (1e3 * values, "mA") for name, values in currents.items()}),
        (clock[::4], {"SetpointPos": (np.degrees(record.command)[::4], "deg")}),
        (clock[::20], {"LoadCell": (record.load[::20], "Nm")}),
        start=datetime(2026, 11, 20, 8, 30, tzinfo=UTC),
    )


def test_a_bench_file_comes_to_its_verdict(run: Callable[[str], str], tmp_path: Path) -> None:
    actual = ematwin.load_actuator("servo48").changed({
        "motor.resistance": 2.2, "motor.emf_constant": 0.074, "motor.friction_torque": 0.018,
        "controller.position_gain": 142.0,
    })  # fmt: skip
    write_mf4("healthy.mf4", recorded(actual, 1))
    write_mf4("today.mf4", recorded(actual, 9, {"friction": 0.3, "backlash": 0.12}))
    run("channels today.mf4 --actuator servo48 --write map.toml")
    run("calibrate healthy.mf4 --actuator servo48 --map map.toml --out axis.toml")
    answer = run("identify today.mf4 --actuator axis.toml --map map.toml --report today.html")
    for fault, truth in (("friction", 0.033 * 1.6), ("backlash", 0.005 * (1 + 99 * 0.12))):
        low, high = interval(answer, fault)
        assert low <= truth <= high
        assert high - low < 0.15 * truth
    assert (tmp_path / "today.html").stat().st_size > 100_000


SHEET = {
    "resistance": '1.30, unit = "ohm"', "inductance": '0.56, unit = "mH"',
    "emf_constant": '47.8, unit = "mNm/A"', "pole_pairs": '4, unit = ""',
    "inertia": '33.3, unit = "gcm²"', "friction_torque": '8.4, unit = "mNm"',
    "supply_voltage": '36, unit = "V"', "current_limit": '16, unit = "A"',
    "position_gain": '100, unit = "1/s"', "speed_gain": '0.0382, unit = "N*m*s/rad"',
    "speed_limit": '6000, unit = "rpm"', "ratio": '300, unit = ""',
    "backlash": '30, unit = "arcmin"', "output_inertia": '0.01556, unit = "kgcm²"',
    "efficiency_opposing": '88, unit = "%"', "efficiency_aiding": '88, unit = "%"',
    "travel_low": '-40, unit = "deg"', "travel_high": '40, unit = "deg"',
}  # fmt: skip
HIDDEN = {
    "motor.resistance": 1.34, "motor.inductance": 0.56e-3, "motor.emf_constant": 0.0492,
    "motor.pole_pairs": 4, "motor.inertia": 3.53e-6, "motor.viscous_damping": 2e-5,
    "motor.friction_torque": 0.0135, "drive.supply_voltage": 35.6, "drive.current_limit": 16.0,
    "controller.position_gain": 108.0, "controller.speed_gain": 0.04,
    "controller.speed_limit": 628.3, "transmission.ratio": 300, "transmission.backlash": 0.0065,
    "transmission.output_inertia": 1.6e-6, "transmission.friction_torque": 0.012,
    "transmission.travel_low": -0.698, "transmission.travel_high": 0.698,
}  # fmt: skip


def write_csv(path: str, record: ematwin.Recording) -> None:
    """CSV in ms, degrees and mA, counted from 250 ms on."""
    columns = {
        "Time (ms)": 1e3 * record.time + 250.0,
        "Demand (deg)": np.degrees(record.command),
        "Hinge moment (Nm)": record.load,
        "Phase A (mA)": 1e3 * record.current_a,
        "Phase B (mA)": 1e3 * record.current_b,
        "Phase C (mA)": 1e3 * record.current_c,
        "Resolver (deg)": np.degrees(record.motor_position),
    }
    rounded = {name: np.round(values, 5) for name, values in columns.items()}
    pa.csv.write_csv(pa.table(rounded), path)


def test_a_data_sheet_comes_to_its_twin(run: Callable[[str], str], tmp_path: Path) -> None:
    hidden = ematwin.load_actuator("servo48").changed(HIDDEN)
    write_csv("healthy.csv", recorded(hidden, 20))
    write_csv("later.csv", recorded(hidden, 32, {"short_b": 0.15, "friction": 0.2}))
    run("actuators servo48 --out sheet.toml")
    sheet = tmp_path / "sheet.toml"
    text = sheet.read_text(encoding="utf-8")
    for key, value in SHEET.items():
        line = f'{key} = {{ value = {value}, source = "data sheet" }}'
        text = re.sub(rf"(?m)^{key} = .*$", line, text)
    sheet.write_text(text, encoding="utf-8")
    run("channels healthy.csv --actuator sheet.toml --write bench.toml")
    run("calibrate healthy.csv --actuator sheet.toml --map bench.toml --out twin.toml")
    answer = run("identify later.csv --actuator twin.toml --map bench.toml")
    low, high = interval(answer, "friction")
    assert low <= 0.0255 * 1.4 <= high
    low, high = interval(answer, "shorted turns in phase b")
    assert low <= 0.15 * 40 <= high
    twin = tomllib.loads((tmp_path / "twin.toml").read_text(encoding="utf-8"))
    for section, name, truth, share in (
        ("motor", "emf_constant", 0.0492, 0.04), ("motor", "inertia", 3.53e-6, 0.04),
        ("motor", "friction_torque", 0.0135, 0.04), ("controller", "position_gain", 108.0, 0.01),
        ("transmission", "backlash", 0.0065, 0.02),
    ):  # fmt: skip
        assert twin[section][name]["value"] == pytest.approx(truth, rel=share)


def test_a_workbook_with_clock_times_comes_to_its_verdict(run: Callable[[str], str]) -> None:
    """Excel, German names, mA and degrees, moments of the day; from a frame to a page."""
    actual = ematwin.load_actuator("servo48").changed({"motor.friction_torque": 0.018})
    for name, faults in (("healthy", None), ("today", {"friction": 0.3})):
        record = recorded(actual, 3, faults, 5000.0)  # Excel is slow
        began = np.datetime64("2026-03-03T09:14:02", "us")
        frame = pd.DataFrame({
            "Uhrzeit": began + np.round(1e6 * record.time).astype("timedelta64[us]"),
            "Sollwert [°]": np.degrees(record.command), "Last [Nm]": record.load,
            "Strom U [mA]": 1e3 * record.current_a, "Strom V [mA]": 1e3 * record.current_b,
            "Strom W [mA]": 1e3 * record.current_c,
        })  # fmt: skip
        frame.to_excel(f"{name}.xlsx", index=False)
    run("channels today.xlsx --actuator servo48 --write map.toml")
    run("calibrate healthy.xlsx --actuator servo48 --map map.toml --out axis.toml")
    answer = run("identify today.xlsx --actuator axis.toml --map map.toml")
    low, high = interval(answer, "friction")
    assert low <= 0.033 * 1.6 <= high
