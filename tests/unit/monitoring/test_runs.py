"""Tables of runs: which recordings they name, and one answer on several actuators."""

import re
import shutil
import signal
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import ematwin
from ematwin.errors import EmatwinError, InputError
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.detection import Detection
from ematwin.monitoring.runs import is_table_of_runs, read_runs
from refusals import refused


def known_of(given: Any, first: Path) -> Calibration:
    return Calibration.of(given)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two actuators: the second has twice the friction of the first; recordings of both."""
    tmp_path = tmp_path_factory.mktemp("made")
    sheet = ematwin.load_actuator("servo48")
    for name, factor in (("A1", 1.0), ("A2", 2.0)):
        friction = factor * sheet.value("motor.friction_torque")
        own = sheet.changed({"motor.friction_torque": friction}).model_copy(update={"name": name})
        ematwin.Calibration.of(own).save(tmp_path / f"{name}.toml")
        (tmp_path / name).mkdir()
        for n, worn in ((2, 0.0), (10, 0.3)):
            record = ematwin.simulate("monitor", actuator=own, faults={"friction": worn}, seed=n)
            record.changed(start=None).save(tmp_path / name / f"day{n}.parquet")
    return tmp_path


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy to work in."""
    return shutil.copytree(made, tmp_path, dirs_exist_ok=True)


HEAD = "path,actuator,serial,time,place\n"
TABLES: dict[str, Callable[[Path], Any]] = {
    "rows": lambda at: HEAD
    + "A1/day2.parquet,A1.toml,EMA-1,2026-03-01,rig\nA1/day10.parquet,A1.toml,EMA-1,,\n"
    + "A2,A2.toml,EMA-2,,\n",
    "semicolons": lambda at: "Path;Actuator;Serial;Time;Place\r\nA1/*;A1.toml;EMA-1;"
    "01.03.2026 00:00:00;rig\r\nA2/*.parquet;A2.toml;EMA-2;;\r\n",
    "frame": lambda at: pd.DataFrame(
        {
            "path": [at / "A1", at / "A2"],
            "actuator": [str(at / "A1.toml"), str(at / "A2.toml")],
            "serial": ["EMA-1", "EMA-2"],
            "time": [pd.Timestamp("2026-03-01"), pd.NaT],
            "place": ["rig", None],
        }
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [*TABLES, "parquet"])
def test_a_table_names_recordings_actuators_and_times(folder: Path, name: str) -> None:
    table = TABLES["frame" if name == "parquet" else name](folder)
    if isinstance(table, str):
        (folder / "runs.csv").write_text(table)
        table = folder / "runs.csv"
    if name == "parquet":
        table.assign(path=table.path.map(str)).to_parquet(folder / "runs.parquet")
        table = folder / "runs.parquet"
    assert is_table_of_runs(table)
    first, second = read_runs(table, known_of=known_of).groups
    assert [first.name, second.name] == ["EMA-1", "EMA-2"]
    assert [first.known.actuator.name, second.known.actuator.name] == ["A1", "A2"]
    for group in (first, second):
        assert [one.source for one in group.recordings] == ["day2.parquet", "day10.parquet"]
    assert first.recordings[0].start == datetime(2026, 3, 1)
    assert first.recordings[0].labels == {"place": "rig"}
    assert second.recordings[0].start is None


def test_an_actuator_without_serial_numbers_has_its_name(folder: Path) -> None:
    frame = pd.DataFrame({"path": [folder / "A1", folder / "A2"]})
    (group,) = read_runs(frame, folder / "A1.toml", known_of=known_of).groups
    assert group.name == "A1"
    assert len(group.recordings) == 4


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("", "names no recording"),
        (",A1.toml,,,\n", "no path in row 1"),
        ("none.csv,A1.toml,,,\n", "There is no file"),
        ("A1/day2.parquet,none.toml,,,\n", "No such file"),
        ("A1/day2.parquet,A1.toml,,yesterday,\n", "row 1 has the time 'yesterday'"),
        ("A1/day2.parquet,A1.toml,,09:14:02,\n", "row 1 has the time '09:14:02'"),
        ("A1/day2.parquet,A1.toml,1,2026-03-01,a,b\n", "6 cells in row 1 and 5 in its header"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_in_one_sentence(folder, rows, said):
    (folder / "runs.csv").write_text(HEAD + rows)
    with pytest.raises(EmatwinError, match=re.escape(said)):
        ematwin.identify(folder / "runs.csv")


@pytest.fixture
def found(folder: Path) -> Detection:
    """Each actuator judged by its own file; friction alone is searched, which is quick."""
    (folder / "runs.csv").write_text(TABLES["rows"](folder))
    return ematwin.identify(folder / "runs.csv", exact=True, only="friction")


def test_each_recording_is_judged_by_its_own_actuator(found: Detection, tmp_path: Path) -> None:
    assert list(found.actuators) == ["EMA-1", "EMA-2"]
    for one in found.actuators.values():
        assert [row.grade for row in one.motions] == ["healthy", "fault"]
    assert found.grade == "fault"
    assert found.sentence == (
        "2 of 2 actuators raise an alarm: EMA-1 (friction) and EMA-2 (friction). "
        "2 of 4 recordings raise an alarm: friction in 2."
    )
    assert found["EMA-1"].motions[0].when == "2026-03-01T00:00:00"
    assert found["EMA-1"].sentence == "1 of 2 recordings raise an alarm: friction in 1."
    assert found["EMA-1"].plot().data
    with pytest.raises(InputError, match=r"plot one, e.g. found\['EMA-1'\]"):
        found.plot()
    frame = found.to_frame()
    assert list(frame.index) == ["EMA-1", "EMA-1", "EMA-2", "EMA-2"]
    assert "EMA-2" in found._repr_html_()
    found.report(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert all(f"EMA-{n}" in page for n in (1, 2))


def test_an_interruption_keeps_the_actuators_that_were_done(folder: Path) -> None:
    frame = TABLES["frame"](folder)
    seen = []

    def stop(done: int, cost: float, count: int) -> None:
        seen.append((done, count))
        if done == 2:
            signal.raise_signal(signal.SIGINT)

    found = ematwin.identify(frame, exact=True, only="friction", progress=stop)
    assert seen == [(1, 4), (2, 4)]
    assert list(found.actuators) == ["EMA-1"]
    assert found.missing == 2
    assert "Interrupted: 2 more were not judged." in found.sentence


def test_the_shell_gives_one_table_of_several_actuators(folder: Path, ematwin: Any) -> None:
    (folder / "runs.csv").write_text(TABLES["rows"](folder))
    options = ("--exact", "--only", "friction", "--fail-on", "fault", "--table", "verdicts.csv")
    answer = ematwin("identify", "runs.csv", *options)
    assert answer.code == 1, answer.err
    assert re.search(r"EMA-1 .*day2.parquet .*healthy", answer.out)
    assert re.search(r"EMA-2 .*day10.parquet .*friction", answer.out)
    assert pd.read_csv(folder / "verdicts.csv")["actuator"].tolist() == [
        "EMA-1", "EMA-1", "EMA-2", "EMA-2"
    ]  # fmt: skip
    for arguments, said in (
        (("detect", "A1"), "detect needs a calibrated actuator"),
        (
            ("detect", "runs.csv", "A1"),
            "runs.csv is a table of runs (a column path); give it alone",
        ),
    ):
        refused(ematwin(*arguments), said)
