"""Channels that stand still, are late or contradict the others are named, and nothing else is."""

from types import SimpleNamespace

import numpy as np
import pytest

from ematwin.estimation.findings import late_channel
from ematwin.models.channels_agree import contradictions
from ematwin.models.pmsm.channels import to_phases
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.channel import PHASES
from ematwin.recordings.recording import Recording

RATE = 5000.0  # Hz
TIME = np.arange(5000) / RATE
SERVO, BRUSHLESS, AXIS, SCREW = map(load_actuator, ("servo400", "servo48", "emps", "rm1605"))
LATE = round(2e-3 * RATE)  # samples


def pmsm(**changed):
    """A swing at two frequencies, with the torque that it may take, and noise of 1 %."""
    motor = 20.0 * np.sin(2.0 * np.pi * 1.5 * TIME) + 4.0 * np.sin(2.0 * np.pi * 4.0 * TIME)
    torque = 2.0 * np.cos(2.0 * np.pi * 1.5 * TIME) + np.sin(2.0 * np.pi * 3.0 * TIME)
    phases = np.stack(to_phases(0.0 * torque, torque, SERVO.motor.pole_pairs * motor))
    rng = np.random.default_rng(1)
    noisy = phases + 0.01 * rng.standard_normal(phases.shape)
    output = motor / SERVO.transmission.ratio
    channels = {"command": output, "motor_position": motor, "output_position": output}
    return Recording(TIME, {**channels, **dict(zip(PHASES, noisy, strict=True)), **changed})


def axis(actuator=AXIS):
    """A swing of the linear axis under its controller, with a smooth voltage of 3 V."""
    control = actuator.controller
    time = np.arange(4000) * control.sample_time
    position = 0.1 * np.sin(2.0 * np.pi * 0.5 * time) + 0.01 * np.sin(2.0 * np.pi * 2.5 * time)
    voltage = 2.0 * np.cos(2.0 * np.pi * 0.5 * time) + np.sin(2.0 * np.pi * 3.0 * time)
    speed = np.gradient(np.r_[2.0 * position[0] - position[1], position[:-1]], control.sample_time)
    reference = position + (voltage / control.velocity_gain + speed) / control.position_gain
    return Recording(time, {"reference": reference, "position": position, "voltage": voltage})


def late(values):
    return np.concatenate([np.full(LATE, values[0]), values[:-LATE]])


def half_frozen(values):
    middle = values.size // 2 + 40
    return np.concatenate([values[:middle], np.full(values.size - middle, values[middle])])


BROKEN = {
    "stands still at 0": lambda values: 0.0 * values,
    "stands still": lambda values: np.full(values.size, values[777]),
    " ms on while": half_frozen,
    "is 2 ms late": late,
    "nothing but noise": lambda values: (
        0.01 * np.random.default_rng(2).standard_normal(values.size)
    ),
}


def found(recording, actuator=SERVO):
    return contradictions(model_of(actuator), recording, actuator)


@pytest.mark.parametrize("how", BROKEN)
@pytest.mark.parametrize("name", [*PHASES, "motor_position", "output_position"])
def test_a_dead_frozen_or_late_channel_of_a_servo_is_named_and_no_other(name, how):
    recording = pmsm()
    (names,), (said,) = zip(
        *found(recording.changed(**{name: BROKEN[how](recording.channels[name])})).items(),
        strict=True,
    )
    assert names == (name,)
    assert said.startswith(name)
    assert how in said


@pytest.mark.parametrize("how", BROKEN)
def test_so_is_one_from_which_the_third_phase_was_made(how):
    recording = pmsm()
    a, b = (recording.channels[name] for name in PHASES[:2])
    broken = BROKEN[how](a)
    (names,) = found(recording.changed(current_a=broken, current_c=-(broken + b)))
    assert names == ("current_a",)


def test_gains_noise_and_converters_of_sensors_are_no_contradiction():
    recording = pmsm()
    a, b, _ = (recording.channels[name] for name in PHASES)
    step = 40.0 / 2**12
    assert found(recording) == {}
    assert found(recording.changed(current_a=1.2 * a)) == {}
    assert found(recording.changed(current_b=0.8 * b + 0.3)) == {}
    assert found(recording.changed(current_a=1.1 * a, current_c=-(1.1 * a + b))) == {}
    rounded = {name: step * np.round(recording.channels[name] / step) for name in PHASES}
    assert found(recording.changed(**rounded)) == {}


def test_single_false_reads_are_no_contradiction():
    recording = pmsm()
    read = recording.channels["current_a"].copy()
    read[[300, 2000, 4100]] = 30.0
    assert found(recording.changed(current_a=read)) == {}


def test_phases_that_no_gain_and_no_delay_explains_contradict_each_other():
    recording = pmsm()
    other = np.sin(2.0 * np.pi * 7.0 * TIME) + recording.channels["current_b"]
    assert found(recording.changed(current_b=2.0 * other))[PHASES].startswith(
        "current_a, current_b and current_c contradict each other"
    )


def test_an_output_that_stands_still_while_its_motor_crosses_the_gap_is_sound():
    motor = 1.5 * np.sin(2.0 * np.pi * 2.0 * TIME)
    play, output = 0.4, np.empty(TIME.size)
    held = 0.0
    for n, angle in enumerate(motor):
        held = min(max(held, angle - 0.5 * play), angle + 0.5 * play)
        output[n] = held / BRUSHLESS.transmission.ratio
    ones = {name: np.sin(motor + lag) for name, lag in zip(PHASES, (0.0, 2.094395, 4.18879),
                                                            strict=True)}  # fmt: skip
    recording = Recording(
        TIME, {"command": output, "motor_position": motor, "output_position": output, **ones}
    )
    assert found(recording, BRUSHLESS) == {}


def test_a_delay_that_a_gap_may_pass_for_is_none():
    recording = pmsm()
    output = recording.channels["output_position"]
    slightly = recording.changed(output_position=np.r_[output[0], output[:-1]])
    assert found(slightly) == {}


@pytest.mark.parametrize("name", ["position", "voltage"])
def test_the_controller_of_a_linear_axis_tells_what_is_late(name):
    recording = axis()
    assert found(recording, AXIS) == {}
    moved = recording.channels[name]
    shifted = np.concatenate([np.full(2, moved[0]), moved[:-2]])
    (said,) = found(recording.changed(**{name: shifted}), AXIS).values()
    assert said.startswith(f"{name} is 2 ms late")


@pytest.mark.parametrize("gain", ["position_gain", "velocity_gain"])
@pytest.mark.parametrize("times", [0.8, 0.98, 1.1])
def test_gains_of_its_loops_are_no_contradiction(gain, times):
    other = AXIS.changed({f"controller.{gain}": times * getattr(AXIS.controller, gain)})
    assert found(axis(other), AXIS) == {}


def screw(current):
    time = np.arange(325) / 25.0
    set_point = np.interp(time, [0.0, 5.0, 8.0, 13.0], [0.0, 0.12, 0.12, 0.0])
    error = 0.003 * np.sin(time) + 1e-4 * np.random.default_rng(3).standard_normal(time.size)
    return Recording(time, {"set_point": set_point, "position_error": error, "current": current})


def test_a_channel_without_a_law_stands_still_if_it_loses_its_noise_while_the_command_moves():
    noisy = 1.0 + np.sin(np.arange(325) / 40.0) ** 2
    noisy += 0.05 * np.random.default_rng(4).standard_normal(325)
    assert found(screw(noisy), SCREW) == {}
    (said,) = found(screw(half_frozen(noisy)), SCREW).values()
    assert said.startswith("current stands still at")
    at_rest = noisy.copy()
    at_rest[130:190] = at_rest[130]  # the command rests as well
    assert found(screw(at_rest), SCREW) == {}
    limited = np.minimum(noisy, 1.5)
    assert found(screw(limited), SCREW) == {}


@pytest.mark.parametrize(("lag", "said"), [(0, []), (5, ["Taken 5 ms earlier, position fits"])])
def test_without_laws_a_late_channel_is_named_where_the_twin_does_not_explain_it(lag, said):
    """A kind of one's own need not state laws: the answer of its twin shows the delay."""
    time = np.arange(2000) * 1e-3
    answers = {"current": np.sin(40.0 * time), "position": np.sin(23.0 * time + time**2)}
    noise = np.random.default_rng(1).normal(0.0, 0.02, (2, time.size))
    late = answers["position"][np.maximum(np.arange(time.size) - lag, 0)]
    comparison = SimpleNamespace(
        recording=SimpleNamespace(interval=1e-3),
        measured=lambda: {"current": answers["current"] + noise[0], "position": late + noise[1]},
        responses=lambda candidates, count: {n: v[None] for n, v in answers.items()},
    )
    found = late_channel(SimpleNamespace(comparisons=[comparison]), {"friction": 1.0})
    assert [text[: len(part)] for text, part in zip(found, said, strict=True)] == said


@pytest.mark.parametrize("step", [0.1, 0.2])
def test_a_coarse_converter_is_no_dead_sensor(step):
    """Eight bits of an oscilloscope: a small current stands at zero for many samples."""
    time = np.arange(5000) / RATE
    current = 1.0 * np.sin(2.0 * np.pi * 2.0 * time)
    sector = np.floor(6.0 * 0.3 * np.sin(2.0 * np.pi * 2.0 * time)).astype(int) % 3
    phases = np.array([np.roll([1.0, -1.0, 0.0], n) for n in range(3)])[sector] * current[:, None]
    rng = np.random.default_rng(3)
    seen = step * np.round((phases + 0.02 * rng.standard_normal(phases.shape)) / step)
    command = 0.005 * np.sin(2.0 * np.pi * 2.0 * time)
    names = ("current_a", "current_b", "current_c")
    record = Recording(time, {"command": command, **dict(zip(names, seen.T, strict=True))})
    model = model_of(BRUSHLESS)
    assert contradictions(model, record, BRUSHLESS) == {}
    for dead in (0.0 * time, np.where(time > 0.5, seen[2500, 0], seen[:, 0])):
        found = contradictions(model, record.changed(current_a=dead), BRUSHLESS)
        assert list(found) == [("current_a",)]
