"""Parameter files of ball screws, the kinds of actuators, and calibrations in files."""

import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import setitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import ematwin
from ematwin.errors import ParameterError
from ematwin.estimation.baseline import Baseline
from ematwin.models.ball_screw.model import MODEL
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.registry import load_actuator, model_in, shipped_actuators
from ematwin.monitoring.calibration import FORMAT, Calibration
from ematwin.monitoring.measure import Measurements, Motion
from ematwin.monitoring.population import Parabola
from ematwin.monitoring.population_calibration import PopulationCalibration, Signature
from made_up_rig import out_and_back
from refusals import refusal_of

refusal = partial(refusal_of, kind=ParameterError)

SHIPPED = BallScrew.shipped()["rm1605"].read_text(encoding="utf-8")


def written(tmp_path: Path, old: str = "", new: str = "") -> Path:
    """The shipped file, with one text replaced."""
    assert old in SHIPPED
    path = tmp_path / "mine.toml"
    path.write_text(SHIPPED.replace(old, new, 1) if old else SHIPPED, encoding="utf-8")
    return path


# Values


@pytest.mark.parametrize(
    ("change", "longest"),
    [
        ({"steps.twin": 0.021}, "0.02 s"),
        ({"drive.response_time": 0.006}, "0.003 s"),
        ({"controller.sample_time": 0.005}, "0.0025 s"),
        ({"steps.twin": 1e-7}, "between 1e-06 and"),
    ],
)
def test_a_step_that_does_not_resolve_lag_and_sampling_is_refused(change, longest):
    text = refusal(lambda: BallScrew.load().changed(change))
    assert "steps.twin" in text
    assert longest in text
    assert "received" in text


# Scenarios


def test_the_shipped_motion_is_that_of_0_1():
    """120 mm out in 5 s, 3 s of rest, and back, with the noise of its seed."""
    actuator = BallScrew.load()
    found = ematwin.simulate(
        actuator="rm1605", faults={"friction": 1.2, "roughness": 0.1, "load": 100.0}, seed=3
    )
    set_point, interval = out_and_back(actuator, 0.12, 5.0, 3.0)
    np.testing.assert_allclose(found.set_point, set_point, rtol=1e-14)
    assert found.interval == pytest.approx(interval)
    assert len(found) == 325
    # sums of what version 0.1 simulated
    assert found.current.sum() == pytest.approx(259.8422945594303, rel=1e-9)
    assert found.position_error.sum() == pytest.approx(-0.05882226625552113, rel=1e-9)
    assert found.provenance["faults"]["friction"] == 1.2


def test_a_sensor_of_ones_own_takes_the_place_of_the_usual_noise():
    clean = ematwin.simulate(actuator="rm1605", noise=ematwin.Noise())
    again = ematwin.simulate(actuator="rm1605", noise=ematwin.Noise(), seed=5)
    np.testing.assert_array_equal(clean.current, again.current)
    noisy = ematwin.simulate(actuator="rm1605", noise=ematwin.Noise(white=0.02), seed=5)
    np.testing.assert_array_equal(noisy.position_error, clean.position_error)
    rms = float(np.sqrt(np.mean(clean.current**2)))
    assert np.std(noisy.current - clean.current) == pytest.approx(0.02 * rms, rel=0.2)


@pytest.mark.parametrize("rate", [25.0, 50.0, 12.5])
def test_a_motion_is_sampled_at_the_rate_that_is_asked_for(rate):
    found = ematwin.simulate(actuator="rm1605", sample_rate=rate)
    assert found.sample_rate == pytest.approx(rate)
    assert found.time[-1] == pytest.approx(12.96, abs=1.0 / rate)


REFUSED = {
    "no rate": ({"sample_rate": 0.0}, "cannot be sampled at 0 Hz"),
    "too slow": ({"sample_rate": 0.01}, "cannot be sampled at 0.01 Hz"),
    "a step": ({"step": 1e-3}, "leave step and initial_position out"),
    "a place": ({"initial_position": 0.01}, "leave step and initial_position out"),
    "another model": ({"model": "reference"}, "There is no model 'reference'"),
    "a load over time": (
        {"scenario": ematwin.Scenario.from_columns(
            np.array([0.0, 1.0]), np.array([0.0, 0.01]), np.array([0.0, 1.0])
        )},
        "give a constant one with the faults",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("options", "said"), REFUSED.values(), ids=REFUSED)
def test_what_a_ball_screw_cannot_simulate_is_refused(options, said):
    with pytest.raises(ematwin.EmatwinError, match=said) as caught:
        ematwin.simulate(actuator="rm1605", **options)
    assert "\n" not in str(caught.value)


# Kinds


def test_a_file_that_names_no_kind_or_a_former_one_is_brushless(tmp_path):
    text = BldcActuator.shipped()["servo48"].read_text(encoding="utf-8")
    plain = re.sub(r"^kind = .*\n", "", text)
    for n, head in enumerate(("", 'kind = "rotary"\n', 'kind = "bldc"\n')):
        path = tmp_path / f"{n}.toml"
        path.write_text(head + plain, encoding="utf-8")
        assert model_in(path).kind == "bldc"
        assert load_actuator(path) == load_actuator("servo48")


@pytest.mark.parametrize(
    ("wanted", "other", "kind"),
    [(BldcActuator, "rm1605", "ball-screw"), (BallScrew, "servo48", "bldc")],
)
def test_an_actuator_of_another_kind_is_refused_by_its_kind(wanted, other, kind):
    for given in (shipped_actuators()[other], load_actuator(other)):
        text = refusal(lambda given=given: wanted.load(given))
        assert f"of the kind {kind!r} where one of the kind {wanted.kind!r} is needed" in text
    assert f"Shipped: {wanted.default}" in refusal(lambda: wanted.load(other))


def test_an_unknown_kind_names_the_known_ones(tmp_path):
    path = written(tmp_path, '"ball-screw"', '"hydraulic"')
    for load in (load_actuator, model_in):
        assert "'hydraulic'; choose one of bldc, ball-screw" in refusal(
            lambda load=load: load(path)
        )
    text = refusal(lambda: load_actuator(written(tmp_path, '"ball-screw"', "[1]")))
    assert "[1]" in text


# Calibrations in files


@pytest.fixture
def calibration() -> Calibration:
    """One with numbers of no meaning, all different."""
    random = np.random.default_rng(0)
    actuator = BallScrew.load().changed({"screw.friction_force": 2711.828})
    command, interval = out_and_back(actuator, 0.1, 4.0, 2.0)
    features, runs = 63, ("1", "1", "2", "2", "3", "3")
    healthy = Measurements(
        features=np.exp(random.normal(size=(6, features))),
        covariate=np.array([-120.0, 340.0, 10.0, 20.0, 30.0, 40.0]),
        groups=np.array([0, 0, 1, 1, 2, 2]),
        runs=np.array(runs),
        statistics={"sensor_coupling": random.normal(size=6)},
    )
    return PopulationCalibration(
        actuator=actuator,
        baseline=Baseline.of_template(MODEL, actuator),
        motion=Motion(command, interval, 1.4, ("current", "position_error")),
        discrepancy=Parabola(212.5, random.normal(size=(3, 2 * command.size))),
        healthy=healthy,
        signatures=(
            Signature(
                "lubrication", Parabola(212.5, random.normal(size=(3, features))), "9 motions"
            ),
        ),
        facts={"runs": ["1", "2"], "sources": ["a.csv"], "undetermined": []},
    )


def test_a_calibration_keeps_the_tolerances_of_its_actuator(tmp_path, calibration):
    path = tmp_path / "mine.toml"
    known = calibration.actuator.with_tolerances({"screw.lead": "0.5 %"})
    replace(calibration, actuator=known).save(path, {})
    assert Calibration.load(path).actuator.tolerance("screw.lead") == 0.005
    assert load_actuator(path).tolerance("screw.lead") == 0.005


def changed(tmp_path: Path, calibration: Calibration, change: Callable[[dict], Any]) -> str:
    """What is said of a saved calibration after a change of its table."""
    path = tmp_path / "mine.toml"
    calibration.save(path, {})
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    del table["baseline"]["checksum"]  # changed on purpose
    change(table)
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    text = refusal(lambda: Calibration.load(path))
    assert str(path) in text
    return text


DAMAGES = {
    "no command": lambda one: one.pop("command"),
    "one channel of two": lambda one: one["channels"].pop(),
    "another magnitude": lambda one: setitem(one["magnitudes"], 0, "wear"),
    "no healthy runs": lambda one: one.pop("healthy"),
    "a run too few": lambda one: one["healthy"]["runs"].pop(),
    "ragged features": lambda one: one["healthy"]["features"][1].pop(),
    "discrepancy of two rows": lambda one: one["discrepancy"].pop(),
    "text for a number": lambda one: one.update(interval="often"),
    "NaN": lambda one: setitem(one["healthy"]["covariate"], 0, math.nan),
    "half a statistic": lambda one: one["healthy"]["statistics"]["sensor_coupling"].pop(),
    "negative settling time": lambda one: one.update(settling_time=-1.0),
    "interval next to nothing": lambda one: one.update(interval=1e-320),
    "format of text": lambda one: one.update(format="one"),
}


@pytest.mark.parametrize("change", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_calibration_is_refused(tmp_path, calibration, change):
    text = changed(tmp_path, calibration, lambda table: change(table["calibration"]))
    assert "its calibration is damaged" in text


def test_a_damaged_signature_is_refused(tmp_path, calibration):
    text = changed(tmp_path, calibration, lambda t: t["signature"][0]["coefficients"].pop())
    assert "its calibration is damaged" in text


def test_a_calibration_of_a_newer_format_asks_for_an_update(tmp_path, calibration):
    text = changed(tmp_path, calibration, lambda t: t["calibration"].update(format=FORMAT + 1))
    assert f"format {FORMAT + 1}, this one knows {FORMAT}" in text
    assert "Update ematwin" in text


def test_a_calibration_whose_kind_was_changed_is_refused(tmp_path, calibration):
    text = changed(tmp_path, calibration, lambda table: table.update(kind="rotary"))
    assert "is not a name" in text
    text = changed(tmp_path, calibration, lambda table: table.update(kind="hydraulic"))
    assert "there is no kind of actuator 'hydraulic'" in text
