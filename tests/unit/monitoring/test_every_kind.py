"""Calibrating and judging an actuator of another kind: the brushless one, one recording a run."""

from dataclasses import replace

import numpy as np
import pytest

import ematwin
from ematwin.errors import ParameterError, RecordError
from ematwin.monitoring import CalibrationReport, Detection
from ematwin.report.detection import detection_page
from made_up_axis import TRUTH, axis, run
from made_up_rig import healthy_runs
from made_up_rig import motion as ball_screw_motion

FAULTS = {
    "friction": {"friction": 0.25},
    "gain": {"gain": 0.4},
    "short_a": {"short_a": 0.3},
}


@pytest.fixture(scope="module")
def report() -> CalibrationReport:
    return ematwin.calibrate([run(n) for n in range(1, 6)], "servo48", name="axis")


@pytest.fixture(scope="module")
def found(report) -> Detection:
    """A healthy recording, and one with each fault."""
    faulty = [run(60 + n, **fault) for n, fault in enumerate(FAULTS.values())]
    return ematwin.detect([run(30), *faulty], report.calibration)


def test_what_the_current_tells_of_the_axis_is_found(report):
    """Friction of motor and gear, which both are higher than in the template."""
    found, true = report.calibration.actuator, axis()
    # days rub by 0 to 8 % more than the axis itself; a current tells torques over its constant,
    # and this motion, without a load, hardly on which side of the gear they rub
    scale = found.motor.emf_constant / true.motor.emf_constant
    rubbing, truly = (sum(one.value(place) for place in TRUTH) for one in (found, true))
    assert rubbing / scale == pytest.approx(1.03 * truly, rel=0.05)
    assert scale == pytest.approx(1.0, abs=0.1)
    for place in ("motor.inertia", "transmission.output_inertia", "controller.position_gain"):
        torque = 1.0 if place == "controller.position_gain" else scale
        assert found.value(place) / torque == pytest.approx(true.value(place), rel=0.1), place


def test_a_fault_that_the_twin_explains_is_named_where_healthy_runs_hardly_differ(report):
    """Simulations of one actuator differ by noise alone; all else then is unlike them."""
    calm = report.calibration.population
    calm = replace(calm, within=1e-2 * calm.within, between=1e-2 * calm.between)
    faulty = [run(60 + n, **fault) for n, fault in enumerate(FAULTS.values())]
    verdicts = ematwin.detect(faulty, replace(report.calibration, population=calm)).runs
    assert [one.grade for one in verdicts] == ["fault"] * len(FAULTS)
    assert [one.fault for one in verdicts] == list(FAULTS)


def test_what_the_recordings_do_not_determine_stays_within_the_tolerance_of_the_template(report):
    undetermined = [p for p in report.parameters if not p.determined]
    assert undetermined
    for parameter in undetermined:
        away = abs(parameter.value / parameter.template - 1.0)
        assert away < 1.5 * report.actuator.tolerance(parameter.place), parameter.place
        assert "not determined" in report.sources[parameter.place]


def test_a_calibration_of_a_kind_without_a_covariate_has_none(report):
    calibration = report.calibration
    assert calibration.covariate_range is None
    assert calibration.population.scale is None
    assert calibration.channels == ("current",)
    assert calibration.discrepancy.shape == (1, calibration.command.size)
    assert report.learnt == ["1", "2", "3", "4", "5"]
    assert report.held_back == []


def test_what_lies_on_a_bound_scatters_by_no_less_than_its_standard_error(report):
    """Healthy shorts are found at zero, day after day."""
    for name in ("short_a", "short_b", "short_c", "eccentricity"):
        within, _ = report.run_spread[name]
        assert 1e-4 < within < 0.05, name


def test_a_healthy_recording_of_another_day_is_healthy(found):
    healthy = found.runs[0]
    assert not healthy.alarm
    assert healthy.fault == ""
    assert healthy.covariate is healthy.load is None


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_raises_an_alarm_and_is_named(found, name):
    verdict = found.runs[1 + list(FAULTS).index(name)]
    assert verdict.alarm
    assert (verdict.fault, verdict.named_by) == (name, "physics")
    magnitude = next(m for m in verdict.magnitudes if m.name == name)
    assert magnitude.value == pytest.approx(FAULTS[name][name], abs=0.03)
    assert not magnitude.healthy[0] <= magnitude.value <= magnitude.healthy[1]
    assert verdict.notes == ()


def test_a_saved_calibration_judges_alike_from_files(report, found, tmp_path):
    report.save(tmp_path / "axis.toml")
    again = ematwin.Calibration.load(tmp_path / "axis.toml")
    assert again.actuator.fingerprint == report.calibration.actuator.fingerprint
    ematwin.write(run(60, **FAULTS["friction"]), tmp_path / "today.parquet")
    (verdict,) = ematwin.detect(tmp_path / "today.parquet", tmp_path / "axis.toml").runs
    assert verdict.fault == "friction"
    assert verdict.index == pytest.approx(found.runs[1].index, rel=5e-3)  # the fit is rough
    # it is an actuator, for identification too
    assert ematwin.load_actuator(tmp_path / "axis.toml") == again.actuator
    assert again.actuator.name == "axis"


def test_a_verdict_is_plain_json(found):
    told = found.runs[1].as_dict()
    assert set(told["magnitudes"]) == {
        "friction", "backlash", "short_a", "short_b", "short_c", "eccentricity", "gain",
    }  # fmt: skip
    assert not {"load_N", "sensor_coupling"} & set(told)
    numbers = [m["score"] for m in told["magnitudes"].values()]
    assert np.isfinite(numbers).all()


def test_the_page_shows_what_the_kind_reports(found):
    page = detection_page(found)
    for title in ("Short a", "Eccentricity", "Gain"):
        assert f"{title}" in page
    assert "Roughness" not in page


def test_recordings_of_another_kind_are_refused(report):
    with pytest.raises(RecordError, match="has no channel 'command'"):
        ematwin.detect(ball_screw_motion(), report.calibration)
    with pytest.raises(RecordError, match="has no channel 'command'"):
        ematwin.calibrate(healthy_runs(3, motions=1), "servo48")
    with pytest.raises(ParameterError, match="holds an actuator but no calibration"):
        ematwin.detect(run(30), ematwin.BldcActuator.shipped()["servo48"])


def test_a_run_that_is_better_than_the_average_healthy_run_is_not_cut_off_at_zero(report):
    """The nominal friction is that of the average run; half of the runs rub less."""
    calibration = report.calibration
    smooth = ematwin.detect([run(40, friction=0.0)], calibration).runs[0]
    friction = next(m for m in smooth.magnitudes if m.name == "friction")
    assert friction.low < friction.value < 0.0
    assert not smooth.alarm


def test_where_the_threshold_is_out_of_reach_magnitudes_are_judged_one_by_one(report):
    thresholds = replace(report.calibration.thresholds, motion=50.0, run=50.0)
    blind = replace(report.calibration, thresholds=thresholds)
    healthy, faulty = ematwin.detect([run(30), run(61, friction=0.6)], blind).runs
    assert not healthy.alarm
    assert faulty.index < faulty.threshold
    assert faulty.alarm
    assert faulty.alone == ("friction",)
    assert faulty.as_dict()["alone"] == ["friction"]
    for verdict in (healthy, faulty):
        assert any("more healthy runs" in note for note in verdict.notes)
