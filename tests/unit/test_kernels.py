"""The kernels against closed forms and against the slow versions in ``tests/naive``."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from ematwin.faults import HEALTHY, PAPER_CASES, Faults
from ematwin.kernels import backlash, batch, controller, friction, inverter, motor, scalar, state
from ematwin.kernels.monitor_step import equivalent_phase
from ematwin.kernels.reference_step import advance_bridge, emf_constants
from ematwin.plant.constants import kernel_constants
from ematwin.plant.parameters import Actuator
from ematwin.signals.filters import LowPass
from ematwin.signals.misfit import SlopeWeighting
from naive import mechanics
from naive import monitor as naive_monitor
from naive import motor as naive_motor
from naive import reference as naive_reference
from naive import signals as naive_signals

ACTUATOR = Actuator.load()
C = kernel_constants(ACTUATOR)
SEVERE = {
    "friction": 0.6, "backlash": 0.3, "short_a": 0.4, "short_b": 0.1, "short_c": 0.7,
    "eccentricity": 0.6, "eccentricity_phase": 0.8, "gain": 0.9,
}  # fmt: skip

# Products of speeds below 1e-150 rad/s underflow; no mass moves so slowly.
speeds = st.floats(1e-6, 500.0) | st.floats(-500.0, -1e-6) | st.just(0.0)
torques = st.floats(-0.5, 0.5)
positions = st.floats(-1.0, 1.0)
shares = st.floats(0.0, 1.0)
angles = st.floats(-1e4, 1e4)
INERTIA, DT = 2.5e-6, 1e-5


def fault(**values):
    return state.fault_state(*Faults(**values).vector, C.half_gap)


# Scalar functions


def test_sine_and_cosine_err_by_less_than_1e_12_within_a_thousand_turns():
    @njit
    def largest_error(turns, count):
        worst = 0.0
        for n in range(count):
            x = 2.0 * math.pi * turns * (2.0 * n / count - 1.0)
            s, c = scalar.sincos(x)
            worst = max(worst, abs(s - math.sin(x)), abs(c - math.cos(x)))
        return worst

    assert largest_error(1e3, 2_000_003) < 1e-12
    # far beyond the travel of an actuator the error stays that of the angle's own rounding
    assert largest_error(1e5, 2_000_003) < 1e-10


@given(st.integers(-40_000, 40_000))
def test_sine_and_cosine_are_right_at_and_beside_every_eighth_of_a_turn(eighths):
    for x in np.nextafter(eighths * math.pi / 4.0, [-np.inf, 0.0, np.inf]):
        assert scalar.sincos(x) == pytest.approx((math.sin(x), math.cos(x)), abs=1e-11)


@given(st.floats(), st.floats(-1e3, 1e3), st.floats(0.0, 1e3))
def test_clip_limits_and_lets_nan_through(x, low, width):
    clipped = scalar.clip(x, low, low + width)
    if math.isnan(x):
        assert math.isnan(clipped)
    else:
        assert clipped == min(max(x, low), low + width)


# Friction


@given(speeds, torques, st.floats(0.0, 0.2), st.floats(1.0, 3.0))
def test_friction_is_that_of_the_naive_version(w, act, dynamic, ratio):
    static = ratio * dynamic
    assert friction.friction_torque(w, act, static, dynamic) == mechanics.friction_torque(
        w, act, static, dynamic
    )
    assert friction.advance_speed(w, act, INERTIA, static, dynamic, DT) == pytest.approx(
        mechanics.next_speed(w, act, INERTIA, static, dynamic, DT), rel=1e-12, abs=1e-12
    )


@given(st.floats(-0.0599, 0.0599))
def test_a_mass_at_rest_sticks_up_to_the_static_torque(act):
    assert friction.advance_speed(0.0, act, INERTIA, 0.06, 0.03, DT) == 0.0


@given(st.floats(0.0601, 1.0), st.sampled_from([-1.0, 1.0]))
def test_beyond_the_static_torque_a_mass_breaks_loose(act, way):
    w = friction.advance_speed(0.0, way * act, INERTIA, 0.06, 0.03, DT)
    assert w == pytest.approx(way * (act - 0.06) * DT / INERTIA, rel=1e-9, abs=1e-12)
    assert w * way > 0.0


@given(speeds, st.floats(-0.03, 0.03))
def test_a_step_that_would_reverse_ends_at_exactly_zero(w, act):
    after = friction.advance_speed(w, act, INERTIA, 0.06, 0.03, DT)
    assert after * w >= 0.0
    if abs(w) * INERTIA < (0.03 - abs(act)) * DT:
        assert after == 0.0


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


def test_opposing_load_takes_the_torque_that_its_efficiency_says():
    """Against a load the drive needs T_load/eta_o; an aiding load gives back eta_a T_load."""
    gear = ACTUATOR.transmission
    load = 0.1
    opposing = friction.loaded_friction(1.0, -load, 0.0, C.c_opposing, C.c_aiding)
    aiding = friction.loaded_friction(1.0, load, 0.0, C.c_opposing, C.c_aiding)
    assert load + opposing == pytest.approx(load / gear.efficiency_opposing)
    assert load - aiding == pytest.approx(load * gear.efficiency_aiding)


@given(st.floats(0.0, 0.2), st.floats(1.0, 3.0), st.floats(0.0, 0.2))
def test_ripple_lowers_the_static_torque_but_never_below_the_dynamic(dynamic, ratio, ripple):
    static = ratio * dynamic
    lowered = friction.dithered_static(static, dynamic, ripple)
    assert lowered == max(dynamic, static - ripple)
    assert dynamic <= lowered <= static


# Backlash, contact, end stops


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
@given(positions, speeds, positions, speeds, torques, torques, st.floats(0.0, 0.5), shares)
def test_rigid_contact_is_that_of_the_naive_version(x_m, w_m, x_o, w_o, act_m, act_o, gap, td):
    td_m, td_o = 0.03 * td, 0.02
    seen = backlash.advance_rigid_play(
        x_m, w_m, x_o, w_o, act_m, act_o, 2.5e-6, 1e-6, 2.0 * td_m, td_m, 2.0 * td_o, td_o, gap, DT
    )
    twist = (x_m - x_o) + DT * (
        friction.advance_speed(w_m, act_m, 2.5e-6, 2.0 * td_m, td_m, DT)
        - friction.advance_speed(w_o, act_o, 1e-6, 2.0 * td_o, td_o, DT)
    )
    assume(abs(abs(twist) - gap) > 1e-12)  # rounding decides there
    expected = mechanics.two_masses_rigid_contact(
        {"x": x_m, "w": w_m, "act": act_m, "j": 2.5e-6, "ts": 2.0 * td_m, "td": td_m},
        {"x": x_o, "w": w_o, "act": act_o, "j": 1e-6, "ts": 2.0 * td_o, "td": td_o},
        gap,
        DT,
    )
    assert seen == pytest.approx(expected, rel=1e-12, abs=1e-9)


@settings(max_examples=300)
@given(st.floats(-0.3, 0.3), speeds, speeds, st.floats(0.01, 0.3))
def test_the_gap_never_opens_beyond_its_width(x_m, w_m, w_o, half_gap):
    assume(abs(x_m) <= half_gap)
    x_m, _, x_o, _ = backlash.advance_rigid_play(
        x_m, w_m, 0.0, w_o, 0.0, 0.0, 2.5e-6, 1e-6, 0.0, 0.0, 0.0, 0.0, half_gap, DT
    )
    assert abs(x_m - x_o) <= half_gap + 1e-12


@given(speeds, speeds)
def test_an_impact_keeps_momentum_and_is_inelastic(w_m, w_o):
    assume(w_m - w_o > 1e-3)
    j_m, j_o, half_gap = 2.5e-6, 1e-6, 0.0025
    # the motor lies on the leading face and is faster: they meet in this step
    _, after_m, _, after_o = backlash.advance_rigid_play(
        half_gap, w_m, 0.0, w_o, 0.0, 0.0, j_m, j_o, 0.0, 0.0, 0.0, 0.0, half_gap, DT
    )
    assert after_m == after_o
    assert (j_m + j_o) * after_m == pytest.approx(j_m * w_m + j_o * w_o, rel=1e-9, abs=1e-15)
    before = 0.5 * (j_m * w_m**2 + j_o * w_o**2)
    lost = 0.5 * j_m * j_o / (j_m + j_o) * (w_m - w_o) ** 2  # all energy of relative motion
    assert before - 0.5 * (j_m + j_o) * after_m**2 == pytest.approx(lost, rel=1e-6, abs=1e-12)


def test_rigid_contact_with_a_light_output_held_by_friction_is_the_play_operator():
    dt, half_gap = 1e-5, 0.1

    @njit
    def drag(motor_angles, motor_speeds):
        x_o, w_o, y = 0.0, 0.0, 0.0
        worst = 0.0
        for n in range(motor_angles.size - 1):
            # a motor of great inertia: nothing changes its course
            x_m, _, x_o, w_o = backlash.advance_rigid_play(
                motor_angles[n], motor_speeds[n], x_o, w_o, 0.0, 0.0, 1e6, 1e-6,
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


def test_static_load_deflects_the_contact_by_gap_and_spring():
    torque, half_gap = 0.06, 0.0025
    twist = half_gap + torque / C.contact_stiffness
    for way in (1.0, -1.0):
        seen = backlash.contact_torque(
            way * twist, 0.0, 0.0, 0.0, half_gap, C.contact_stiffness, C.contact_damping
        )
        assert seen == pytest.approx(way * torque)


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
    energies = bounce(w, half_gap, C.j_m, C.j_o, C.contact_stiffness, C.contact_damping)
    assert energies[-1] < energies[0]
    # semi-implicit Euler keeps the energy of a spring within omega dt/2 of itself
    assert np.diff(energies).max() <= 0.04 * energies[0]
    # what is left is at least what momentum keeps
    common = C.j_m * w / (C.j_m + C.j_o)
    assert energies[-1] >= 0.5 * (C.j_m + C.j_o) * common**2 * (1.0 - 1e-9)


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


@given(positions, speeds, st.floats(0.0, 0.5))
def test_end_stop_is_inelastic_and_lets_go(x, w, reach):
    low, high = -reach - 0.01, reach + 0.01
    seen = backlash.stop_at_ends(x, w, low, high)
    assert seen == mechanics.end_stop(x, w, low, high)
    assert low <= seen[0] <= high


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_motor_is_stopped_half_a_gap_beyond_the_end_stop_of_the_output(way):
    backlash_share = 0.2
    k = Faults(backlash=backlash_share).vector
    half_gap = C.half_gap * (1.0 + 99.0 * backlash_share)
    end = C.travel_high if way > 0.0 else C.travel_low
    command = np.full(80_001, 2.0 * end)
    trace = batch.monitor_trace(k, command, np.zeros_like(command), np.zeros(5), C, 1e-5, 1, 100)
    assert trace[-1, 3] == end
    assert trace[-1, 1] == pytest.approx(end + way * half_gap, rel=1e-12)
    assert trace[-1, 2] == 0.0
    assert trace[-1, 4] == 0.0
    assert trace[-1, 0] == pytest.approx(way * C.v_supply / (2.0 * C.resistance), rel=1e-2)
    assert np.abs(trace[:, 3]).max() <= abs(end)


def test_reference_output_rests_on_its_end_stop_while_the_motor_pushes():
    command = np.full(80_001, 2.0 * C.travel_high)
    rest = np.zeros(11)
    rest[7] = 1.0
    trace = batch.reference_trace(HEALTHY, command, 0.0 * command, rest, C, 1e-6, 10, 100)
    assert trace[-1, 5] == C.travel_high
    assert trace[-1, 6] == 0.0
    # the motor stands where its torque bends the contact
    pushing = trace[-1, 3] - C.travel_high - C.half_gap
    torque = 2.0 * C.k_e * C.v_supply / (2.0 * C.resistance)
    assert pushing == pytest.approx(torque / C.contact_stiffness, rel=0.05)


# Commutation, motor, controller


@given(angles)
def test_trapezoid_is_that_of_the_naive_version(theta):
    assert motor.trapezoid(theta) == pytest.approx(naive_motor.trapezoid(theta), abs=1e-9)


@given(angles)
def test_trapezoid_is_a_clipped_triangle_odd_and_a_sixth_turn_periodic(theta):
    f = motor.trapezoid(theta)
    triangle = 6.0 / math.pi * math.asin(math.sin(theta))
    assert f == pytest.approx(max(-1.0, min(1.0, triangle)), abs=1e-7)
    assert motor.trapezoid(-theta) == pytest.approx(-f, abs=1e-9)
    assert motor.trapezoid(theta + math.pi) == pytest.approx(-f, abs=1e-9)


def test_sectors_are_six_of_sixty_degrees_from_thirty_on():
    for degrees in range(-720, 1081):
        expected = ((degrees - 30) % 360) // 60
        if (degrees - 30) % 60 == 0:
            continue  # rounding decides on the boundary itself
        assert motor.hall_sector(math.radians(degrees)) == expected
        assert naive_motor.sector(math.radians(degrees)) == expected


@given(angles)
def test_commutation_drives_the_two_legs_whose_back_emf_is_on_its_flats(theta):
    assume(abs((theta / (math.pi / 3.0) - 0.5) - round(theta / (math.pi / 3.0) - 0.5)) > 1e-6)
    sector = motor.hall_sector(theta)
    for sign in (1.0, -1.0):
        gates = inverter.gate_signals(sector, sign)
        assert list(gates) == naive_motor.gates(naive_motor.sector(theta), sign)
        assert sorted(gates) == [-1.0, 0.0, 1.0]
        for leg, gate in enumerate(gates):
            shape = motor.trapezoid(theta - leg * 2.0 * math.pi / 3.0)
            if gate:
                assert shape * gate * sign == 1.0
            else:
                assert abs(shape) < 1.0


@given(angles, shares, shares, shares, shares, shares)
def test_emf_constants_are_those_of_the_naive_version(theta, a, b, c, zeta, phase):
    values = dict(short_a=a, short_b=b, short_c=c, eccentricity=zeta, eccentricity_phase=phase)
    seen = emf_constants(theta, fault(**values), C)
    expected = naive_motor.kappa(theta, Faults(**values), ACTUATOR)
    assert seen == pytest.approx(expected, abs=1e-9)


@given(angles, shares, shares, shares, shares, shares)
def test_equivalent_phase_is_the_two_conducting_phases_in_series(theta, a, b, c, zeta, phase):
    values = dict(short_a=a, short_b=b, short_c=c, eccentricity=zeta, eccentricity_phase=phase)
    turns = C.pole_pairs * theta / (math.pi / 3.0) - 0.5
    assume(abs(turns - round(turns)) > 1e-6)
    seen = equivalent_phase(theta, fault(**values), C)
    expected = naive_monitor.equivalent_phase(theta, Faults(**values), ACTUATOR)
    assert seen == pytest.approx(expected, abs=1e-9)


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), speeds, shares)
def test_controller_is_that_of_the_naive_version(command, output, w, gain):
    seen = controller.current_reference(
        command, output, w, C.k_position * (0.5 + gain), C.k_speed, C.w_max, 2.0 * C.k_e, C.i_max
    )
    expected = naive_motor.current_reference(command, output, w, Faults(gain=gain), ACTUATOR)
    assert seen == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.sampled_from([-1.0, 1.0]))
def test_comparator_keeps_its_sign_within_the_band(i, i_ref, last):
    sign = inverter.hysteresis(i, i_ref, 0.25, last)
    if i > i_ref + 0.25:
        assert sign == -1.0
    elif i < i_ref - 0.25:
        assert sign == 1.0
    else:
        assert sign == last


@given(st.integers(0, 5), st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_regulator_sees_the_largest_phase_current_with_the_sign_of_its_pair(sector, i_a, i_b):
    i = (i_a, i_b, -i_a - i_b)
    seen = inverter.pair_current(float(sector), *i)
    assert abs(seen) == pytest.approx(max(abs(x) for x in i))
    first, second = naive_motor.PAIRS[sector]
    if abs(i[first] - i[second]) > 1e-9:
        assert seen * (i[first] - i[second]) >= 0.0


@settings(max_examples=300)
@given(
    st.integers(0, 5), st.sampled_from([-1.0, 1.0]),
    st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), st.booleans(),
    st.tuples(*[st.floats(-60.0, 60.0)] * 3), st.tuples(*[st.floats(0.05, 1.0)] * 3),
)  # fmt: skip
def test_bridge_voltages_are_those_of_a_linear_system(sector, sign, i, idle, emf, h):
    """Star point and conducting legs against a matrix solution; slopes add up to zero."""
    gates = naive_motor.gates(sector, sign)
    off = gates.index(0)
    currents = [i[0], i[1], -i[0] - i[1]]
    if idle:  # the off leg carries nothing
        driven = [k for k in range(3) if k != off]
        currents[off], currents[driven[0]], currents[driven[1]] = 0.0, i[0], -i[0]
    resistances = [x * C.resistance for x in h]
    inductances = [motor.phase_inductance(x, C.inductance, C.leakage) for x in h]
    expected = naive_reference.leg_voltages(
        gates, currents, emf, resistances, inductances, ACTUATOR.drive
    )
    slopes, star = naive_reference.slopes(expected, currents, emf, resistances, inductances)
    seen = inverter.terminal_voltages(
        *(float(g) for g in gates), *currents, *emf, *resistances,
        *(1.0 / x for x in inductances), C.v_supply, C.v_diode,
    )  # fmt: skip
    if idle:
        margin = star + emf[off]
        assume(abs(margin + C.v_diode) > 1e-6)
        assume(abs(margin - C.v_supply - C.v_diode) > 1e-6)
    for leg in range(3):
        assert bool(seen[4 + leg]) == (expected[leg] is not None)
        if expected[leg] is not None:
            assert seen[leg] == expected[leg]
    assert seen[3] == pytest.approx(star, abs=1e-7)
    assert sum(slopes) == pytest.approx(0.0, abs=1e-6)


def test_current_of_an_off_leg_runs_out_and_stays_zero():
    """After commutation, without back-EMF, the off leg decays through its diode and is done."""

    @njit
    def freewheel(c):
        trace = np.empty((400, 3))
        i_a, i_b, i_c = 5.0, -5.0, 0.0
        r, y = c.resistance, 1.0 / c.inductance
        for n in range(400):  # a has gone off; c is driven high, b low
            i_a, i_b, i_c, _, _, _, _, _ = advance_bridge(
                i_a, i_b, i_c, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, (r, r, r, y, y, y), c, 1e-6
            )
            trace[n] = i_a, i_b, i_c
        return trace

    currents = freewheel(C)
    ended = int(np.argmax(currents[:, 0] == 0.0))
    # the three slopes add up to zero: v_n = (V - 0.8 V)/3, and L di/dt = -0.8 V - v_n - R i
    drive = C.v_diode + (C.v_supply - C.v_diode) / 3.0
    expected = C.inductance / C.resistance * math.log1p(5.0 * C.resistance / drive)
    assert (ended + 1) * 1e-6 == pytest.approx(expected, abs=3e-6)
    assert (np.diff(currents[:ended, 0]) < 0.0).all()
    assert (currents[ended:, 0] == 0.0).all()
    np.testing.assert_allclose(currents.sum(axis=1), 0.0, atol=1e-12)


# Whole models, step by step against plain Python


def history(steps, dt):
    """A command (rad) and load (N m) on the motor shaft that cross the gap and turn the motor."""
    t = dt * np.arange(steps + 1)
    command = 12.0 * np.sin(2.0 * math.pi * 40.0 * t) + 5.0 * (t > 0.3 * t[-1])
    return command, np.where(t > 0.5 * t[-1], 0.05, -0.02)


@pytest.mark.parametrize("values", [{}, SEVERE], ids=["healthy", "all faults"])
def test_reference_model_is_that_of_the_naive_loop(values):
    faults, dt, steps = Faults(**values), 1e-6, 12_000
    command, load = history(steps, dt)
    rest = np.zeros(11)
    rest[7] = 1.0
    trace = batch.reference_trace(faults.vector, command, load, rest, C, dt, 1, 1)
    slow = naive_reference.simulate(ACTUATOR, faults, command[:-1], load[:-1], dt)
    assert np.ptp(slow["motor"]) > 2.0  # more than one electrical sector
    np.testing.assert_allclose(trace[:, :3], slow["mean_currents"], rtol=0.0, atol=1e-9)
    for column, name in enumerate(("motor", "motor_speed", "output", "output_speed"), start=3):
        np.testing.assert_allclose(trace[:, column], slow[name], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("values", [{}, SEVERE, *PAPER_CASES.values()])
def test_monitor_model_is_that_of_the_naive_loop(values):
    faults, dt, steps = Faults(**values), 1e-5, 4_000
    command, load = history(steps, dt)
    trace = batch.monitor_trace(faults.vector, command, load, np.zeros(5), C, dt, 1, 1)
    slow = naive_monitor.simulate(ACTUATOR, faults, command[:-1], load[:-1], dt)
    assert np.ptp(slow["motor"]) > 2.0
    names = ("mean_current", "motor", "motor_speed", "output", "output_speed")
    for column, name in enumerate(names):
        np.testing.assert_allclose(trace[:, column], slow[name], rtol=0.0, atol=1e-9)


# Scoring in lanes

RATE, SUBSTEPS, SAMPLES = 20_000.0, 5, 1_201


def scoring(k, rectify=True, keep=True, target=None):
    """Costs, statuses, responses and the target of a batch, with weights of the misfit."""
    command, load = history(SAMPLES - 1, 1.0 / RATE)
    t = np.arange(SAMPLES) / RATE
    target = 2.0 + np.sin(2.0 * math.pi * 80.0 * t) if target is None else target
    weights = SlopeWeighting(500.0).weights(target, 1.0 / RATE)
    low_pass = LowPass(500.0)
    costs = np.empty(len(k))
    status = np.empty(len(k), dtype=np.int64)
    response = np.empty((len(k), SAMPLES) if keep else (0, 0))
    batch.monitor_scores(
        k, command, load, np.zeros(5), C, 1.0 / (RATE * SUBSTEPS), SUBSTEPS,
        low_pass.taps(RATE, float(target[0])), rectify, target, weights, costs, status, response,
    )  # fmt: skip
    return costs, status, response, target


def random_faults(count, seed=1):
    k = np.random.default_rng(seed).random((count, 8))
    k[0], k[1], k[2] = HEALTHY, 1.0, 0.0
    return k


@pytest.mark.parametrize("rectify", [True, False])
def test_scores_are_trace_then_filter_then_misfit(rectify):
    k = random_faults(batch.LANES)
    costs, status, response, target = scoring(k, rectify)
    command, load = history(SAMPLES - 1, 1.0 / RATE)
    assert (status == batch.OK).all()
    for n in range(batch.LANES):
        trace = batch.monitor_trace(
            k[n], command, load, np.zeros(5), C, 1.0 / (RATE * SUBSTEPS), SUBSTEPS, 1
        )
        current = np.abs(trace[:, 0]) if rectify else trace[:, 0]
        filtered = naive_signals.low_pass([target[0], *current], 500.0, RATE)
        np.testing.assert_allclose(response[n], filtered, rtol=0.0, atol=1e-7)
        expected = naive_signals.misfit(target, filtered, 1.0 / RATE, 500.0)
        assert costs[n] == pytest.approx(expected, rel=1e-7)


def test_a_cost_does_not_depend_on_the_place_in_the_batch():
    k = random_faults(3 * batch.LANES)
    costs, _, response, _ = scoring(k)
    order = np.random.default_rng(2).permutation(len(k))
    moved_costs, _, moved_response, _ = scoring(k[order])
    np.testing.assert_array_equal(moved_costs, costs[order])
    np.testing.assert_array_equal(moved_response, response[order])


def test_costs_are_the_same_whether_or_not_responses_are_kept():
    k = random_faults(batch.LANES)
    np.testing.assert_array_equal(scoring(k, keep=True)[0], scoring(k, keep=False)[0])


def test_a_diverged_candidate_is_a_status_and_costs_infinity_and_spoils_no_other():
    k = random_faults(2 * batch.LANES)
    clean = scoring(k)[0]
    sick = k.copy()
    sick[5, 0], sick[40, 5], sick[41] = np.nan, np.inf, np.nan
    costs, status, _, _ = scoring(sick)
    bad = np.isin(np.arange(len(k)), [5, 40, 41])
    assert (status[bad] == batch.DIVERGED).all()
    assert np.isposinf(costs[bad]).all()
    assert (status[~bad] == batch.OK).all()
    np.testing.assert_array_equal(costs[~bad], clean[~bad])


def test_a_candidate_scored_against_its_own_response_costs_nothing():
    k = np.tile(Faults(**SEVERE).vector, (batch.LANES, 1))
    _, _, response, target = scoring(k)
    # the first row starts the filter: take a target that starts where the response does
    assert response[0, 0] == target[0]
    costs, _, _, _ = scoring(k, target=response[0].copy())
    np.testing.assert_allclose(costs, 0.0, atol=1e-20)


@given(st.tuples(*[shares] * 8))
def test_fault_states_are_the_magnitudes_of_the_paper(values):
    k = np.array(values)
    f = state.fault_state(*k, 0.0025)
    assert f.friction == pytest.approx(1.0 + 2.0 * k[0])
    assert 2.0 * f.half_gap == pytest.approx(0.005 * (1.0 + 99.0 * k[1]))
    assert (f.h_a, f.h_b, f.h_c) == tuple(1.0 - k[2:5])
    phi = 2.0 * math.pi * (k[6] - 0.5)
    assert f.zeta_cos == pytest.approx(k[5] * math.cos(phi))
    assert f.zeta_sin == pytest.approx(k[5] * math.sin(phi))
    assert f.gain == pytest.approx(0.5 + k[7])
