"""Backlash, contact and end stops against closed forms and the slow version in ``tests/naive``."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics import backlash, friction
from naive import mechanics

C = kernel_constants(BldcActuator.load())
J_M, J_O = 1.0 / C.mobility_m, 1.0 / C.mobility_o
DT = 1e-5


def inertias(j_m, j_o):
    """As `advance_rigid_play` takes them."""
    return 1.0 / j_m, 1.0 / j_o, 1.0 / (j_m + j_o), j_o / (j_m + j_o)


# Products of speeds below 1e-150 rad/s underflow; no mass moves so slowly.
speeds = st.floats(1e-6, 500.0) | st.floats(-500.0, -1e-6) | st.just(0.0)
torques = st.floats(-0.5, 0.5)
positions = st.floats(-1.0, 1.0)
shares = st.floats(0.0, 1.0)


@given(positions, positions, st.floats(0.0, 0.5))
def test_play_is_that_of_the_naive_version(motor_angle, output, half_gap):
    assert backlash.play(motor_angle, output, half_gap) == pytest.approx(
        mechanics.play(motor_angle, output, half_gap), abs=1e-15
    )


def test_play_draws_the_closed_hysteresis_loop_of_a_cosine():
    """For theta = A cos(t) the loop is flat for 2 half gaps after each turn, and a slope of 1."""
    amplitude, half_gap = 1.0, 0.3
    t = np.linspace(0.0, 4.0 * math.pi, 40_001)
    theta = amplitude * np.cos(t)
    output, out = amplitude - half_gap, []
    for x in theta:
        output = backlash.play(x, output, half_gap)
        out.append(output)
    phase = t % (2.0 * math.pi)
    falling = np.maximum(-amplitude + half_gap, np.minimum(amplitude - half_gap, theta + half_gap))
    rising = np.minimum(amplitude - half_gap, np.maximum(-amplitude + half_gap, theta - half_gap))
    expected = np.where(phase < math.pi, falling, rising)
    np.testing.assert_allclose(out, expected, atol=1e-6)


@settings(max_examples=400)
@given(positions, speeds, positions, speeds, torques, torques, torques, st.floats(0.0, 0.5), shares)
def test_rigid_contact_is_that_of_the_naive_version(
    x_m, w_m, x_o, w_o, act_m, before, act_o, gap, td
):
    td_m, td_o = 0.03 * td, 0.02
    seen = backlash.advance_rigid_play(
        x_m, w_m, x_o, w_o, act_m, before, act_o, *inertias(2.5e-6, 1e-6),
        2.0 * td_m, td_m, 2.0 * td_o, td_o, gap, DT,
    )  # fmt: skip
    free_m = friction.advance_speed(w_m, act_m, 2.5e-6, 2.0 * td_m, td_m, DT)
    free_o = friction.advance_speed(w_o, act_o, 1e-6, 2.0 * td_o, td_o, DT)
    twist = (x_m - x_o) + 0.5 * DT * (w_m + free_m - w_o - free_o)
    assume(abs(abs(twist) - gap) > 1e-12)  # rounding decides there
    # nobody starts beyond one face of the gap and ends beyond the other within a step
    assume(abs(x_m - x_o) <= gap or twist * (x_m - x_o) > 0.0)
    motor = {"x": x_m, "w": w_m, "act": act_m, "before": before, "j": 2.5e-6}
    output = {"x": x_o, "w": w_o, "act": act_o, "before": act_o, "j": 1e-6}
    frictions = {"ts": 2.0 * td_m, "td": td_m}, {"ts": 2.0 * td_o, "td": td_o}
    expected = mechanics.two_masses_rigid_contact(
        motor | frictions[0], output | frictions[1], gap, DT
    )
    assert seen == pytest.approx(expected, rel=1e-12, abs=1e-9)


@settings(max_examples=300)
@given(st.floats(-0.3, 0.3), speeds, speeds, st.floats(0.01, 0.3))
def test_the_gap_never_opens_beyond_its_width(x_m, w_m, w_o, half_gap):
    assume(abs(x_m) <= half_gap)
    x_m, _, x_o, *_ = backlash.advance_rigid_play(
        x_m, w_m, 0.0, w_o, 0.0, 0.0, 0.0, *inertias(2.5e-6, 1e-6), 0.0, 0.0, 0.0, 0.0, half_gap, DT
    )
    assert abs(x_m - x_o) <= half_gap + 1e-12


@given(speeds, speeds, st.floats(0.0, 0.99))
def test_an_impact_keeps_momentum_and_is_inelastic(w_m, w_o, share):
    assume(w_m - w_o > 1e-3)
    j_m, j_o, half_gap = 2.5e-6, 1e-6, 0.0025
    # the motor is faster and next to the leading face: they meet within this step
    near = half_gap - share * DT * (w_m - w_o)
    assume(near > -half_gap)
    x_m, after_m, x_o, after_o, *_ = backlash.advance_rigid_play(
        near, w_m, 0.0, w_o, 0.0, 0.0, 0.0, *inertias(j_m, j_o), 0.0, 0.0, 0.0, 0.0, half_gap, DT
    )
    assert after_m == after_o
    # each has moved with its own speed until they met, and with the common one since
    assert x_m == pytest.approx(near + DT * (share * w_m + (1.0 - share) * after_m), abs=1e-11)
    assert x_m - x_o == pytest.approx(half_gap, abs=1e-12)
    assert (j_m + j_o) * after_m == pytest.approx(j_m * w_m + j_o * w_o, rel=1e-9, abs=1e-15)
    before = 0.5 * (j_m * w_m**2 + j_o * w_o**2)
    lost = 0.5 * j_m * j_o / (j_m + j_o) * (w_m - w_o) ** 2  # all energy of relative motion
    assert before - 0.5 * (j_m + j_o) * after_m**2 == pytest.approx(lost, rel=1e-6, abs=1e-12)


def test_rigid_contact_with_a_light_output_held_by_friction_is_the_play_operator():
    dt, half_gap = 1e-5, 0.1

    @njit(error_model="numpy")
    def drag(motor_angles, motor_speeds):
        x_o, w_o, y = 0.0, 0.0, 0.0
        worst = 0.0
        for n in range(motor_angles.size - 1):
            # a motor of great inertia: nothing changes its course
            x_m, _, x_o, w_o, _, _, _ = backlash.advance_rigid_play(
                motor_angles[n], motor_speeds[n], x_o, w_o, 0.0, 0.0, 0.0,
                1e-6, 1e6, 1e-6, 1e-12,
                0.0, 0.0, 0.02, 0.01, half_gap, dt,
            )  # fmt: skip
            y = backlash.play(x_m, y, half_gap)
            worst = max(worst, abs(x_o - y))
        return worst

    t = np.arange(0.0, 0.5, dt)
    swept = 6.0 * np.sin(2.0 * math.pi * 10.0 * t) * np.exp(-3.0 * t)
    # The play operator stops its output at once; friction takes J w/T to do so.
    coasting = 0.5 * 1e-6 * np.abs(np.gradient(swept, dt)).max() ** 2 / 0.01
    worst = drag(swept, np.gradient(swept, dt))
    assert worst < 0.05 * half_gap + coasting
    assert worst < 0.2 * np.ptp(swept)


@given(positions, speeds, positions, speeds, st.floats(0.0, 0.5))
def test_contact_pushes_and_never_pulls(x_m, w_m, x_o, w_o, half_gap):
    stiff, damp = C.contact_stiffness, C.contact_damping
    seen = backlash.contact_torque(x_m, w_m, x_o, w_o, half_gap, stiff, damp)
    assert seen == pytest.approx(
        mechanics.contact_torque(x_m, w_m, x_o, w_o, half_gap, stiff, damp), abs=1e-12
    )
    twist = x_m - x_o
    if abs(twist) <= half_gap:
        assert seen == 0.0
    else:
        assert seen * twist >= 0.0


@settings(max_examples=30)
@given(st.floats(1.0, 200.0), st.floats(1e-4, 0.02))
def test_energy_never_grows_in_a_bounce_off_the_contact(w, half_gap):
    """Two free masses meet: kinetic and elastic energy fall from step to step, at 1 us."""
    energies = bounce(w, half_gap, J_M, J_O, C.contact_stiffness, C.contact_damping)
    assert energies[-1] < energies[0]
    # semi-implicit Euler keeps the energy of a spring within omega dt/2 of itself
    assert np.diff(energies).max() <= 0.04 * energies[0]
    # what is left is at least what momentum keeps
    common = J_M * w / (J_M + J_O)
    assert energies[-1] >= 0.5 * (J_M + J_O) * common**2 * (1.0 - 1e-9)


@njit
def bounce(w_m, half_gap, j_m, j_o, stiffness, damping):
    dt, steps = 1e-6, 3000
    x_m, x_o, w_o = half_gap - 1e-5, 0.0, 0.0
    energies = np.empty(steps)
    for n in range(steps):
        torque = backlash.contact_torque(x_m, w_m, x_o, w_o, half_gap, stiffness, damping)
        w_m -= dt * torque / j_m
        w_o += dt * torque / j_o
        x_m += dt * w_m
        x_o += dt * w_o
        bent = max(abs(x_m - x_o) - half_gap, 0.0)
        energies[n] = 0.5 * (j_m * w_m**2 + j_o * w_o**2 + stiffness * bent**2)
    return energies
