"""From where angles are counted is told by the phases that conduct, whatever the fault."""

import math
from functools import cache

import numpy as np
import pytest

import ematwin
from bldc_inputs import NOISE, recorded, with_one_current
from ematwin.errors import RecordError
from ematwin.models.bldc.channels import PHASES, signed_current
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.plausibility import check_plausible
from ematwin.models.bldc.zeros import counted, zeros
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario, Step
from ematwin.recordings.recording import Recording

ACTUATOR = load_actuator(None)
RATIO, POLE_PAIRS = ACTUATOR.transmission.ratio, ACTUATOR.motor.pole_pairs
FAULTY = [
    {},
    {"short_b": 0.15, "friction": 0.25},
    {"eccentricity": 0.4, "eccentricity_phase": 0.3, "backlash": 0.3},
    {"short_a": 0.6, "gain": 0.3},
]


def mounted(record: Recording, electrical: float = 0.0, output: float = 0.0) -> Recording:
    """Sensors off by degrees electrical, and by rad of the motor shaft."""
    names = ("command", "output_position")
    more = {name: record.channels[name] + output / RATIO for name in names}
    off = math.radians(electrical) / POLE_PAIRS
    return record.changed(motor_position=record.channels["motor_position"] + off, **more)


def recorded_at(degrees: float, faults: dict[str, float]) -> Recording:
    """Command, load and phase currents of an actuator whose rotor stands somewhere else."""
    zero = math.radians(degrees) / POLE_PAIRS / RATIO
    usual = model_of(ACTUATOR).load_scenario(None)
    scenario = Scenario(
        duration=usual.duration, command=[*usual.command, Step(value=zero)], load=usual.load
    )
    found = ematwin.simulate(
        "reference", scenario, faults, noise=NOISE, seed=5, initial_position=zero
    )
    kept = {name: found.channels[name] for name in ("command", "load", *PHASES)}
    kept["command"] = kept["command"] - zero
    return Recording(found.time, kept, units={name: found.units[name] for name in kept})


@pytest.mark.parametrize("scenario", ["default", "sine", "ramp", "step"])
@pytest.mark.parametrize("faults", FAULTY)
def test_good_zeros_are_left_alone(scenario, faults):
    record = recorded(scenario, faults)
    assert zeros(record, ACTUATOR) is None
    assert counted(record, ACTUATOR) is record


@pytest.mark.parametrize("scenario", ["default", "sine", "ramp", "step"])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.03])
def test_an_encoder_that_trembles_does_not_turn(scenario, noise):
    """Twelve bits a turn, and noise beside."""
    record = recorded(scenario, FAULTY[1])
    shown = record.motor_position + noise * np.random.default_rng(1).standard_normal(len(record))
    bit = 2.0 * np.pi / 2**12
    found = zeros(record.changed(motor_position=bit * np.round(shown / bit)), ACTUATOR)
    assert found is None or found.motor == 0.0


@pytest.mark.parametrize("electrical", [-13.0, -4.0, 1.5, 13.0])
@pytest.mark.parametrize("faults", FAULTY)
def test_the_zero_of_a_motor_position_is_found(electrical, faults):
    record = recorded(faults=faults)
    shown = mounted(record, electrical)
    found = zeros(shown, ACTUATOR)
    assert math.degrees(found.motor * POLE_PAIRS) == pytest.approx(-electrical, abs=0.4)
    assert "deg electrical of phase a" in found.said(ACTUATOR)[0]
    right, once = record.channels["motor_position"], found.corrected(shown, ACTUATOR)
    assert once.motor_position == pytest.approx(right, abs=math.radians(0.4) / POLE_PAIRS)
    good, left = signed_current(record, POLE_PAIRS), signed_current(once, POLE_PAIRS)
    assert np.mean((good - left) ** 2) < 1e-3 * np.mean(good**2)


@cache
def of_one_current(scenario: str, *faults: tuple[str, float], loops: bool = True) -> Recording:
    """A recording of one current; with ``loops`` of a drive as it is built."""
    actuator = load_actuator("servo48-drive") if loops else ACTUATOR
    found = ematwin.simulate("reference", scenario, dict(faults), actuator, noise=NOISE, seed=5)
    return with_one_current(found)


@pytest.mark.parametrize("scenario", ["default", "ramp"])
@pytest.mark.parametrize("electrical", [-13.0, -4.0, 2.0, 13.0])
@pytest.mark.parametrize("faults", FAULTY)
def test_the_zero_of_a_motor_position_is_found_by_the_dips_of_one_current(
    scenario, electrical, faults
):
    shown = mounted(of_one_current(scenario, *faults.items()), electrical)
    found = zeros(shown, ACTUATOR)
    assert math.degrees(found.motor * POLE_PAIRS) == pytest.approx(-electrical, abs=1.0)


@pytest.mark.parametrize("faults", FAULTY)
def test_good_zeros_beside_one_current_are_left_alone(faults):
    assert zeros(of_one_current("default", *faults.items()), ACTUATOR) is None


@pytest.mark.parametrize("faults", FAULTY)
def test_a_comparator_shows_no_zero(faults):
    shown = mounted(of_one_current("default", *faults.items(), loops=False), 10.0)
    assert zeros(shown, ACTUATOR).motor == 0.0


@pytest.mark.parametrize("electrical", [-25.0, 100.0])
def test_commutations_elsewhere_are_refused(electrical):
    shown = mounted(of_one_current("default"), electrical)
    with pytest.raises(RecordError, match="is not counted from phase a: the current dips") as said:
        check_plausible(shown, ACTUATOR)
    turned = float(str(said.value).partition("offset = ")[2].split()[0])
    off = math.remainder(math.degrees(turned * POLE_PAIRS) + electrical, 60.0)
    assert abs(off) < 1.0


@pytest.mark.parametrize("faults", FAULTY)
def test_motor_and_output_meet_in_the_middle_of_the_gap(faults):
    record = recorded(faults=faults)
    found = zeros(mounted(record, output=0.1), ACTUATOR)
    assert found.motor == 0.0
    assert found.output == pytest.approx(-0.1, abs=2e-4)
    assert "rad (motor shaft) apart" in found.said(ACTUATOR)[0]


def test_a_motion_that_does_not_cross_the_gap_leaves_its_side_open():
    record = recorded()
    apart = 0.0025 - record.channels["motor_position"] / RATIO
    stuck = record.changed(output_position=-apart)  # always at one side
    assert zeros(stuck, ACTUATOR) is None


def test_a_gear_that_a_load_twists_to_one_side_is_not_off_the_middle_of_its_gap():
    soft = ACTUATOR.changed({"compliance.stiffness": 1.0, "compliance.damping": 0.005})
    record = ematwin.simulate("reference", faults={"backlash": 0.1}, actuator=soft)
    assert zeros(record, soft) is None
    assert zeros(record, ACTUATOR) is not None  # as a stiff gear would have it


def test_an_encoder_turned_further_is_left_to_the_check_of_the_wiring():
    assert zeros(mounted(recorded(), 90.0), ACTUATOR).motor == 0.0


@pytest.mark.parametrize("degrees", [-130.0, -20.0, 75.0, 180.0])
@pytest.mark.parametrize("faults", FAULTY[:3])
def test_beside_a_twin_the_phases_tell_where_the_rotor_stands(degrees, faults):
    comparison = BldcComparison(recorded_at(degrees, faults), ACTUATOR)
    placed = comparison.placed(faults)
    shift = placed.recording.command[0] - comparison.recording.command[0]
    off = math.remainder(math.degrees(shift * RATIO * POLE_PAIRS) - degrees, 360.0)
    assert abs(off) < 1.0
    assert BldcComparison(placed.recording, ACTUATOR).placed(faults) is None


def test_shorted_turns_are_put_to_their_phase_wherever_the_rotor_stands():
    found = ematwin.identify(recorded_at(120.0, {"short_b": 0.3, "friction": 0.3}), exact=True)
    assert set(found.verdict.faults) == {"friction", "short_b"}
    assert found.values["short_b"] == pytest.approx(0.3, abs=0.01)
    assert any("told from the phases that conduct" in one for one in found.warnings)


@pytest.mark.parametrize(("scenario", "backlash"), [("ramp", 0.5), ("ramp", 0.0), ("sine", 0.5)])
def test_a_wide_gap_is_not_taken_for_a_zero(scenario, backlash):
    """A motor that turns one way stands half of the gap beside the output, or is counted so."""
    record = recorded(scenario, {"backlash": backlash}).changed(motor_position=None)
    placed = BldcComparison(record, ACTUATOR).placed({})
    if scenario == "ramp" and backlash:
        assert placed.recording is None
        assert "turned one way alone" in placed.said
    else:
        assert placed is None


def test_phases_in_another_order_get_no_verdict():
    record = recorded_at(0.0, {"short_b": 0.3})
    swapped = record.changed(current_b=record.current_c, current_c=record.current_b)
    found = ematwin.identify(swapped, exact=True)
    assert found.verdict.grade == "none"
    assert "No angle of the rotor explains which phases conduct" in found.verdict.reason
