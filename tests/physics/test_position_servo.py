"""The position servo against what is known without simulating it, and against its naive twin."""

import math

import numpy as np
import pytest

from ematwin.models.position_servo.model import MODEL
from ematwin.models.position_servo.parameters import PositionServo
from ematwin.recordings.recording import Recording
from naive.position_servo import GRAVITY, position

SERVO = PositionServo.load()
FREE = SERVO.changed({"gear.backlash": 1e-9})
LOAD = (0.9, 0.12, 0.04)  # kg, m, kg


def moved(goal, servo=FREE, load=LOAD, enabled=None, **faults):
    """Time and position of the twin under goals (S,) from rest at the first of them."""
    time = np.arange(len(goal)) * 0.01
    given = {
        name: np.full(len(goal), x)
        for name, x in zip(("mass", "length", "arm_mass"), load, strict=True)
    }
    inputs = Recording(time, {"goal_position": goal, **given}).changed(torque_enabled=enabled)
    one = {name: np.array([value]) for name, value in faults.items()}
    return time, MODEL.respond(servo, inputs, one, 1)["position"][0]


def swing():
    time = np.arange(400) * 0.01
    return 0.6 * np.sin(2.0 * np.pi * 0.5 * time) + 0.3 * np.sin(2.0 * np.pi * 1.3 * time)


@pytest.mark.parametrize(
    "faults",
    [{}, {"gain": 0.4}, {"friction": 2.0}, {"torque": 0.7}, {"payload": 1.5}, {"delay": 2.0}],
)
def test_twin_agrees_with_its_naive_twin(faults):
    time, twin = moved(swing(), **faults)
    known = {place: value for place, value, *_ in FREE.parameters()}
    naive = position(known, faults, time, swing(), LOAD)
    assert np.sqrt(np.mean((twin - naive) ** 2)) < 2e-3 < 0.01 * np.ptp(naive)


def test_halving_the_step_changes_little():
    _, usual = moved(swing())
    _, half = moved(swing(), FREE.changed({"steps.twin": 0.0025}))
    _, fine = moved(swing(), FREE.changed({"steps.twin": 0.0003}))
    assert np.abs(half - fine).mean() < np.abs(usual - fine).mean() < 1e-3


@pytest.mark.parametrize("saturation", [1e3, 1.0])
def test_arm_that_is_held_hangs_by_load_over_stiffness(saturation):
    """It sags until the linear torque gives its load, T/sqrt(1 - (T/T_sat)^2)."""
    quiet = FREE.changed({
        "friction.coulomb": 1e-6, "friction.stribeck": 1e-6, "friction.load_share": 1e-6,
        "friction.static_share": 1e-6,
        "controller.startup": 1e-9, "motor.saturation_torque": saturation,
    })  # fmt: skip
    _, held = moved(np.full(600, 0.5), quiet)
    mass, length, arm = LOAD
    torque = (mass + arm / 2.0) * GRAVITY * length * math.sin(held[-1])
    linear = torque / math.sqrt(1.0 - (torque / saturation) ** 2)
    sag = linear / (quiet.controller.gain * quiet.motor.stall_torque)
    assert torque > 0.4
    assert 0.5 - held[-1] == pytest.approx(sag, rel=1e-3)


def test_speed_is_limited_by_the_target_and_by_the_back_emf():
    goal = np.r_[np.zeros(10), np.full(40, 3.0)]
    light = (0.01, 0.05, 0.001)
    _, slow = moved(goal, FREE.changed({"controller.speed_limit": 2.0}), load=light)
    assert np.gradient(slow, 0.01).max() == pytest.approx(2.0, rel=0.02)
    weak = FREE.changed({"controller.speed_limit": 50.0, "motor.no_load_speed": 3.0})
    _, full = moved(goal, weak, load=light)
    assert 0.85 * 3.0 < np.gradient(full, 0.01).max() < 3.0


def test_goal_takes_effect_after_its_delay():
    goal = np.r_[np.zeros(50), np.full(50, 1.0)]
    late = FREE.changed({"controller.delay": 0.1})
    time, position_of = moved(goal, late)
    first = time[np.flatnonzero(np.abs(position_of) > 1e-4)[0]]
    assert 0.49 + 0.1 <= first <= 0.49 + 0.1 + 0.03


def test_friction_holds_a_small_load_after_release():
    released = np.where(np.arange(300) < 100, 1.0, 0.0)
    _, held = moved(np.full(300, 1.0), load=(0.02, 0.05, 0.001), enabled=released)
    assert held[-1] == pytest.approx(held[99], abs=1e-6)


@pytest.mark.parametrize("gap", [1e-9, 0.05])
def test_released_pendulum_never_gains_energy(gap):
    """It falls from 2 rad; friction and impacts in the play take energy, and nothing gives any."""
    servo = SERVO.changed(
        {"gear.backlash": gap, "friction.coulomb": 0.01, "friction.stribeck": 0.01}
    )
    _, theta = moved(np.full(400, 2.0), servo, load=(0.9, 0.2, 0.04), enabled=np.zeros(400))
    heights = 1.0 - np.cos(theta)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta))) != 0) + 1
    assert heights.max() <= heights[0] + 1e-9
    assert np.all(np.diff(heights[turns]) < 1e-3)
    assert abs(theta[-1]) < 1.0


def test_arm_falls_through_the_play_where_its_load_changes_side():
    """Below the axis the arm pulls one way, beyond it the other: the output lags, then leads."""
    servo = SERVO.changed({"friction.coulomb": 1e-3, "friction.stribeck": 1e-3})
    goal = np.linspace(-0.4, 0.4, 800)
    _, tight = moved(goal, servo.changed({"gear.backlash": 1e-9}))
    _, loose = moved(goal, servo, backlash=10.0)
    assert np.abs(loose - tight).max() > 0.2 * servo.gear.backlash * 10.0
    # the encoder sits on the output: where the load keeps to one side the loop hides the play
    assert abs(loose[-1] - tight[-1]) < 2e-3


def test_false_reads_of_the_supply_do_not_reach_the_twin():
    goal = swing()
    time, true = moved(goal)
    voltage = np.full(len(goal), 12.0)
    false = voltage.copy()
    false[[50, 200]] = 0.0, 24.7
    found = []
    for supply in (voltage, false):
        run = Recording(time, {"goal_position": goal, "position": true, "supply_voltage": supply})
        found.append(MODEL.compare(run, FREE).responses({}, 1)["position"])
    assert np.array_equal(*found)
    assert any("supply voltage is false in 2 samples" in text for text in MODEL.check(run, FREE))


def test_gain_that_acts_on_older_positions_damps_less():
    step = np.r_[np.zeros(5), np.full(300, 0.3)]
    overshoot = [
        np.ptp(moved(step, FREE.changed({"controller.interval": late}), gain=2.5)[1])
        for late in (0.0, 0.008, 0.016)
    ]
    assert overshoot[0] < overshoot[1] < overshoot[2]
