"""The ball-screw twin against its slow version in ``tests/naive`` and against closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.errors import InputError, RecordError
from ematwin.models.ball_screw.model import MODEL
from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.ball_screw.twin import (
    LEAST_FRICTION,
    BallScrewState,
    ball_screw_constants,
    ball_screw_step,
    drive_torque,
    falling_friction,
    steps_of,
)
from ematwin.models.sections import GRID
from ematwin.recordings.recording import Recording
from made_up_rig import out_and_back
from naive import ball_screw as naive

ACTUATOR = BallScrew.load()
C = ball_screw_constants(ACTUATOR, {}, 1, 1)
SET_POINT, INTERVAL = out_and_back(ACTUATOR, 0.05, 2.5, 1.0)
HEALTHY = {"friction": 1.0, "backlash": 5e-5, "gain": 1.0, "load": 0.0, "initial_error": 0.0}

CASES = {
    "healthy": {},
    "dry": {"friction": 1.7},
    "no backlash": {"backlash": 0.0},
    "large backlash": {"backlash": 2e-3},
    "pushed": {"load": 400.0},
    "held back": {"load": -400.0},
    "carried by its load": {"load": 2600.0},
    "weak loop": {"gain": 0.6},
    "starts off its place": {"initial_error": -7e-4},
    "all at once": {
        "friction": 1.4, "backlash": 1e-3, "gain": 1.2, "load": -300.0, "initial_error": 3e-4,
    },
}  # fmt: skip


def traces(actuator=ACTUATOR, set_point=SET_POINT, interval=INTERVAL, **changed):
    """Current and position error (S,) of one candidate."""
    columns = {name: np.array([value]) for name, value in {**HEALTHY, **changed}.items()}
    inputs = Recording(np.arange(set_point.size) * interval, {"set_point": set_point})
    found = MODEL.respond(actuator, inputs, columns, 1)
    return found["current"][0], found["position_error"][0]


@pytest.mark.parametrize("changed", CASES.values(), ids=CASES)
def test_the_twin_is_the_naive_version(changed):
    current, error = traces(**changed)
    slow = naive.simulate(ACTUATOR, SET_POINT, INTERVAL, **{**HEALTHY, **changed})
    np.testing.assert_allclose(current, slow[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(error, slow[1], rtol=1e-9, atol=1e-12)


def test_a_loop_slower_or_faster_than_the_recording_is_the_naive_version():
    for sample_time, interval in ((0.02, 0.04), (0.08, 0.04)):
        actuator = ACTUATOR.changed({"controller.sample_time": sample_time})
        current, error = traces(actuator, interval=interval)
        slow = naive.simulate(actuator, SET_POINT, interval, **HEALTHY)
        np.testing.assert_allclose(current, slow[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(error, slow[1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("place", GRID)
def test_what_sets_the_grid_of_steps_cannot_differ(place):
    inputs = Recording(np.arange(SET_POINT.size) * INTERVAL, {"set_point": SET_POINT})
    with pytest.raises(InputError, match=f"{place} cannot be searched"):
        MODEL.respond(ACTUATOR, inputs, {place: np.array([0.01, 0.02])}, 2)


def test_halving_the_step_moves_the_answer_at_first_order():
    answers = []
    for step in (4e-3, 2e-3, 1e-3, 5e-4):
        actuator = ACTUATOR.changed({"steps.twin": step})
        answers.append(np.concatenate([x / np.ptp(x) for x in traces(actuator, load=200.0)]))
    moved = [float(np.sqrt(((b - a) ** 2).mean())) for a, b in pairwise(answers)]
    ratios = [first / second for first, second in pairwise(moved)]
    assert all(1.8 < ratio < 2.2 for ratio in ratios), ratios


def test_the_step_of_the_shipped_set_errs_by_less_than_one_per_cent():
    """As its source says in the parameter file: halving it moves both signals by less."""
    finer = ACTUATOR.changed({"steps.twin": ACTUATOR.steps.twin / 2})
    for coarse, fine in zip(traces(), traces(finer), strict=True):
        assert np.sqrt(((coarse - fine) ** 2).mean()) < 0.01 * np.ptp(fine)


def test_zero_backlash_is_a_rigid_screw():
    """The nut is where the screw is, so that the loop is linear: twice the way, twice the error."""
    _, error = traces(backlash=0.0)
    _, doubled = traces(set_point=2.0 * SET_POINT, backlash=0.0)
    np.testing.assert_allclose(doubled, 2.0 * error, rtol=1e-9, atol=1e-15)
    _, with_play = traces(set_point=2.0 * SET_POINT, backlash=1e-3)
    assert np.abs(with_play - 2.0 * traces(backlash=1e-3)[1]).max() > 1e-4


def test_backlash_is_the_way_of_the_screw_before_the_nut_turns_back():
    c = C._replace(half_gap=0.5e-3 / C.per_radian)
    state, nuts = BallScrewState(*[0.0] * 7), []
    for w in [10.0] * 100 + [-10.0] * 100:
        # the loop holds the speed
        held = state._replace(w=w, w_ref=w, wait=1.0)
        state = ball_screw_step(held, 0.0, 0.0, c, INTERVAL / 10)
        nuts.append(C.per_radian * (state.theta - state.nut))
    assert max(nuts) == pytest.approx(0.5e-3)
    assert min(nuts) == pytest.approx(-0.5e-3)


def test_steady_motion_lags_not_at_all_with_an_integral_and_by_speed_over_gain_without():
    ramp = np.arange(300) * INTERVAL * 0.01  # 10 mm/s
    assert abs(traces(set_point=ramp)[1][-1]) < 1e-6
    proportional = ACTUATOR.changed({"controller.integral_gain": 0.0})
    lag = traces(proportional, set_point=ramp)[1][-1]
    assert lag == pytest.approx(0.01 / ACTUATOR.controller.position_gain, rel=1e-6)


def test_a_standing_actuator_draws_its_idle_current():
    for load in (-500.0, 0.0, 500.0):
        current, error = traces(set_point=np.full(50, 0.02), load=load)
        np.testing.assert_allclose(error, 0.0, atol=1e-15)
        np.testing.assert_allclose(current, ACTUATOR.drive.idle_current, rtol=1e-12)


def test_steady_current_carries_the_mechanical_power():
    speed = 0.015
    current, _ = traces(set_point=np.arange(400) * INTERVAL * speed, load=-300.0)
    screw, drive = ACTUATOR.screw, ACTUATOR.drive
    friction = screw.friction_force * (1.0 - speed / screw.fading_speed)
    force = friction + 300.0 / screw.efficiency_opposing
    expected = drive.idle_current + force * speed / drive.supply_voltage
    assert current[-1] == pytest.approx(expected, rel=1e-6)


speeds = st.floats(1e-3, 200.0) | st.floats(-200.0, -1e-3)
loads = st.floats(-3.0, 3.0)


@given(speeds, loads, st.floats(0.1, 5.0))
def test_force_is_that_of_the_naive_version(w, load, factor):
    seen = drive_torque(w, C._replace(load=load, friction=factor * C.friction))
    force = naive.motor_force(w * C.per_radian, load / C.per_radian, factor, ACTUATOR.screw)
    assert seen == pytest.approx(force * C.per_radian, rel=1e-9, abs=1e-12)


@given(st.floats(0.1, 200.0), st.floats(0.01, 3.0))
def test_load_takes_and_gives_the_shares_of_borello(w, load):
    """Against it the drive needs load/eta_o more, with it eta_a load less, than without any."""
    free = drive_torque(w, C)
    screw = ACTUATOR.screw
    against = drive_torque(w, C._replace(load=-load)) - free
    aided = drive_torque(w, C._replace(load=load)) - free
    assert against == pytest.approx(load / screw.efficiency_opposing)
    assert aided == pytest.approx(-load * screw.efficiency_aiding)


@given(speeds, loads)
def test_turning_way_and_load_round_turns_the_torque_round(w, load):
    assert drive_torque(-w, C._replace(load=-load)) == pytest.approx(
        -drive_torque(w, C._replace(load=load))
    )


@given(st.floats(0.0, 1e4))
def test_friction_falls_with_speed_but_keeps_its_floor(w):
    seen = falling_friction(w, C)
    assert LEAST_FRICTION * C.friction <= seen <= C.friction
    assert seen == falling_friction(-w, C)
    assert falling_friction(w + 1.0, C) <= seen


def test_a_loop_that_runs_away_ends_in_nan_and_not_in_a_crash():
    current, error = traces(gain=1e200)
    assert np.isnan(current[-1])
    assert np.isnan(error[-1])


def test_an_interval_that_is_no_whole_number_of_steps_is_refused():
    assert steps_of(ACTUATOR, 0.04) == (10, 10)
    assert steps_of(ACTUATOR, 0.1) == (10, 25)
    with pytest.raises(RecordError, match=r"not a whole number of steps of 0\.004 s") as caught:
        steps_of(ACTUATOR, 0.0333)
    assert "\n" not in str(caught.value)
