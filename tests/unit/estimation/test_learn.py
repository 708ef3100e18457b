"""An actuator from its healthy recordings, and what can be said of it afterwards."""

import pytest

from bldc_inputs import HALF
from ematwin import BldcActuator, Noise, simulate
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


def test_healthy_recordings_tell_an_actuator_that_is_not_as_its_data_sheet() -> None:
    noise = Noise(white=0.02, bits=12)
    healthy = [simulate("reference", HALF, None, ACTUATOR, noise=noise, seed=n) for n in range(3)]
    learnt = learn(MODEL, TEMPLATE, [MODEL.compare(one, TEMPLATE, threads=1) for one in healthy])
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
