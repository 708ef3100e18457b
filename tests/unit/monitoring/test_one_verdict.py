"""One verdict for `identify` and `detect`, of kinds whose parameters are free beside the faults."""

import signal
import threading
from dataclasses import replace
from pathlib import Path

import pytest

import ematwin
from ematwin.errors import InputError, ParameterError, RecordError
from ematwin.estimation.baseline import Baseline
from ematwin.models.registry import model_of
from ematwin.monitoring import identify as identifying
from ematwin.monitoring.calibration import CalibrationReport
from ematwin.monitoring.detection import Detection, Diagnosis
from made_up_axis import drifted, run
from made_up_rig import healthy_runs
from made_up_rig import motion as ball_screw_motion
from made_up_rig import run as rig_run

FAULTS = {
    "friction": {"friction": 0.25},
    "gain": {"gain": 0.4},
    "short_a": {"short_a": 0.3},
    "two faults": {"friction": 0.25, "short_a": 0.3},
}


@pytest.fixture(scope="module")
def axis() -> CalibrationReport:
    return ematwin.calibrate([run(n) for n in range(1, 6)], "servo48", name="axis")


@pytest.fixture(scope="module")
def recordings() -> list[ematwin.Recording]:
    """A healthy one, one with magnets 1 % weaker and a winding 8 % warmer, and faulty ones."""
    return [run(30), drifted(31), *(run(60 + n, **f) for n, f in enumerate(FAULTS.values()))]


@pytest.fixture(scope="module")
def found(axis, recordings) -> Detection:
    return ematwin.detect(recordings, axis)


# One verdict


def test_identify_and_detect_say_the_same_of_each_recording(axis, recordings, found):
    (other,) = ematwin.identify([recordings[3]], axis).motions
    row, alone = found.motions[3], ematwin.identify(recordings[3], axis)
    assert row.verdict == other.verdict == alone.verdict
    assert row.magnitudes == other.magnitudes
    assert found.runs == found.motions


def test_drift_is_no_fault_and_every_fault_is_named(found):
    healthy, drifting, *faulty = found.motions
    assert healthy.grade == "healthy"
    assert drifting.grade in ("healthy", "changed")
    assert [one.faults for one in faulty] == [tuple(fault) for fault in FAULTS.values()]
    assert [one.alarm for one in found.motions] == [False, False, True, True, True, True]
    assert found.grade == "fault"
    assert found.sentence == (
        "4 of 6 recordings raise an alarm: friction in 2; gain in 1; short_a in 2."
    )


def test_the_healthy_band_is_as_wide_as_what_a_healthy_recording_leaves_open(found):
    for row in found.motions:
        errors = row.identification.standard_error
        (friction,) = [one for one in row.magnitudes if one.name == "friction"]
        least = 1.96 * 2.0 * errors["friction"]  # friction torque x (1 + 2 k), from zero up
        assert friction.healthy[1] / friction.healthy[0] >= 1.0 + 0.99 * least


def test_drift_of_a_servo_of_another_kind_is_no_fault_either():
    actuator = ematwin.load_actuator("servo400")
    weak = {"motor.flux": 0.99, "motor.resistance": 1.08}
    drifting = actuator.changed({place: f * actuator.value(place) for place, f in weak.items()})
    baseline = replace(Baseline.of_template(model_of(actuator), actuator), recordings=3)
    known = ematwin.Calibration(actuator, baseline)
    half = model_of(actuator).load_scenario(None).lasting(0.56)
    (row,) = ematwin.detect([ematwin.simulate(None, half, None, drifting, seed=1)], known).motions
    assert not row.alarm


def test_a_healthy_population_judges_for_both_commands(calibration):
    motions = [*rig_run(60, friction=1.3), *rig_run(61, roughness=0.1), *healthy_runs(1, first=101)]
    found = ematwin.detect(motions, calibration)
    together = ematwin.identify(motions, calibration)
    assert {"lubrication", "spalling"} <= {name for one in found.motions for name in one.faults}
    assert [one.verdict for one in together.runs] == [one.verdict for one in found.runs]
    for motion, row, other in zip(motions, found.motions, together.motions, strict=True):
        assert row.verdict == other.verdict == ematwin.identify(motion, calibration).verdict
        assert row.identification is None
        assert other.identification is not None
    # on request the parameters are exact, and no healthy recordings count
    assert ematwin.identify(motions[0], calibration, exact=True).verdict.faults == ("friction",)


def test_an_interrupt_of_the_healthy_population_keeps_what_was_found(calibration, monkeypatch):
    def pressed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(identifying, "by_population", pressed)
    found = ematwin.identify(rig_run(60, friction=1.3)[0], calibration)
    assert found.stopped == "interrupted"
    assert found.verdict.grade == "none"
    assert "interrupted" in found.verdict.sentence
    assert found.values["friction"] == pytest.approx(1.3, abs=0.1)


# Several recordings


def test_a_folder_a_glob_and_a_list_are_several_recordings(axis, tmp_path):
    for name, fault in (("day10", {"friction": 0.25}), ("day2", {})):
        ematwin.write(run(60, **fault).changed(labels={}), tmp_path / f"{name}.parquet")
    (tmp_path / "notes.md").write_text("no recording")
    tables = [
        ematwin.identify(given, axis, only="friction")
        for given in (tmp_path, str(tmp_path / "*2.parquet"), [tmp_path / "day2.parquet"])
    ]
    names = [[row.name for row in table.motions] for table in tables]
    assert names == [["day2.parquet", "day10.parquet"], ["day2.parquet"], ["day2.parquet"]]
    assert [row.grade for row in tables[0].motions] == ["healthy", "fault"]
    assert tables[0].motions[1].identification.verdict.faults == ("friction",)
    alone = ematwin.identify(tmp_path / "day2.parquet", axis, only="friction")
    assert isinstance(alone, ematwin.Identification)


def test_what_cannot_be_judged_is_refused_before_any_work(axis, tmp_path):
    (tmp_path / "empty").mkdir()
    for given in (tmp_path / "empty", str(tmp_path / "*.csv")):
        with pytest.raises(InputError, match="holds no recording: no file ends in"):
            ematwin.identify(given, axis)
    with pytest.raises(InputError, match="leave it out for several"):
        ematwin.identify([run(30)], axis, checkpoint=tmp_path / "x")
    with pytest.raises(RecordError, match="has no command"):
        ematwin.identify([run(30), ball_screw_motion()], axis)
    with pytest.raises(RecordError, match="has no command"):
        ematwin.detect(ball_screw_motion(), axis)
    with pytest.raises(RecordError, match="has no command"):
        ematwin.calibrate(healthy_runs(3, motions=1), "servo48")
    with pytest.raises(ParameterError, match="holds an actuator but no calibration"):
        ematwin.detect(run(30), ematwin.BldcActuator.shipped()["servo48"])


def test_an_interruption_leaves_the_rows_that_are_done(axis):
    def stop(share: float) -> None:
        signal.raise_signal(signal.SIGINT)

    table = ematwin.detect([run(30) for _ in range(8)], axis, progress=stop, threads=1)
    assert 1 <= len(table.motions) < 8
    assert len(table.motions) + table.missing == 8
    assert f"Interrupted: {table.missing} more were not judged." in table.sentence
    assert threading.active_count() < 70


# Calibrating


def test_what_the_recordings_do_not_determine_stays_within_the_tolerance_of_the_template(axis):
    undetermined = [p for p in axis.parameters if not p.determined]
    assert undetermined
    for parameter in undetermined:
        away = abs(parameter.value / parameter.template - 1.0)
        assert away < 1.5 * axis.actuator.tolerance(parameter.place), parameter.place
        assert "not determined" in axis.sources[parameter.place]


def test_a_recording_unlike_the_other_healthy_ones_is_refused_and_may_lack_its_load():
    healthy = [run(1), run(2), run(3, short_a=0.4)]
    said = r"is unlike the other healthy recordings.*out\. None of them holds load: if there was"
    with pytest.raises(RecordError, match=said):
        ematwin.calibrate([one.changed(load=None) for one in healthy], "servo48")


def test_what_is_of_a_population_is_refused(axis):
    with pytest.raises(InputError, match=r"judged by the values.*; leave known out"):
        ematwin.calibrate([run(1)], "servo48", known={"dry": ["run60.csv"]})
    with pytest.raises(InputError, match="calibrate anew with all healthy recordings"):
        ematwin.calibrate([run(9)], add_to=axis.calibration)


def test_a_calibration_of_0_2_loads_without_its_population(tmp_path):
    path = Path(__file__).parents[2] / "data" / "0.2" / "axis.toml"
    known = ematwin.Calibration.load(path)
    assert type(known) is ematwin.Calibration
    assert known.baseline.recordings == 5
    row: Diagnosis = ematwin.detect(run(61, short_a=0.3), path).motions[0]
    assert row.faults == ("short_a",)
    # and without a baseline, as the versions before wrote it
    text = path.read_text(encoding="utf-8")
    start, end = text.index("[baseline]"), text.index("[calibration]")
    (tmp_path / "older.toml").write_text(text[:start] + text[end:], encoding="utf-8")
    with pytest.raises(ParameterError, match=r"a version before 0\.2.*; calibrate anew"):
        ematwin.Calibration.load(tmp_path / "older.toml")
