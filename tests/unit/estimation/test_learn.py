"""An actuator from its healthy recordings, and what can be said of it afterwards."""

import pytest

from bldc_inputs import HALF
from ematwin import BldcActuator, Noise, Recording, identify, simulate
from ematwin.estimation.learn import learn
from ematwin.models.registry import model_of

TEMPLATE = BldcActuator.load()
MODEL = model_of(TEMPLATE)
OFF = {
    "motor.emf_constant": 0.97,
    "motor.inertia": 1.06,
    "motor.friction_torque": 1.12,
    "transmission.backlash": 1.2,
    "controller.position_gain": 0.95,
}
ACTUATOR = TEMPLATE.changed({place: TEMPLATE.value(place) * x for place, x in OFF.items()})


def recorded(seed: int, faults=None, actuator: BldcActuator = ACTUATOR) -> Recording:
    found = simulate(
        "reference", HALF, faults, actuator, noise=Noise(white=0.02, bits=12), seed=seed
    )
    return found.changed(source=f"run{seed}.csv")


def learnt_from(recordings):
    return learn(MODEL, TEMPLATE, [MODEL.compare(one, TEMPLATE, threads=1) for one in recordings])


@pytest.fixture(scope="module")
def healthy() -> list[Recording]:
    return [recorded(seed) for seed in range(3)]


@pytest.fixture(scope="module")
def learnt(healthy):
    return learnt_from(healthy)


def ratios(actuator: BldcActuator) -> dict[str, float]:
    """What a current shows of an actuator: torques only over the torque constant."""
    motor, gear = actuator.motor, actuator.transmission
    return {
        "inertia": motor.inertia / motor.emf_constant,
        "output inertia": gear.output_inertia / motor.emf_constant,
        "friction": (motor.friction_torque + gear.friction_torque) / motor.emf_constant,
        "backlash": gear.backlash,
        "position gain": actuator.controller.position_gain,
    }


def test_healthy_recordings_tell_an_actuator_that_is_not_as_its_data_sheet(learnt) -> None:
    found, true, stated = ratios(learnt.actuator), ratios(ACTUATOR), ratios(TEMPLATE)
    for name, value in true.items():
        assert found[name] == pytest.approx(value, rel=0.02), name
    assert abs(stated["backlash"] / true["backlash"] - 1.0) > 0.1  # the template does not
    assert learnt.baseline.recordings == 3
    assert learnt.baseline.has_load
    assert learnt.baseline.misfit < 1.5 * learnt.baseline.expected_misfit
    assert not learnt.notes
    told = {one.place for one in learnt.parameters if one.determined}
    assert {"controller.position_gain", "transmission.backlash"} <= told
    assert "drive.current_limit" not in told  # no recording came near it


def test_faults_of_a_learnt_actuator_are_named_and_nothing_else(learnt) -> None:
    faults = {"friction": 0.25, "short_b": 0.15}
    found = identify(recorded(100, faults), learnt, threads=1)
    assert found.calibrated
    assert found.verdict.grade == "fault"
    assert set(found.verdict.faults) == set(faults)
    for name in ("friction", "backlash", "short_a", "short_b", "short_c", "eccentricity", "gain"):
        low, high = found.intervals[name]
        assert low <= faults.get(name, 0.5 if name == "gain" else 0.0) <= high, name
    assert found.intervals["friction"][1] - found.intervals["friction"][0] < 0.02


def test_a_torque_constant_that_drifted_on_a_healthy_actuator_is_no_fault(learnt) -> None:
    place = "motor.emf_constant"
    warm = ACTUATOR.changed({place: 0.97 * ACTUATOR.value(place)})
    found = identify(recorded(101, actuator=warm), learnt, threads=1)
    assert found.verdict.grade == "healthy"
    # turns missing from all phases alike would explain it as well, and take three faults
    assert all(found.values[f"short_{phase}"] < 0.01 for phase in "abc")
    assert found.fitted[place] == pytest.approx(warm.value(place), rel=0.015)


def test_a_sheet_of_another_motor_is_a_finding_where_the_twin_explains_the_rest() -> None:
    place = "motor.emf_constant"
    sheet = TEMPLATE.changed({place: 2.0 * TEMPLATE.value(place)})
    learnt = learn(MODEL, sheet, [MODEL.compare(recorded(0, actuator=TEMPLATE), sheet, threads=1)])
    found = next(one for one in learnt.parameters if one.place == place)
    assert found.determined
    assert abs(found.value - TEMPLATE.value(place)) < 2.0 * found.standard_error
    assert any(f"{place} at" in note and "Check the sheet" in note for note in learnt.notes)
