"""What of a servo's recording is compared, and what is said of the rest."""

import numpy as np
import pytest

from ematwin.models.position_servo.model import MODEL
from ematwin.models.position_servo.parameters import PositionServo
from ematwin.models.position_servo.recorded import stretch
from ematwin.recordings.recording import Recording

SERVO = PositionServo.load()
TIME = np.arange(600) * 0.01


def recording(goal, position, **channels):
    return Recording(TIME, {"goal_position": goal, "position": position, **channels})


def answer_to(goal, servo=SERVO, **channels):
    given = Recording(TIME, {"goal_position": goal, **channels})
    return MODEL.respond(servo, given, {}, 1)["position"][0]


def followed():
    goal = 0.8 * np.sin(2.0 * np.pi * 0.4 * TIME)
    return goal, answer_to(goal)


def test_false_reads_have_no_weight_and_are_said():
    goal, position = followed()
    for sample in (100, 333):
        position[sample] = -3.14
    part = stretch(recording(goal, position), SERVO)
    assert part.false[[100, 333]].all()
    assert part.false.sum() <= 12
    assert "2 false reads" in part.said[0]
    comparison = MODEL.compare(recording(goal, position), SERVO)
    assert np.abs(comparison.residuals({}, 1)).max() < 0.1


def test_positions_count_less_while_the_target_is_at_its_speed_limit():
    """A step of 2 rad at 5 rad/s takes 0.4 s, from a delay after the goal on."""
    goal = np.where(TIME < 1.0, 0.0, 2.0)
    noise = MODEL.noise(SERVO, recording(goal, np.zeros(600)))["position"]
    late = TIME[noise > 2.0 * noise[0]]
    assert late[0] == pytest.approx(1.0 + SERVO.controller.delay, abs=0.02)
    assert late[-1] - late[0] == pytest.approx(2.0 / SERVO.controller.speed_limit, abs=0.02)


@pytest.mark.parametrize("hunting", [0.0, 0.008])
def test_a_rest_counts_as_one_sample_even_where_the_servo_hunts_in_its_play(hunting):
    rest = hunting * np.sin(2.0 * np.pi * 4.5 * TIME)
    position = np.where(TIME < 3.0, rest, np.sin(2.0 * (TIME - 3.0)))
    noise = MODEL.noise(SERVO, recording(position, position))["position"]
    assert np.sum(noise[TIME < 2.85] ** -2.0) ** -0.5 == pytest.approx(0.004, rel=0.1)
    assert noise[(TIME > 3.1) & (TIME < 3.6)].max() < 0.01


def test_only_the_stretch_with_torque_is_compared():
    goal, position = followed()
    enabled = np.where(TIME < 2.0, 1.0, 0.0)
    given = recording(goal, np.where(TIME < 2.0, position, 0.0), torque_enabled=enabled)
    comparison = MODEL.compare(given, SERVO)
    assert len(comparison.recording) == 200
    assert "released" in MODEL.check(given, SERVO)[0]
    assert not MODEL.excitation(given, SERVO)


def test_a_trip_is_said_and_forbids_a_verdict():
    goal = np.full(600, 1.5)
    rises = 1.4 * np.minimum(TIME / 0.5, 1.0)
    position = np.where(TIME < 2.0, rises, np.maximum(1.4 - 3.0 * (TIME - 2.0), 0.0))
    given = recording(goal, position)
    assert "trip" in MODEL.excitation(given, SERVO)[0]
    assert 2.0 < MODEL.compare(given, SERVO).recording.time[-1] < 2.4


@pytest.mark.parametrize(("mass", "stalls"), [(0.3, True), (2.0, False)])
def test_a_stall_forbids_a_verdict_where_a_servo_with_any_fault_would_move(mass, stalls):
    """A light arm rests at 0.8 rad because it is blocked; a heavy one as with a low gain too."""
    goal = np.full(600, 1.5)
    position = 0.8 * np.minimum(TIME / 0.5, 1.0)
    given = recording(goal, position, mass=np.full(600, mass))
    assert any("stalled" in text for text in MODEL.check(given, SERVO))
    assert any("blocked" in text for text in MODEL.excitation(given, SERVO)) == stalls


def test_motion_that_overshoots_is_neither():
    goal = np.where(TIME % 1.0 < 0.5, 1.2, -1.2)
    part = stretch(recording(goal, answer_to(goal)), SERVO)
    assert not part.said
    assert not part.obstacles


@pytest.mark.parametrize("torque", [np.zeros(600), np.where(TIME < 0.1, 1.0, 0.0)])
def test_too_little_torque_forbids_a_verdict(torque):
    goal, position = followed()
    given = recording(goal, position, torque_enabled=torque)
    assert "at least 20" in MODEL.excitation(given, SERVO)[-1]
    MODEL.compare(given, SERVO)


def test_what_a_recording_says_of_its_load_counts():
    goal, _ = followed()
    stated = SERVO.changed({"arm.mass": 1.0})
    assert np.array_equal(answer_to(goal, mass=np.full(600, 1.0)), answer_to(goal, stated))


def test_a_servo_that_moves_nothing_is_refused():
    with pytest.raises(Exception, match="neither inertia nor a mass"):
        SERVO.changed({"arm.mass": 0.0, "arm.arm_mass": 0.0})
    with pytest.raises(Exception, match=r"steps.twin must lie between"):
        SERVO.changed({"steps.twin": 0.1})
