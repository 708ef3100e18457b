"""Mistakes of unit and wiring are named; sound records, however faulty the actuator, pass."""

import re

import numpy as np
import pytest

import ematwin
from ematwin.errors import RecordError
from ematwin.models.bldc.channels import PHASES, phase_currents
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.plausibility import check_plausible
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

ACTUATOR = BldcActuator.load()
DEGREES = 180 / np.pi


@pytest.fixture(scope="module")
def record() -> Recording:
    return ematwin.simulate("reference", faults={"friction": 0.3})


def phases(record: Recording, *currents: np.ndarray) -> Recording:
    return record.changed(**dict(zip(PHASES, currents, strict=True)))


FAULTY = [
    {},
    {"friction": 1.0},
    {"backlash": 1.0},
    {"short_a": 1.0},
    {"short_b": 0.8, "short_c": 0.9, "gain": 0.0, "friction": 0.8},
    {"eccentricity": 1.0, "eccentricity_phase": 0.2},
    {"gain": 1.0, "eccentricity": 0.7, "backlash": 0.9},
]


@pytest.mark.parametrize("faults", FAULTY)
def test_a_sound_record_of_a_faulty_actuator_passes(faults: dict[str, float]) -> None:
    noisy = Noise(white=0.03, bits=12)
    sound = ematwin.simulate("reference", faults=faults, noise=noisy, seed=1)
    assert check_plausible(sound, ACTUATOR) == []


@pytest.mark.parametrize("faults", FAULTY)
def test_an_offset_of_the_sensors_is_told_apart_from_any_fault(faults: dict[str, float]) -> None:
    noisy = Noise(white=0.03, offset=0.02, bits=12)
    record = ematwin.simulate("reference", faults=faults, noise=noisy, seed=1)
    (said,) = check_plausible(record, ACTUATOR)
    offsets = [int(found) for found in re.findall(r"[abc] ([+-]\d+)", said)]
    assert offsets == pytest.approx([20, 20, 20], abs=10)


@pytest.mark.parametrize("scenario", ["ramp", "sine", "step"])
def test_other_movements_pass(scenario: str) -> None:
    assert check_plausible(ematwin.simulate("reference", scenario), ACTUATOR) == []
    assert check_plausible(ematwin.simulate("monitor", scenario), ACTUATOR) == []


def refused(record: Recording, said: str) -> None:
    with pytest.raises(RecordError, match=said) as caught:
        check_plausible(record, ACTUATOR)
    assert "\n" not in str(caught.value)


def test_time_in_milliseconds(record: Recording) -> None:
    stripped = record.changed(motor_speed=None, output_speed=None)
    refused(stripped.changed(time=record.time * 1e3), '20 Hz.*"ms" .the rate would be 20000 Hz')
    refused(stripped.changed(time=record.time * 1e6), '0.02 Hz.*"us"')
    refused(stripped.changed(time=record.time * 1e-3), "2e.07 Hz.*read as ms or us")


def test_time_against_speed_tells_the_unit_of_time(record: Recording) -> None:
    refused(record.changed(time=record.time * 1e3), "time looks like ms read as s")
    refused(record.changed(time=record.time * 1e6), "time looks like us read as s")
    refused(record.changed(time=record.time * 1e-3), "time looks like s read as ms")


def test_sampling_too_slow_for_the_low_pass(record: Recording) -> None:
    slow = record.changed(**{name: values[::20] for name, values in record.columns()})
    refused(slow, "1000 Hz; the comparison needs at least 2000 Hz")


def test_too_short(record: Recording) -> None:
    refused(record.between(0.0, 0.015), "too short: 301 samples in 0.015 s")


def test_constant(record: Recording) -> None:
    still = np.zeros(len(record))
    noise = np.random.default_rng(0).normal(0, 0.01, (3, len(record)))
    resting = phases(record, *noise).changed(command=still + 0.1, load=None)
    refused(resting, "constant: command 0.1 rad")
    refused(phases(record, still, still, still), "zero throughout")


def test_a_current_that_stays_while_the_command_moves_is_doubtful(record: Recording) -> None:
    noise = np.random.default_rng(0).normal(0, 0.01, len(record))
    quiet = phases(record, noise, -noise, 0 * noise).changed(motor_position=None)
    assert "command moves, but the current" in check_plausible(quiet, ACTUATOR)[0]


def test_current_in_milliamperes(record: Recording) -> None:
    assert phase_currents(record) is not None
    refused(phases(record, *(1e3 * phase_currents(record).T)), "looks like mA")
    refused(phases(record, *(1e6 * phase_currents(record).T)), "Check its unit and scale")


def test_command_and_position_in_degrees(record: Recording) -> None:
    only = record.changed(motor_position=None, motor_speed=None, output_speed=None)
    bare = only.changed(output_position=None)
    refused(bare.changed(command=0.3 * DEGREES * np.sin(20 * record.time)), "looks like degrees")
    refused(only.changed(command=record.command * DEGREES), "command looks like degrees")
    refused(
        record.changed(output_position=record.output_position * DEGREES, output_speed=None),
        "output_position looks like degrees",
    )
    refused(
        record.changed(motor_position=record.motor_position * DEGREES),
        "motor_position looks like degrees",
    )


def test_the_other_side_of_the_gear(record: Recording) -> None:
    refused(record.changed(command=500 * record.command), "command looks like an angle of the mot")
    refused(
        record.changed(output_position=500 * record.output_position, output_speed=None),
        "output_position looks like an angle of the motor side",
    )


def test_speed_in_rpm(record: Recording) -> None:
    refused(record.changed(motor_speed=record.motor_speed * 30 / np.pi), "motor_speed looks like")
    refused(record.changed(output_speed=record.output_speed * DEGREES), "degrees per second")


def test_a_position_of_the_wrong_sign(record: Recording) -> None:
    refused(record.changed(motor_speed=-record.motor_speed), "wrong sign")
    slow = ematwin.simulate("reference", "ramp")
    turned = slow.changed(output_position=-slow.output_position, output_speed=None)
    refused(turned, "wrong sign")


def test_beyond_the_end_stops(record: Recording) -> None:
    bare = record.changed(motor_position=None, output_position=None)
    refused(bare.changed(command=record.command + 1.0), "beyond the end stops.*offset")


def test_a_wrapped_motor_angle(record: Recording) -> None:
    wrapped = record.changed(motor_position=record.motor_position % (2 * np.pi), motor_speed=None)
    refused(wrapped, "unwrap = true")


@pytest.mark.parametrize("name", PHASES)
def test_one_phase_of_the_wrong_sign(record: Recording, name: str) -> None:
    turned = record.changed(**{name: -getattr(record, name)})
    refused(turned, f"{name} inverted: {name} has the wrong sign")


def test_currents_that_do_not_sum_to_zero(record: Recording) -> None:
    warned = check_plausible(record.changed(current_b=1.5 * record.current_b), ACTUATOR)
    assert "check the scales" in warned[0]
    warned = check_plausible(record.changed(current_b=record.current_b + 0.5), ACTUATOR)
    assert "(a +0, b +500, c +0 mA)" in warned[0]
    assert len(warned) == 1


@pytest.mark.parametrize("order", ["acb", "bac", "bca", "cab", "cba"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("load", [True, False])
def test_swapped_phases(record: Recording, order: str, sign: int, load: bool) -> None:
    """What the message says to put into the map restores the record."""
    given = phases(record, *(sign * getattr(record, f"current_{k}") for k in order))
    if not load:
        given = given.changed(load=None)
    signs = " and sign = -1 for all three" if sign < 0 else ""
    refused(given, f'phase_order = "{order}"{signs}')


@pytest.mark.parametrize("load", [True, False])
def test_all_phases_of_the_wrong_sign(record: Recording, load: bool) -> None:
    assert phase_currents(record) is not None
    turned = phases(record, *(-phase_currents(record).T))
    refused(turned if load else turned.changed(load=None), "All phase currents have the wrong sign")


@pytest.mark.parametrize("zero", [0.4, 0.7, -0.8, 1.2, 1.4])
def test_a_motor_angle_that_is_not_counted_from_phase_a(record: Recording, zero: float) -> None:
    """The offset that the message names restores the fit."""
    with pytest.raises(RecordError, match="offset = ") as caught:
        check_plausible(record.changed(motor_position=record.motor_position + zero), ACTUATOR)
    offset = float(str(caught.value).split("offset = ")[1].split(" rad")[0])
    turn = 2 * np.pi / ACTUATOR.motor.pole_pairs
    rest = (zero + offset + turn / 2) % turn - turn / 2
    assert abs(rest) < 0.06


def test_a_motor_angle_that_is_a_little_off_is_corrected(record: Recording) -> None:
    warned = check_plausible(record.changed(motor_position=record.motor_position + 0.12), ACTUATOR)
    assert "counted from +13.8 deg electrical of phase a" in warned[0]
    assert "another zero" not in "".join(warned)


def test_a_motor_angle_that_is_further_off_is_doubtful(record: Recording) -> None:
    warned = check_plausible(record.changed(motor_position=record.motor_position + 0.15), ACTUATOR)
    assert any("may have another zero" in one for one in warned)


def test_a_motor_angle_of_opposite_sense(record: Recording) -> None:
    turned = record.changed(motor_position=-record.motor_position, motor_speed=None)
    turned = turned.changed(output_position=None, output_speed=None)
    refused(turned, "phase_order|sign = -1 and offset")


def test_a_motor_angle_of_noise_is_doubtful(record: Recording) -> None:
    noise = 10 * np.random.default_rng(0).normal(size=len(record))
    odd = record.changed(motor_position=np.cumsum(noise) * 0.01, motor_speed=None)
    odd = odd.changed(output_position=None)
    assert any("fits the EMF shapes" in said for said in check_plausible(odd, ACTUATOR))
