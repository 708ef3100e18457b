"""Impossible parameters, unstable loops and recordings that cannot be what they say."""

import re

import numpy as np
import pytest

from ematwin.errors import EmatwinError, ParameterError, RecordError
from ematwin.models.pmsm.model import MODEL
from ematwin.models.pmsm.parameters import loop_radius
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import simulate
from pmsm_inputs import ACTUATOR, healthy, reference, smooth_move

SHORT = Scenario(duration=0.1, command=[{"type": "ramp", "rate": 1.0, "start": 0.02}])


@pytest.fixture(scope="module")
def recording():
    also = ("current_d", "current_q", "voltage_d", "voltage_q", "motor_speed")
    return simulate(None, SHORT, None, ACTUATOR, also=also)


UNSTABLE = [
    ({"controller.current_gain": 60.0}, "current", "current_time"),
    ({"controller.current_time": 5e-4}, "current", "current_time"),
    ({"controller.speed_gain": 0.3}, "speed", "speed_time"),
    ({"controller.position_gain": 300.0}, "position", "position_time"),
]


@pytest.mark.parametrize(("values", "loop", "time"), UNSTABLE)
def test_a_loop_that_is_unstable_at_its_sample_time_is_refused_with_the_limit(values, loop, time):
    with pytest.raises(ParameterError) as caught:
        ACTUATOR.changed(values)
    said = str(caught.value)
    assert f"the {loop} loop is unstable at controller.{time}" in said
    found = re.search(r"up to ([\d.e+]+) us", said)
    if found is None:
        assert "no sample time makes it stable" in said
        return
    limit = float(found[1]) * 1e-6
    wrong = ACTUATOR.with_arrays(values)  # not validated
    assert loop_radius(wrong, loop, 0.97 * limit) <= 1.0 < loop_radius(wrong, loop, 1.05 * limit)


def test_the_limit_of_the_current_loop_is_that_of_the_textbook():
    """An inductance alone, voltage one sample late: z^2 - z + k T/L = 0 is stable for k T < L."""
    bare = ACTUATOR.with_arrays({
        "controller.current_integral": 0.0, "motor.resistance": 1e-9,
        "motor.inductance_d": 4e-3, "motor.inductance_q": 4e-3,
    })  # fmt: skip
    limit = 4e-3 / bare.controller.current_gain
    # the idle integrator stays where it is: an eigenvalue of one
    assert loop_radius(bare, "current", 0.99 * limit) == pytest.approx(1.0, abs=1e-9)
    assert loop_radius(bare, "current", 1.01 * limit) > 1.001


def test_what_the_limit_allows_rests_and_what_it_refuses_swings():
    """The simulation itself, with the gains that validation refuses put past it."""
    motion = np.concatenate([smooth_move(ACTUATOR, 0.1, 3.0), np.full(3000, 3.0)])
    swing = {}
    for gain in (0.025, 0.3):
        other = ACTUATOR.with_arrays({"controller.speed_gain": gain})
        found = reference(other, healthy(), motion, 0.0 * motion)
        swing[gain] = np.ptp(found["motor_speed"][-500:])
    assert swing[0.025] < 5.0 < 20.0 < swing[0.3]


IMPOSSIBLE = [
    ({"motor.leakage": 5e-3}, "motor.leakage must be less than both inductances"),
    ({"controller.speed_time": 1.5e-4}, "whole number of current samples"),
    ({"controller.position_time": 1e-4}, "at least controller.speed_time"),
    ({"steps.monitor": 1e-3}, "the step of the monitor model must lie between"),
    ({"motor.resistance": -1.0}, "motor.resistance"),
    ({"transmission.travel_low": 0.1}, "travel_low must lie below zero"),
]


@pytest.mark.parametrize(("values", "said"), IMPOSSIBLE)
def test_impossible_parameters_are_refused_in_one_sentence(values, said):
    with pytest.raises(ParameterError, match=re.escape(said)):
        ACTUATOR.changed(values)


MISSING = [
    (("current_a", "current_d", "current_q"), "has current_b, current_c but not current_a"),
    (("current_d", "current_q", "motor_position"), "phase currents but no motor_position"),
    (("voltage_b", "voltage_d", "voltage_q"), "has voltage_a, voltage_c but not voltage_b"),
    (("current_q", "current_a", "current_b", "current_c"), "has current_d but not current_q"),
    (("command",), "has no command"),
]


@pytest.mark.parametrize(("dropped", "said"), MISSING)
def test_missing_channels_are_named_with_what_they_are_needed_for(recording, dropped, said):
    with pytest.raises(RecordError) as caught:
        MODEL.check(recording.changed(**dict.fromkeys(dropped)), ACTUATOR)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


WRONG = [
    ({"current_a": 1e3, "current_b": 1e3, "current_c": 1e3}, "looks like mA"),
    ({"voltage_q": 1e3}, "looks like mV"),
    ({"output_position": 57.3, "command": 57.3}, "looks like degrees"),
    ({"motor_position": -1.0}, "wrong sign"),
    ({"motor_position": 57.3}, "looks like degrees"),
    ({"current_b": -1.0}, "current_b has the wrong sign"),
]


@pytest.mark.parametrize(("factors", "said"), WRONG)
def test_wrong_units_and_signs_are_refused_with_the_likely_cause(recording, factors, said):
    scale = 4.0 if "current_a" in factors else 1.0  # enough current to be absurd in mA
    wrong = {
        name: scale * factor * recording.channels[name]
        + (0.02 if name in ("output_position", "command") else 0.0) * factor
        for name, factor in factors.items()
    }
    with pytest.raises(RecordError, match=said):
        MODEL.check(recording.changed(**wrong), ACTUATOR)


def test_doubts_are_said(recording):
    assert MODEL.check(recording, ACTUATOR) == []
    bare = recording.changed(**{n: None for n in recording.channels if n.startswith("voltage")})
    assert "There are no voltages" in MODEL.check(bare, ACTUATOR)[0]
    moving = recording.between(0.05, 0.1)
    assert any("begins in motion" in one for one in MODEL.check(moving, ACTUATOR))
    shifted = recording.changed(current_b=recording.current_b * 0.3)
    assert any("check the scales" in one for one in MODEL.check(shifted, ACTUATOR))
    still = recording.changed(
        motor_position=1e-3 * recording.motor_position,
        output_position=1e-3 * recording.output_position,
    )
    assert len(MODEL.excitation(still, ACTUATOR)) == 2


def test_a_recording_that_is_too_slow_or_short_or_still_is_refused(recording):
    every = slice(None, None, 20)
    slow = type(recording)(
        recording.time[every], {n: v[every] for n, v in recording.channels.items()}
    )
    long = type(recording)(np.arange(2000) / 500.0, {
        n: np.resize(v, 2000) for n, v in recording.channels.items()
    })  # fmt: skip
    still = recording.changed(**{f"current_{x}": np.zeros(len(recording)) for x in "abcdq"})
    for wrong, said in ((slow, "samples; at least"), (long, "is sampled at 500 Hz"),
                        (still, "is constant")):  # fmt: skip
        with pytest.raises(RecordError, match=said):
            MODEL.compare(wrong, ACTUATOR)


def test_a_simulation_that_cannot_be_is_refused():
    for arguments, said in (
        ({"sample_rate": 3000.0}, "does not divide"),
        ({"sample_rate": -1.0}, "positive number"),
        ({"step": 1e-3}, "must lie between"),
        ({"initial_position": 9.0}, "within the travel"),
    ):
        with pytest.raises(EmatwinError, match=said):
            simulate(None, SHORT, None, ACTUATOR, **arguments)
    far = Scenario(duration=1.0, command=[{"type": "step", "value": 2.0}])
    with pytest.raises(ParameterError, match="beyond the end stops"):
        simulate(None, far, None, ACTUATOR)


def test_swapped_phases_are_told_by_the_current_that_the_drive_holds_at_zero(recording):
    swapped = {
        "current_a": recording.channels["current_b"], "current_b": recording.channels["current_a"],
    }  # fmt: skip
    with pytest.raises(RecordError, match=r'The phases are swapped.*phase_order = "bac"'):
        MODEL.check(recording.changed(**swapped), ACTUATOR)
