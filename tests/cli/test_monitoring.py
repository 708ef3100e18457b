"""``ematwin calibrate``, ``detect`` and ``identify`` on motions, from the files to the verdict."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import ematwin as ematwin_module
from commands import inside, script
from ematwin.cli import main
from ematwin.models.registry import shipped_actuators
from made_up_rig import healthy_runs, run
from refusals import untouched

HEALTHY = ("calibrate", "bench.csv", "--where", "condition=normal", "--out", "rig.toml")


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Path:
    """Recordings of a rig, and what calibrating with them left and told."""
    folder = tmp_path_factory.mktemp("bench")
    dry = [one for n in (60, 61) for one in run(n, 1, "dry", friction=1.3)]
    loose = run(62, 1, "loose", backlash=8e-4)
    ematwin_module.write([*healthy_runs(7), *dry, *loose], folder / "bench.csv")
    ematwin_module.write([*run(63, 1, "dry", friction=1.35), *run(8, 1)], folder / "later.parquet")
    ematwin_module.write(run(63, 1, "dry", friction=1.35)[0], folder / "one.parquet")
    done = inside(main, "ematwin", *HEALTHY, "--json", folder=folder)
    assert (done.code, done.err) == (0, "")
    (folder / "told.json").write_text(done.out, encoding="utf-8")
    return folder


@pytest.fixture
def files(bench: Path, tmp_path: Path) -> Path:
    """A copy of them to work in."""
    for path in bench.iterdir():
        shutil.copy(path, tmp_path)
    return tmp_path


# calibrate


def test_calibrate_tells_programs_what_it_learnt(files):
    told = json.loads((files / "told.json").read_text(encoding="utf-8"))
    assert told["out"] == "rig.toml"
    assert told["actuator"] == "rig"
    assert told["learnt"] == ["1", "2", "3", "4", "5", "6", "7"]
    friction = told["parameters"]["screw.friction_force"]
    assert friction["value"] == pytest.approx(3125.0, rel=0.04)
    assert friction["template"] == 2500.0
    assert friction["determined"] is True
    assert set(told["spread"]) == {"friction", "backlash", "gain", "roughness"}
    assert told["signatures"] == []
    assert told["kind"] == "ball-screw"
    assert told["assumed"] == told["warnings"] == []


def test_calibrate_tells_people_the_same_and_learns_known_faults(done, files):
    answer = done(*HEALTHY[:-1], "taught.toml", "--known", "no grease:condition=dry;run=60,61")
    told = json.loads((files / "told.json").read_text(encoding="utf-8"))
    for place, parameter in told["parameters"].items():
        row = next(line for line in answer.out.splitlines() if place in line)
        low, high = (float(end) for end in re.search(r"([\d.e-]+) to ([\d.e-]+)", row).groups())
        assert 0.9 * low <= parameter["value"] <= 1.1 * high
        assert ("not determined" in row) == (not parameter["determined"])
    assert "learnt from runs 1, 2, 3, 4, 5, 6, 7" in answer.out
    assert re.search(r"backlash +scatters by [\d.]+ mm within a run", answer.out)
    assert "healthy reference: 28 recordings with condition normal" in answer.out
    assert "Not fitted: screw.lead, screw.backlash," in answer.out
    assert "known fault: no grease, from 4 motions: condition=dry;run=60,61" in answer.out
    assert "wrote taught.toml" in answer.out

    answer = done("detect", "later.parquet", "--actuator", "taught.toml", "--json")
    assert [v["fault"] for v in answer.told["verdicts"]][:2] == ["no grease"] * 2


def test_later_healthy_runs_are_added_from_the_shell(done, files):
    ematwin_module.write(healthy_runs(1, first=20), files / "spring.csv")
    answer = done("calibrate", "spring.csv", "--add", "rig.toml", "--out", "more.toml")
    assert "learnt from runs 1, 2, 3, 4, 5, 6, 7, 20" in answer.out
    assert "wrote more.toml" in answer.out
    answer = done("detect", "later.parquet", "--actuator", "more.toml", "--json")
    assert [v["fault"] for v in answer.told["verdicts"]][:2] == ["lubrication"] * 2


# detect


def test_detect_tells_programs_value_interval_alarm_and_name(done, files):
    answer = done("detect", "bench.csv", "--actuator", "rig.toml", "--json", "--report", "out.html")
    page = (files / "out.html").read_text(encoding="utf-8")
    for said in ("in 4; backlash in 2", "condition dry, weight light, run 60", "learnt from"):
        assert said in page
    told = answer.told
    assert told["actuator"] == "rig"
    assert told["each"] == "run"
    for verdict in told["verdicts"]:
        assert verdict["distance"] > 0.0
        assert set(verdict["probability"]) > {"lubrication", "backlash", "spalling"}
        assert verdict["alarm"] == (verdict["fault"] is not None)
        assert verdict["faults"] == ([verdict["fault"]] if verdict["grade"] == "fault" else [])
        assert isinstance(verdict["load_N"], float)
        assert isinstance(verdict["sensor_coupling"], float)
        for magnitude in verdict["magnitudes"].values():
            assert magnitude["low"] <= magnitude["value"] <= magnitude["high"]
            assert np.isfinite(magnitude["score"])
    of = {
        condition: [v for v in told["verdicts"] if v["labels"]["condition"] == condition]
        for condition in ("normal", "dry", "loose")
    }
    assert sum(v["alarm"] for v in of["normal"]) <= 4  # of 14, eight of them learnt
    for condition, fault, name, value, unit in (
        ("dry", "lubrication", "friction", pytest.approx(1.3, rel=0.08), "x"),
        ("loose", "backlash", "backlash", pytest.approx(0.8, abs=0.1), "mm"),
    ):
        assert {v["fault"] for v in of[condition]} == {fault}
        for verdict in of[condition]:
            magnitude = verdict["magnitudes"][name]
            assert (magnitude["value"], magnitude["unit"]) == (value, unit)


def test_detect_tells_people_in_a_table_with_a_count_of_alarms(done, files):
    for each, rows in (("run", 4), ("motion", 4)):
        answer = done("detect", "later.parquet", "--actuator", "rig.toml", "--each", each)
        lines = [line for line in answer.out.splitlines() if "run 63" in line or "run 8" in line]
        assert len(lines) == rows
        assert sum("lubrication" in line for line in lines) == 2
        assert all(re.search(r"\d\.\d+ x \(\d\.\d+ to \d\.\d+\)", line) for line in lines)
        assert re.search(r"\d of 4 runs raise an alarm", answer.out)
        assert re.search(r"\d of 4 motions raise an alarm", answer.out)


def test_where_column_and_map_choose_what_is_judged(done, files):
    names, rows = (files / "bench.csv").read_text(encoding="utf-8").split("\n", 1)
    theirs = names.replace("current", "theirs")
    assert theirs != names
    (files / "theirs.csv").write_text(f"{theirs}\n{rows}", encoding="utf-8")
    (files / "map.toml").write_text('[columns]\ncurrent = "theirs [A]"\n', encoding="utf-8")
    for chosen in (("--column", "current=theirs [A]"), ("--map", "map.toml")):
        answer = done(
            "detect", "theirs.csv", "--actuator", "rig.toml", "--where", "condition=dry,loose",
            "--where", "run=60,62", *chosen, "--json",
        )  # fmt: skip
        runs = [verdict["labels"]["run"] for verdict in answer.told["verdicts"]]
        assert runs == ["60", "60", "62", "62"]


def test_detect_writes_all_verdicts_as_a_table(ematwin, files):
    import pyarrow.parquet as pq

    answers = {}
    for name in ("verdicts.csv", "verdicts.parquet"):
        answers[name] = ematwin(
            "detect", "later.parquet", "--actuator", "rig.toml", "--table", name
        )
        assert answers[name].code == 0, answers[name].err
        assert f"wrote {name}" in answers[name].out
    with (files / "verdicts.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["fault"] for row in rows][:2] == ["lubrication", "lubrication"]
    assert (
        float(rows[0]["friction_low"])
        < float(rows[0]["friction"])
        < float(rows[0]["friction_high"])
    )
    assert {"backlash_mm", "load_N", "sensor_coupling"} <= set(rows[0])
    assert [row["grade"] for row in rows][:2] == ["fault", "fault"]
    assert all(row["reason"] for row in rows)
    stored = pq.read_table(files / "verdicts.parquet").to_pylist()
    assert [str(row["distance"]) for row in stored] == [row["distance"] for row in rows]


# identify


def test_identify_judges_one_motion_or_each_of_a_table_by_the_healthy_population(done, files):
    rig = ("--actuator", "rig.toml")
    told = done("identify", "one.parquet", *rig, "--report", "out.html", "--json").told
    assert told["report"] == "out.html"
    assert told["verdict"]["faults"] == ["lubrication"]
    assert told["faults"]["friction"] == pytest.approx(1.35, rel=0.06)
    told = done("identify", "later.parquet", *rig, "--report", "all.html", "--json").told
    assert told.keys() == {  # as `detect`
        "actuator", "kind", "each", "verdicts", "not_judged", "report", "assumed", "warnings",
    }  # fmt: skip
    assert (told["each"], told["report"], len(told["verdicts"])) == ("motion", "all.html", 4)
    for name in ("out.html", "all.html"):
        assert (files / name).stat().st_size > 10_000
    assert "4 motions" in done("identify", "later.parquet", *rig).out


# Another kind


def test_a_brushless_actuator_is_calibrated_and_judged_from_the_shell(ematwin, done, files):
    """One file a run; what does not apply to the kind is null."""
    from made_up_axis import run as axis_run

    healthy = [f"day{n}.parquet" for n in range(1, 4)]
    for n, name in enumerate(healthy, 1):
        ematwin_of(axis_run(n), files / name)
    ematwin_of(axis_run(60, friction=0.25), files / "dry.parquet")
    answer = done("calibrate", *healthy, "--actuator", "servo48", "--out", "axis.toml")
    assert "controller.position_gain" in answer.out
    assert re.search(r"found off healthy by .*: friction [\d.]+, backlash", answer.out)
    answer = done(
        "detect", "dry.parquet", "day1.parquet", "--actuator", "axis.toml", "--json",
        "--table", "a.csv", "--report", "a.html",
    )  # fmt: skip
    told = answer.told
    assert told["kind"] == "bldc"
    worn, sound = told["verdicts"]
    assert worn["load_N"] is worn["sensor_coupling"] is worn["distance"] is None
    assert (worn["grade"], worn["faults"], worn["alarm"]) == ("fault", ["friction"], True)
    assert (sound["grade"], sound["faults"], sound["alarm"]) == ("healthy", [], False)
    friction = worn["magnitudes"]["friction"]
    assert (friction["value"], friction["unit"]) == (pytest.approx(0.0543, rel=0.1), "N m")
    assert friction["score"] > 3.0
    (files / "runs").mkdir()
    shutil.copy(files / "dry.parquet", files / "runs")
    judge = ("runs", "--actuator", "axis.toml", "--fail-on")
    answer = ematwin("detect", *judge, "fault")
    assert answer.code == 1, answer.err
    heading = answer.out.splitlines()[1]
    assert "friction" in heading
    assert re.search(r"│ friction +│ +0\.0\d+ N m \(0\.0\d+ to 0", answer.out)
    assert len(heading) <= 80
    assert "load" not in heading
    assert "1 of 1 recordings raise an alarm: friction in 1." in answer.out
    with (files / "a.csv").open(encoding="utf-8") as file:
        row, _ = csv.DictReader(file)
    assert float(row["friction_Nm"]) == pytest.approx(friction["value"])
    assert (files / "a.html").stat().st_size > 10_000
    again = ("calibrate", "day1.parquet", "--actuator", "servo48", "--out", "axis.toml")
    assert ematwin(*again).code == 0  # nobody touched it
    assert ematwin("identify", *judge, "changed,none", "--only", "friction").code == 0
    assert "--fail-on takes" in ematwin("detect", *judge, "broken").err
    twin, digit = files / "axis.toml", re.compile(r"(?<=[0-9])[0-9](?=\.\d|\d{6})")
    written = twin.read_text(encoding="utf-8")
    places = [one.start() for one in digit.finditer(written)]
    for place in places[:: len(places) // 5]:
        other = "1" if written[place] != "1" else "2"
        twin.write_text(written[:place] + other + written[place + 1 :], encoding="utf-8")
        refused = ematwin("identify", "dry.parquet", "--actuator", "axis.toml")
        assert refused.code == 2, place
        assert refused.err.count("\n") == 1
    assert "exists, and may hold" in ematwin(*again).err
    twin.write_text(re.sub("checksum = .*\n", "", written), encoding="utf-8")  # on purpose
    assert ematwin("detect", "dry.parquet", "--actuator", "axis.toml").code == 0


def ematwin_of(recording, path: Path) -> None:
    """Write a recording without its label: the file is the run."""
    ematwin_module.write(recording.changed(labels={}), path)


# What cannot be used

CASES = [
    # calibrate
    ("calibrate bench.csv --where state=normal --out x.toml",
     "no label 'state'; it has condition, weight, run"),
    ("calibrate bench.csv --where condition=wet --out x.toml",
     "None of the 34 motions has condition = wet"),
    ("calibrate bench.csv --where run=1,2 --known dry:condition=dry --out x.toml",
     "at least three healthy runs"),
    ("calibrate bench.csv --where condition --out x.toml", "--where needs"),
    ("calibrate bench.csv --known dry --out x.toml", "--known needs fault:label"),
    ("calibrate bench.csv --known dry:condition=wet --out x.toml", "condition = wet"),
    ("calibrate bench.csv --out x.json", "end its name in .toml"),
    ("calibrate bench.csv --out folder.toml", "it is a folder"),
    ("calibrate bench.csv --actuator servo48 --out x.toml",
     "It has the channels of the kind ball-screw"),
    ("calibrate bench.csv --actuator servo48.toml --out x.toml",
     "It has the channels of the kind ball-screw"),
    ("calibrate bench.csv", "--out"),
    ("calibrate rotary.csv --actuator rm1605 --out x.toml", "It has the channels of the kind bldc"),
    ("calibrate bench.csv --where condition=normal --add rig.toml --out x.toml",
     "is among the healthy runs already"),
    ("calibrate bench.csv --where condition=dry --add rig.toml --out x.toml",
     "is no healthy run by the calibration that it is to join"),
    ("calibrate bench.csv --add rm1605.toml --out x.toml", "no calibration; make one with"),
    # detect
    ("detect later.parquet --actuator rm1605.toml", "no calibration; make one with"),
    ("detect later.parquet --actuator rm1605", "no calibration; make one with"),
    ("detect later.parquet --actuator rig.toml --gaps some", "--gaps must be refuse, longest"),
    ("detect later.parquet --actuator later.parquet", "later.parquet"),
    ("detect later.parquet --actuator cut.toml", "cut.toml"),
    ("detect later.parquet --actuator rig.toml --each day",
     "--each must be motion or run, received 'day'"),
    ("detect later.parquet --actuator rig.toml --column torque=x", "no column 'torque'"),
    ("detect later.parquet --actuator rig.toml --column current=x", "no channel 'x'"),
    ("detect short.csv --actuator rig.toml --table x.csv", "samples where"),
    ("detect turned.csv --actuator rig.toml --report x.html", "wrong sign"),
    ("detect rotary.csv --actuator rig.toml", "It has the channels of the kind bldc"),
    # identify
    ("identify one.parquet --actuator rig.toml --table x.csv", "--table is of several recordings"),
    ("identify one.parquet --actuator cut.toml", "cut.toml"),
    ("identify rotary.csv --actuator rig.toml", "It has the channels of the kind bldc"),
]  # fmt: skip


@pytest.fixture(scope="module")
def bad(bench: Path, tmp_path_factory) -> Path:
    """Good and bad files together."""
    folder = tmp_path_factory.mktemp("bad")
    for path in bench.iterdir():
        shutil.copy(path, folder)
    for name in ("servo48", "rm1605"):
        shutil.copy(shipped_actuators()[name], folder / f"{name}.toml")
    (folder / "folder.toml").mkdir()
    (folder / "rotary.csv").write_text("time,command,i_a,i_b\n0,0,0,0\n0.1,0,1,-1\n")
    whole = (folder / "rig.toml").read_bytes()
    (folder / "cut.toml").write_bytes(whole[: len(whole) // 2])
    header, *rows = (folder / "bench.csv").read_text(encoding="utf-8").splitlines()
    (folder / "short.csv").write_text("\n".join([header, *rows[:200], ""]))
    place = header.replace('"', "").split(",").index("position_error [m]")
    turned = [row.split(",") for row in rows[:250]]
    for row in turned:
        row[place] = str(-float(row[place]))
    (folder / "turned.csv").write_text("\n".join([header, *map(",".join, turned), ""]))
    return folder


@pytest.mark.parametrize(("command", "said"), CASES)
def test_what_cannot_be_used_is_refused_in_one_sentence(bad, command, said):
    """And nothing is written, not even half."""
    untouched(bad, *command.split(), said=said)


# The page that goes through it


def test_the_page_on_your_own_actuator_says_what_its_commands_give(done, tmp_path, monkeypatch):
    project = Path(__file__).parents[2]
    page = (project / "docs" / "your-actuator.md").read_text(encoding="utf-8")
    sheet = project / "examples" / "axis7.toml"
    monkeypatch.chdir(tmp_path)
    made = script(project / "examples" / "made_up_actuator.py")
    assert made.out in page
    calibrated = done(
        "calibrate", "healthy.csv", "--actuator", sheet, "--out", "axis7-calibrated.toml"
    )
    assert "do not determine screw.efficiency_opposing, screw.efficiency_aiding" in calibrated.out
    answer = done("detect", "later.csv", "--actuator", "axis7-calibrated.toml", "--json")
    found = {v["labels"]["run"]: v for v in answer.told["verdicts"]}
    rows = re.findall(r"^\| (1[1-8]) \| [^|]+ \| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)
    assert len(rows) == 6
    for run_, shown, verdict in rows:
        if run_ != "17":  # it is too near the limit for a promise on every processor
            assert (found[run_]["fault"] or "healthy") == verdict.strip()
        value = float(re.search(r"\d+\.\d+", shown)[0])
        name = {"15": "backlash", "16": "backlash", "17": "roughness", "18": "roughness"}
        told = found[run_]["magnitudes"][name.get(run_, "friction")]["value"]
        assert told == pytest.approx(value, abs=0.015)
