"""The twin does what a sheet of paper says."""

import numpy as np
import pytest

import ematwin
from ematwin.models.scenario import Ramp, Step
from ematwin_dc_gearmotor.model import MODEL

ACTUATOR = MODEL.parameters.load()
MOTOR, GEAR, DRIVE = ACTUATOR.motor, ACTUATOR.gear, ACTUATOR.drive
DRY = MOTOR.friction_torque + GEAR.friction_torque / GEAR.ratio  # N m, on the motor shaft


def moved(command, duration=1.0, **faults):
    scenario = ematwin.Scenario(duration=duration, command=[command])
    return ematwin.simulate(scenario=scenario, faults=faults, actuator=ACTUATOR)


@pytest.mark.parametrize("faults", [{}, {"friction": 2.0, "magnets": 0.8, "brushes": 1.5}])
def test_steady_motion_takes_the_current_of_friction_and_the_voltage_of_speed(faults):
    recording = moved(Ramp(rate=2.0), **faults)
    w = 2.0 * GEAR.ratio
    k = MOTOR.torque_constant * faults.get("magnets", 1.0)
    current = (DRY * faults.get("friction", 1.0) + MOTOR.viscous_damping * w) / k
    voltage = MOTOR.resistance * faults.get("brushes", 1.0) * current + k * w
    assert recording.current[-1] == pytest.approx(current, rel=1e-3)
    assert recording.voltage[-1] == pytest.approx(voltage, rel=1e-3)


def test_a_load_takes_its_current_and_no_other():
    loads = [moved(Ramp(rate=2.0), load=load).current[-1] for load in (-0.2, 0.0, 0.2)]
    expected = 0.2 / (GEAR.ratio * MOTOR.torque_constant)
    assert np.diff(loads) == pytest.approx([expected, expected], rel=1e-3)


def test_terminal_voltage_and_current_stay_within_their_limits():
    recording = moved(Step(value=3.0, time=0.1))
    assert np.abs(recording.current).max() == pytest.approx(DRIVE.current_limit)
    assert np.abs(recording.voltage).max() <= DRIVE.supply_voltage
    speed = np.gradient(recording.position, recording.time).max()
    assert speed == pytest.approx(DRIVE.speed_limit / GEAR.ratio, rel=0.02)


def test_the_output_comes_back_short_by_the_play():
    there_and_back = [Ramp(rate=1.0, stop=0.5), Ramp(rate=-1.0, start=1.0, stop=1.5)]
    scenario = ematwin.Scenario(duration=2.5, command=there_and_back)
    rests = []
    for k in (1.0, 3.0):
        recording = ematwin.simulate(scenario=scenario, faults={"backlash": k}, actuator=ACTUATOR)
        rests.append(recording.position[-1])
    assert np.diff(rests)[0] == pytest.approx(0.5 * 2.0 * GEAR.backlash, rel=0.01)


def test_the_servo_stops_short_where_its_torque_equals_friction():
    recording = moved(Step(value=0.3, time=0.1), duration=2.0)
    stiffness = DRIVE.position_gain * GEAR.ratio * DRIVE.speed_gain * MOTOR.torque_constant
    assert 0.3 - recording.position[-1] == pytest.approx(
        DRY / stiffness + 0.5 * GEAR.backlash, rel=1e-3
    )
