"""Calibration: parameters and population from healthy motions."""

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError, RecordError
from ematwin.estimation.baseline import Baseline, baseline_of
from ematwin.estimation.learn import learn
from ematwin.models.ball_screw.model import MODEL
from ematwin.models.registry import load_actuator
from ematwin.monitoring.calibrate import calibrate
from ematwin.monitoring.calibration import Basis, Calibration, CalibrationReport
from ematwin.monitoring.identify import detect
from ematwin.monitoring.measure import measured
from ematwin.monitoring.runs import Group, Runs
from made_up_rig import TRUTH, healthy_runs, motion, rig, run, template
from refusals import refusal_of


def refusal(motions, kind=RecordError, **options) -> str:
    return refusal_of(lambda: calibrate(motions, **options), kind)


# Nominal parameters


def mean_of(**changed):
    return MODEL.compare(motion(**changed), template())


@pytest.fixture(scope="module")
def fitted():
    """From four loads, with little noise, as the mean of many motions has."""
    means = [
        mean_of(seed=n, load=load, noise=(2e-3, 2e-5))
        for n, load in enumerate((-400.0, 0.0, 400.0, 800.0))
    ]
    return learn(MODEL, template(), means)


@pytest.mark.parametrize("place", TRUTH)
def test_a_template_that_is_off_is_fitted_to_the_rig(fitted, place):
    """Within three standard errors, and to 2 %."""
    (found,) = [p for p in fitted.parameters if p.place == place]
    true = {name: value for name, value, *_ in rig().parameters()}[place]
    assert found.template == pytest.approx(true / TRUTH[place])
    assert found.value == pytest.approx(true, rel=0.02)
    assert abs(found.value - true) < 3.0 * found.standard_error
    assert found.determined
    assert fitted.actuator.value(place) == pytest.approx(found.value, rel=1e-12)


def test_what_motions_do_not_tell_is_said_and_held_by_the_template():
    """Without load nothing can be said of the efficiencies."""
    found = learn(MODEL, template(), [mean_of(load=0.0)])
    actuator, parameters = found.actuator, found.parameters
    determined = {p.place: p.determined for p in parameters}
    for place in ("screw.efficiency_opposing", "screw.efficiency_aiding"):
        assert not determined[place]
        (found,) = [p for p in parameters if p.place == place]
        assert abs(found.value - found.template) < found.standard_error
    assert determined["screw.friction_force"]
    assert actuator.screw.efficiency_opposing <= 1.0
    assert actuator.screw.efficiency_aiding <= 1.0


def test_a_parameter_that_the_template_holds_at_zero_stays_there():
    """Its logarithm could not be fitted."""
    proportional = template().changed({"controller.integral_gain": 0.0})
    comparisons = [MODEL.compare(motion(seed=n, load=300.0 * n), proportional) for n in range(2)]
    found = learn(MODEL, proportional, comparisons)
    assert "controller.integral_gain" not in {p.place for p in found.parameters}
    assert found.actuator.controller.integral_gain == 0.0


# Calibration


@pytest.fixture(scope="module")
def three():
    """From three runs, one motion a load."""
    return calibrate(healthy_runs(3, motions=1))


def test_the_calibrated_actuator_is_the_rig(report):
    """To 3 %, which is how far its healthy days differ."""
    found = {place: value for place, value, *_ in report.calibration.actuator.parameters()}
    true = {place: value for place, value, *_ in rig().parameters()}
    for place in TRUTH:
        assert found[place] == pytest.approx(true[place], rel=0.03), place
    assert report.calibration.actuator.name == "rig"


def test_the_spread_is_that_of_the_healthy_days(report):
    """Friction differs by 2 % from day to day, gain by 1 %, backlash by a fifth."""
    spread = report.run_spread
    assert list(spread) == ["friction", "backlash", "gain", "roughness"]
    assert 0.01 < spread["friction"][1] < 0.04
    assert 0.004 < spread["gain"][1] < 0.02
    for name in ("friction", "gain"):
        assert spread[name][0] < spread[name][1]
    assert max(spread["backlash"]) < 4e-5


def test_a_calibration_that_was_saved_is_the_same(report, tmp_path):
    path = tmp_path / "rig.toml"
    report.save(path)
    again = Calibration.load(path)
    assert again.actuator.fingerprint == report.calibration.actuator.fingerprint
    np.testing.assert_allclose(
        again.discrepancy.coefficients, report.calibration.discrepancy.coefficients, rtol=1e-8
    )
    worn = [motion(seed=5, load=0.0)]
    from_file, given = (detect(worn, each).runs[0].standing.distance for each in (path, report))
    assert from_file == pytest.approx(given, rel=1e-6)
    sources = {place: source for place, *_, source in again.actuator.parameters()}
    assert sources["screw.friction_force"] == report.sources["screw.friction_force"]


def test_files_do_for_recordings(three, tmp_path):
    """In one table, or a file for each run."""
    motions, first = healthy_runs(3, motions=1), three
    ematwin.write(motions, tmp_path / "all.csv")
    paths = []
    for number in ("1", "2", "3"):
        own = [one for one in motions if one.run == number]
        labels = [{k: v for k, v in one.labels.items() if k != "run"} for one in own]
        own = [one.changed(labels=said) for one, said in zip(own, labels, strict=True)]
        paths.append(tmp_path / f"day{number}.parquet")
        ematwin.write(own, paths[-1])
    table, files = calibrate(tmp_path / "all.csv"), calibrate(paths)
    assert first.learnt == table.learnt == ["1", "2", "3"]
    assert files.learnt == ["day1.parquet", "day2.parquet", "day3.parquet"]
    for other in (table, files):
        for one, again in zip(first.parameters, other.parameters, strict=True):
            assert again.value == pytest.approx(one.value, rel=1e-5), one.place
    found = detect(tmp_path / "all.csv", table.calibration)
    assert [verdict.name for verdict in found.runs] == [
        verdict.name.removeprefix("all.csv ") for verdict in detect(motions, first.calibration).runs
    ]
    with pytest.raises(InputError, match="No recording was given"):
        calibrate([])
    with pytest.raises(InputError, match="received float"):
        calibrate([1.5])


def test_all_runs_teach_and_each_is_judged_by_the_others():
    report = calibrate(healthy_runs(4))
    assert report.learnt == ["1", "2", "3", "4"]
    calibration = report.calibration
    tested = calibration.tested
    assert tested.shape == (16, len(calibration.layout))
    # judged by the others, a run lies further out than judged with itself among them
    own = calibration.population.scores(calibration.healthy.features, calibration.healthy.covariate)
    assert (tested**2).mean() > 1.2 * (own**2).mean()


def test_left_out_bands_are_those_of_a_run_that_comes_later(three):
    """A share of a run's own noise in the discrepancy would make its bands look quieter."""
    motions, calibration = healthy_runs(3, motions=1), three.calibration
    bands = calibration.kinds == "band"

    def level(recordings) -> float:
        return measured(calibration.beside(recordings)).features[:, bands].mean()

    later, with_own = level(healthy_runs(20, first=201, motions=1)), level(motions)
    without = calibration.healthy.features[:, bands].mean()
    assert with_own < later - 0.1
    assert abs(without - later) < 0.6 * abs(with_own - later)


# Adding later runs


def test_later_runs_join_the_healthy_ones(tmp_path):
    first = calibrate(healthy_runs(4), known={"dry": run(60, friction=1.3)}, name="rig")
    first.save(tmp_path / "rig.toml")
    later = healthy_runs(2, first=11)
    second = calibrate(later, add_to=tmp_path / "rig.toml")
    assert list(second.to_frame()) == ["value", "standard_error", "template", "determined"]
    assert second.learnt == ["1", "2", "3", "4", "11", "12"]
    assert second.parameters == []
    before, after = first.calibration, second.calibration
    assert after.actuator.name == "rig"
    assert after.actuator.fingerprint == before.actuator.fingerprint
    assert len(after.healthy.runs) == 24
    np.testing.assert_allclose(
        after.discrepancy.coefficients, before.discrepancy.coefficients, rtol=1e-6
    )
    # it is saved and added to like any other
    second.save(tmp_path / "more.toml")
    third = calibrate(healthy_runs(1, first=21), add_to=Calibration.load(tmp_path / "more.toml"))
    assert third.learnt[-1] == "21"
    # every run is judged by all others, however they came
    assert len(after.tested) == 24
    assert len(third.calibration.tested) == 28
    # known faults are named as before, in the scores of the new population
    dry = run(61, friction=1.3)
    for calibration in (before, after):
        assert {v.fault for v in detect(dry, calibration).runs} == {"dry"}


def test_runs_of_a_drifted_occasion_are_healthy_once_they_were_added():
    first = calibrate(healthy_runs(5)).calibration

    def drifting(number):
        return [m.changed(current=0.97 * m.current - 0.01) for m in run(number)]

    later = [m for number in (31, 32, 33) for m in drifting(number)]
    second = calibrate(later, add_to=first).calibration
    others = [m for number in range(34, 42) for m in drifting(number)]
    before, after = (detect(others, one).runs for one in (first, second))
    distances = [np.mean([v.standing.distance for v in found]) for found in (after, before)]
    assert distances[0] < 0.9 * distances[1]
    assert np.mean([v.grade == "healthy" for v in after]) >= 0.8


def test_runs_of_the_same_name_from_another_file_are_told_apart(three):
    again = [m.changed(source="spring.csv") for m in run(41, motions=1)]
    again = [m.changed(labels={**m.labels, "run": "1"}) for m in again]
    report = calibrate(again, add_to=three.calibration)
    assert report.learnt == ["1", "2", "3", "1 of spring.csv"]


# What cannot be learnt from


def test_fewer_than_three_runs_make_a_twin_but_no_population(tmp_path):
    text = refusal(healthy_runs(2, motions=1), known={"dry": run(60, motions=1)})
    assert "at least three healthy runs" in text
    assert "received 2 (1, 2)" in text
    some = healthy_runs(2, motions=1)
    report = calibrate([*some, some[0].changed(labels={"run": "copy"})])
    assert "counts once" in report.notes[0]
    assert type(report.calibration) is Calibration
    assert "at least three healthy runs" in report.notes[-1]
    report.save(tmp_path / "twin.toml")
    assert load_actuator(tmp_path / "twin.toml").fingerprint == report.actuator.fingerprint
    assert baseline_of(str(tmp_path / "twin.toml"), report.actuator).calibrated
    some = healthy_runs(1, motions=1)
    for given in (some, Runs((Group("one", report.calibration, some),))):
        with pytest.raises(InputError, match="no healthy population to judge by"):
            detect(given, report)


@pytest.mark.parametrize(
    ("fault", "like"),
    [
        ({"friction": 1.3}, "lubrication"), ({"backlash": 8e-4}, "backlash"),
        ({"roughness": 0.4}, "spalling"), ({"gain": 0.8}, "unnamed change"),
    ],
)  # fmt: skip
def test_a_faulty_run_among_the_healthy_is_named(fault, like):
    text = refusal([*healthy_runs(3), *run(66, **fault), *healthy_runs(1, 5)])
    assert text.startswith(f"Run 66 is unlike the other 4 healthy runs: most like {like}.")
    assert "leave it out" in text


def test_values_of_a_form_that_was_found_come_from_the_runs(tmp_path):
    sheet = load_actuator("servo48")
    cogging = {"cogging.torque": 1e-3, "cogging.cycles": 12, "cogging.phase": 0.2}
    known = Calibration(sheet.changed(cogging), Baseline.of_simulation())
    basis = Basis(sheet, [], [], None)
    CalibrationReport(known, [], [], ["a", "b"], basis=basis).save(tmp_path / "own.toml")
    loaded = load_actuator(tmp_path / "own.toml")
    source = {place: row[-1] for place, *row in loaded.parameters()}
    assert all(source[place].startswith("found in healthy runs a, b with") for place in cogging)
    assert source["motor.inertia"] == sheet.parameter("motor.inertia")[-1]
