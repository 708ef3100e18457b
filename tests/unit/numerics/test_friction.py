"""Dry friction against closed forms and the slow version in ``tests/naive``."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics import friction
from naive import mechanics

ACTUATOR = BldcActuator.load()
C = kernel_constants(ACTUATOR)
INERTIA, DT = 2.5e-6, 1e-5

# Products of speeds below 1e-150 rad/s underflow; no mass moves so slowly.
speeds = st.floats(1e-6, 500.0) | st.floats(-500.0, -1e-6) | st.just(0.0)
torques = st.floats(-0.5, 0.5)


@given(speeds, torques, st.floats(0.0, 0.2), st.floats(1.0, 3.0))
def test_friction_is_that_of_the_naive_version(w, act, dynamic, ratio):
    static = ratio * dynamic
    assert friction.friction_torque(w, act, static, dynamic) == mechanics.friction_torque(
        w, act, static, dynamic
    )
    assert friction.advance_speed(w, act, INERTIA, static, dynamic, DT) == pytest.approx(
        mechanics.next_speed(w, act, INERTIA, static, dynamic, DT), rel=1e-12, abs=1e-12
    )


@given(speeds, torques, st.floats(0.0, 0.2))
def test_friction_never_adds_energy(w, act, dynamic):
    """It opposes motion, and a step never ends faster than it would without friction."""
    after = friction.advance_speed(w, act, INERTIA, 2.0 * dynamic, dynamic, DT)
    assert friction.friction_torque(w, act, 2.0 * dynamic, dynamic) * w >= 0.0
    assert abs(after) <= abs(w + DT * act / INERTIA) * (1.0 + 1e-12)


def test_coasting_ends_after_the_time_and_way_of_the_closed_form():
    """J dw/dt = -T: rest after J w0/T, on a way of J w0^2/(2 T)."""
    w0, dynamic, dt = 50.0, 0.03, 1e-6

    @njit
    def coast(w):
        way, steps = 0.0, 0
        while w != 0.0:
            w = friction.advance_speed(w, 0.0, INERTIA, 0.06, 0.03, dt)
            way += dt * w
            steps += 1
        return way, steps * dt

    way, time = coast(w0)
    assert time == pytest.approx(INERTIA * w0 / dynamic, abs=2.0 * dt)
    assert way == pytest.approx(INERTIA * w0**2 / (2.0 * dynamic), rel=1e-3)


@given(st.floats(-100.0, 100.0), torques)
def test_load_adds_to_friction_by_whether_it_opposes_or_aids(direction, load):
    seen = friction.loaded_friction(direction, load, C.t_o, C.c_opposing, C.c_aiding)
    gear = ACTUATOR.transmission
    assert seen == pytest.approx(
        mechanics.loaded_dynamic_torque(
            direction, load, C.t_o, gear.efficiency_opposing, gear.efficiency_aiding
        )
    )


# Through rest


def through_rest(w, act, before, static, dynamic, dt=DT):
    mobility = 1.0 / INERTIA
    found, _, _ = friction.advance_through_rest(
        w, act, mobility, dynamic, act, before, mobility, static, dynamic, dt
    )
    return found


@settings(max_examples=400)
@given(speeds, torques, torques, st.floats(0.0, 1.0))
def test_a_step_through_rest_is_that_of_the_naive_version(w, act, before, share):
    dynamic = 0.03 * share
    assume(act != before)
    body = {"act": act, "before": before, "j": INERTIA, "ts": 2.0 * dynamic, "td": dynamic}
    expected, _, _ = mechanics.next_speed_through_rest(w, body, DT)
    assert through_rest(w, act, before, 2.0 * dynamic, dynamic) == pytest.approx(
        expected, rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_mass_that_reverses_loses_no_part_of_its_step(way):
    """Exactly where it would be after small steps: uniform deceleration, then the other way."""
    act, static, dynamic, w = -0.2 * way, 0.06, 0.03, 0.4 * way
    small = w
    for _ in range(1000):
        small = through_rest(small, act, act, static, dynamic, DT / 1000.0)
    whole = through_rest(w, act, act, static, dynamic)
    assert whole * way < 0.0
    assert whole == pytest.approx(small, rel=1e-9)
    # the plain step throws away what is left after the stop
    assert friction.advance_speed(w, act, INERTIA, static, dynamic, DT) == 0.0


def test_a_mass_that_breaks_loose_within_a_step_moves_as_in_small_steps():
    """A torque that grows evenly; for any place of the instant within the step."""
    static, dynamic, slope = 0.06, 0.03, 400.0  # N m, N m, N m/s
    for start in np.linspace(0.045, 0.0585, 7):

        def torque(t, start=start):
            return start + slope * t

        def speed(steps, torque=torque):
            dt = 5.0 * DT / steps
            w = 0.0
            for n in range(steps):
                middle = (n + 0.5) * dt
                w = through_rest(w, torque(middle), torque(middle - dt), static, dynamic, dt)
            return w

        exact = speed(50_000)
        assert speed(5) == pytest.approx(exact, rel=0.03, abs=1e-3)
