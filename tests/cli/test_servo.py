"""``examples/position_servo.py`` and the commands on a servo that is made up, logged like a bus."""

from pathlib import Path

import numpy as np
import pytest

import ematwin
import made_up_servo as made_up
from commands import script
from ematwin.errors import InputError, RecordError

EXAMPLE = Path(__file__).parents[2] / "examples" / "position_servo.py"
FAULTS = (
    {}, {}, {}, {"gain": 0.5}, {"gain": 0.75}, {"gain": 1.5}, {"payload": 1.6}, {"friction": 2.5},
)  # fmt: skip


@pytest.fixture(scope="module")
def tables(tmp_path_factory) -> tuple[Path, Path]:
    """Nine healthy runs, and eight that are judged."""
    folder = tmp_path_factory.mktemp("servo")
    healthy = made_up.write(folder / "healthy.parquet", [made_up.run(n) for n in range(9)])
    # of the motion with two sines, which shows most
    judged = [made_up.run(18 + n % 3 + 9 * n, **faults) for n, faults in enumerate(FAULTS)]
    short = {name: values[:10] for name, values in made_up.run(29).items()}
    made_up.write(folder / "with_short.parquet", [*judged, short])
    return healthy, made_up.write(folder / "judged.parquet", judged)


@pytest.fixture(scope="module")
def rows(tables) -> list[dict]:
    judged = tables[1].with_name("with_short.parquet")
    done = script(EXAMPLE, tables[0], "--judge", judged, "--json")
    assert done.code == 0, done.err
    return done.told["runs"]


@pytest.fixture(scope="module")
def answer(rows) -> list[dict]:
    return rows[: len(FAULTS)]


@pytest.fixture(scope="module")
def twin(tables):
    runs = ematwin.read(tables[0], actuator="sts3215", split=True)
    return ematwin.calibrate(runs, "sts3215")


def test_healthy_runs_raise_no_alarm_and_gains_are_named_with_their_value(answer):
    grades = [row["grade"] for row, faults in zip(answer, FAULTS, strict=True) if not faults]
    assert grades.count("healthy") >= 2  # of three, each of 3 s
    assert "fault" not in grades
    for row, faults in zip(answer, FAULTS, strict=True):
        if "gain" in faults:
            assert row["faults"] == ["gain"], row["sentence"]
            assert row["gain"] == pytest.approx(faults["gain"], rel=0.1)
            assert row["low"] <= 1.02 * faults["gain"]
            assert row["high"] >= 0.98 * faults["gain"]


def test_payload_and_friction_are_told_from_gain(answer):
    for row, faults in zip(answer, FAULTS, strict=True):
        for name in ("payload", "friction"):
            if name in faults:
                assert row["faults"] == [name], row["sentence"]


def test_twin_predicts_the_position_and_says_false_reads(answer):
    for row in answer:
        assert row["position_mae"] < 0.01
        assert any("false read" in note for note in row["notes"])


def test_calibration_finds_what_the_servo_is(twin):
    for place, value in made_up.TRUE.items():
        assert twin.actuator.value(place) == pytest.approx(value, rel=0.3), place
    assert twin.actuator.controller.gain == pytest.approx(2.75, rel=0.05)


def test_several_runs_of_one_state_are_judged_together(tables, twin):
    runs = ematwin.read(tables[1], actuator="sts3215", split=True)
    alone = ematwin.identify(runs[0], twin)
    found = ematwin.identify(runs[:3], twin, together=True)
    assert found.verdict.grade == "healthy"
    assert np.ptp(found.intervals["gain"]) < np.ptp(alone.intervals["gain"])
    one_fault = ematwin.identify(runs[:2], twin, only="gain", together=True)
    assert one_fault.searched == ("gain",)


def test_a_list_of_runs_gives_the_answers_of_each(tables, twin):
    runs = ematwin.read(tables[1], actuator="sts3215", split=True)[2:5]
    table = ematwin.detect(runs, twin)
    for run, row in zip(runs, table.motions, strict=True):
        assert row.identification.values == ematwin.identify(run, twin).values


def test_a_calibration_is_kept_in_its_file(tables, twin, tmp_path):
    twin.save(tmp_path / "own.toml")
    run = ematwin.read(tables[1], actuator="sts3215", split=True)[3]
    assert ematwin.identify(run, tmp_path / "own.toml").values["gain"] == pytest.approx(
        ematwin.identify(run, twin).values["gain"], rel=1e-6
    )


def test_a_wrong_fault_or_kind_is_refused(twin, tables):
    run = ematwin.read(tables[1], actuator="sts3215", split=True)[0]
    with pytest.raises(InputError, match="judged by its faults"):
        ematwin.identify(run, twin, only=["controller.gain"])
    with pytest.raises(InputError, match="leave together out"):
        ematwin.identify([run, run], "emps", together=True)


def test_the_example_refuses_what_it_cannot_use(tables, tmp_path):
    assert "docs/position-servo.md" in script(EXAMPLE).out
    other = [made_up.run(n) | {"position_gain": np.full(made_up.SAMPLES, 8)} for n in range(2)]
    lacking = [{n: x for n, x in run.items() if n != "position"} for run in other]
    made_up.write(tmp_path / "other.parquet", other)
    made_up.write(tmp_path / "empty.parquet", [{n: x[:0] for n, x in other[0].items()}])
    made_up.write(tmp_path / "lacking.parquet", lacking)
    said = {"none": "none.parquet", "other": "no healthy run", "empty": "", "lacking": "position"}
    for name, sentence in said.items():
        answer = script(EXAMPLE, tmp_path / f"{name}.parquet")
        assert answer.code == 1
        assert sentence in answer.err
        assert "Traceback" not in answer.err


def test_one_run_that_cannot_be_read_leaves_the_others(rows):
    assert len(rows) == len(FAULTS) + 1
    assert rows[-1]["run"] == 29
    assert rows[-1]["grade"] == "none"
    assert "10 samples" in rows[-1]["sentence"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"position": np.degrees, "goal_position": np.degrees}, "nobody stated its unit"),
        ({"position": lambda x: 2048 + x / made_up.COUNT}, "steps of the encoder"),
        ({"supply_voltage": lambda x: 10.0 * x}, "tenths of a volt"),
        ({"mass": lambda x: 1000.0 * x}, "Give kg and m"),
        ({"position": np.negative}, "wrong sign"),
    ],
)
def test_values_of_registers_get_no_verdict(changes, said):
    pandas = pytest.importorskip("pandas")
    table = made_up.run(18) | {"supply_voltage": np.full(made_up.SAMPLES, 12.0)}
    table |= {name: change(table[name]) for name, change in changes.items()}
    run = ematwin.read(pandas.DataFrame(table), actuator="sts3215")
    try:
        text = ematwin.identify(run, "sts3215", only="gain").verdict.sentence
    except RecordError as error:
        text = f"No verdict: {error}"
    assert text.startswith("No verdict")
    assert said in text


def test_nothing_is_learnt_from_overloaded_runs():
    time = np.arange(300) * 0.01
    rises = 1.2 * np.minimum(time / 0.5, 1.0)
    falls = np.where(time < 1.0, rises, np.maximum(1.2 - 3.0 * (time - 1.0), 0.0))
    run = ematwin.Recording(time, {"goal_position": np.full(300, 1.5), "position": falls})
    with pytest.raises(RecordError, match="trip"):
        ematwin.calibrate([run], "sts3215")
