"""Mistakes of unit and wiring are named; sound records, however faulty the actuator, pass."""

import re

import numpy as np
import pytest

import ematwin
from bldc_inputs import recorded
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
    assert check_plausible(recorded(faults=faults, noise=noisy), ACTUATOR) == []


@pytest.mark.parametrize("faults", FAULTY)
def test_an_offset_of_the_sensors_is_told_apart_from_any_fault(faults: dict[str, float]) -> None:
    noisy = Noise(white=0.03, offset=0.02, bits=12)
    (said,) = check_plausible(recorded(faults=faults, noise=noisy), ACTUATOR)
    offsets = [int(found) for found in re.findall(r"[abc] ([+-]\d+)", said)]
    assert offsets == pytest.approx([20, 20, 20], abs=10)


@pytest.mark.parametrize("scenario", ["ramp", "sine", "step"])
def test_other_movements_pass(scenario: str) -> None:
    assert check_plausible(recorded(scenario, noise=None), ACTUATOR) == []
    assert check_plausible(ematwin.simulate("monitor", scenario), ACTUATOR) == []


def refused(record: Recording, said: str) -> None:
    with pytest.raises(RecordError, match=said) as caught:
        check_plausible(record, ACTUATOR)
    assert "\n" not in str(caught.value)


def without_speeds(record: Recording) -> Recording:
    return record.changed(motor_speed=None, output_speed=None)


def only_command(record: Recording) -> Recording:
    return without_speeds(record).changed(motor_position=None, output_position=None)


def thinned(record: Recording) -> Recording:
    return record.changed(**{name: values[::20] for name, values in record.columns()})


def resting(record: Recording) -> Recording:
    noise = np.random.default_rng(0).normal(0, 0.01, (3, len(record)))
    return phases(record, *noise).changed(command=np.full(len(record), 0.1), load=None)


def scaled(name: str, factor: float, **more: None):
    """The recording with one channel so many times as large."""
    return lambda r: r.changed(**{name: factor * getattr(r, name)}, **more)


WRONG = {
    "time in ms": (lambda r: without_speeds(r).changed(time=1e3 * r.time),
                   '20 Hz.*"ms" .the rate would be 20000 Hz'),
    "time in us": (lambda r: without_speeds(r).changed(time=1e6 * r.time), '0.02 Hz.*"us"'),
    "time in ks": (lambda r: without_speeds(r).changed(time=1e-3 * r.time),
                   "2e.07 Hz.*read as ms or us"),
    "ms beside speeds": (scaled("time", 1e3), "time looks like ms read as s"),
    "us beside speeds": (scaled("time", 1e6), "time looks like us read as s"),
    "ks beside speeds": (scaled("time", 1e-3), "time looks like s read as ms"),
    "too slow": (thinned, "1000 Hz; the comparison needs at least 2000 Hz"),
    "too short": (lambda r: r.between(0.0, 0.015), "too short: 301 samples in 0.015 s"),
    "at rest": (resting, "constant: command 0.1 rad"),
    "no current": (lambda r: phases(r, *np.zeros((3, len(r)))), "zero throughout"),
    "mA": (lambda r: phases(r, *(1e3 * phase_currents(r).T)), "looks like mA"),
    "uA": (lambda r: phases(r, *(1e6 * phase_currents(r).T)), "Check its unit and scale"),
    "command in degrees": (
        lambda r: only_command(r).changed(command=0.3 * DEGREES * np.sin(20 * r.time)),
        "looks like degrees"),
    "command in degrees beside a position": (
        lambda r: without_speeds(r).changed(command=DEGREES * r.command, motor_position=None),
        "command looks like degrees"),
    "output in degrees": (scaled("output_position", DEGREES, output_speed=None),
                          "output_position looks like degrees"),
    "motor in degrees": (scaled("motor_position", DEGREES), "motor_position looks like degrees"),
    "motor alone in degrees": (
        lambda r: without_speeds(scaled("motor_position", DEGREES, output_position=None)(r)),
        "motor_position looks like degrees"),
    "motor on the output": (
        lambda r: without_speeds(scaled("motor_position", 1 / 500, output_position=None)(r)),
        "motor_position looks like an angle of the output"),
    "command of the motor": (scaled("command", 500), "command looks like an angle of the mot"),
    "output of the motor": (scaled("output_position", 500, output_speed=None),
                            "output_position looks like an angle of the motor side"),
    "rpm": (scaled("motor_speed", 30 / np.pi), "motor_speed looks like"),
    "degrees per second": (scaled("output_speed", DEGREES), "degrees per second"),
    "turned speed": (scaled("motor_speed", -1), "wrong sign"),
    "beyond the end stops": (
        lambda r: r.changed(motor_position=None, output_position=None, command=r.command + 1.0),
        "beyond the end stops.*offset"),
    "wrapped": (lambda r: r.changed(motor_position=r.motor_position % (2 * np.pi),
                                    motor_speed=None), "unwrap = true"),
    "motor of opposite sense": (
        lambda r: only_command(r).changed(motor_position=-r.motor_position),
        "phase_order|sign = -1 and offset"),
    **{f"{name} turned": (scaled(name, -1), f"{name} inverted: {name} has the wrong sign")
       for name in PHASES},
}  # fmt: skip


@pytest.mark.parametrize(("wrong", "said"), WRONG.values(), ids=WRONG)
def test_a_mistake_of_unit_or_wiring_is_named(record: Recording, wrong, said: str) -> None:
    refused(wrong(record), said)


def test_an_output_of_the_wrong_sign() -> None:
    slow = ematwin.simulate("reference", "ramp")
    turned = slow.changed(output_position=-slow.output_position, output_speed=None)
    refused(turned, "wrong sign")


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


def quiet(record: Recording) -> Recording:
    noise = np.random.default_rng(0).normal(0, 0.01, len(record))
    return phases(record, noise, -noise, 0 * noise).changed(motor_position=None)


def turned(record: Recording, angle: np.ndarray) -> Recording:
    return record.changed(motor_position=angle, motor_speed=None, output_position=None)


FIRST = r"\A.*"  # of the warnings, which are lines
DOUBTFUL = {
    "a current that stays": (quiet, FIRST + "command moves, but the current"),
    "another scale of a phase": (scaled("current_b", 1.5), FIRST + "check the scales"),
    "an offset of a phase, and nothing else": (
        lambda r: r.changed(current_b=r.current_b + 0.5),
        FIRST + r"\(a \+0, b \+500, c \+0 mA\).*\Z"),
    "an angle a little off, which is corrected": (
        lambda r: r.changed(motor_position=r.motor_position + 0.12),
        r"\A(?![\s\S]*another zero)" + FIRST + r"counted from \+13.8 deg electrical of phase a"),
    "an angle further off": (
        lambda r: r.changed(motor_position=r.motor_position + 0.15), "may have another zero"),
    "an angle of noise": (
        lambda r: turned(r, np.cumsum(np.random.default_rng(0).normal(size=len(r))) * 0.1),
        "fits the EMF shapes"),
}  # fmt: skip


@pytest.mark.parametrize(("wrong", "said"), DOUBTFUL.values(), ids=DOUBTFUL)
def test_what_may_be_wrong_is_said(record: Recording, wrong, said: str) -> None:
    assert re.search(said, "\n".join(check_plausible(wrong(record), ACTUATOR)))
