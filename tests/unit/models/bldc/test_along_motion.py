"""Equations along a recorded motion: against plain Python, and a simulator of other make."""

import math

import numpy as np
import pytest

from bldc_inputs import with_one_current
from ematwin.models.bldc import along_motion
from ematwin.models.bldc.along_currents import Noise
from ematwin.models.bldc.balance import Contact, Crossing, TorqueBalance
from ematwin.models.bldc.channels import (
    PHASES,
    phase_currents,
    projected,
    trapezoid_shape,
)
from ematwin.models.bldc.commutations import commutations, divided
from ematwin.models.bldc.constants import (
    TruerState,
    fault_state,
    kernel_constants,
    truer_constants,
)
from ematwin.models.bldc.faults import Faults
from ematwin.models.bldc.masses_filter import Sensed, evened, growth_rates, masses_along
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.motion import Motion, has_motion, output_along
from ematwin.models.bldc.motor import SIXTH_TURN
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import plain
from ematwin.numerics.friction import fading, sliding_torque
from ematwin.numerics.signals import LowPass
from naive import along_motion as naive
from naive import another_actuator, truer

PLAIN = BldcActuator.load().changed(
    {"controller.position_gain": 60.0, "controller.speed_gain": 0.004}
)
SAMPLED = {
    "speed_loop.integral_gain": 0.1, "speed_loop.sample_time": 1e-4, "speed_loop.delay": 1e-4,
}  # fmt: skip
MODULATED = {
    "current_loop.proportional_gain": 7.0, "current_loop.integral_gain": 12_000.0,
    "current_loop.sample_time": 5e-5, "current_loop.delay": 5e-5, "current_loop.lost_voltage": 1.0,
}  # fmt: skip
BOTH = PLAIN.changed({**SAMPLED, **MODULATED})
COUNTED = {
    "encoder.motor_steps": 10_000, "encoder.output_steps": 5_000_000, "encoder.filter_time": 3e-4,
}  # fmt: skip


@pytest.mark.parametrize(
    "actuator",
    [PLAIN, PLAIN.changed(SAMPLED), BOTH.changed(COUNTED), BOTH.changed({"emf.rounding": 0.3})],
    ids=["paper", "speed loop", "both loops and an encoder", "rounded"],
)
def test_currents_along_a_motion_are_those_of_the_naive_loop(actuator):
    dt, count = 2e-6, 3000
    time = dt * np.arange(count + 1)
    angle, speed = 0.6 * np.sin(150.0 * time), 90.0 * np.cos(150.0 * time)
    command, output = 1.3 * np.sin(150.0 * time), 0.6 * np.sin(150.0 * time - 0.02)
    faults, c, more = Faults.of({}), kernel_constants(actuator), truer_constants(actuator)
    emf = along_motion.emf_along(faults.vector, angle, c, more) / c.k_e
    motion = np.array([[angle, speed, output, *emf]])
    (fast,) = along_motion.currents_along(
        faults.vector[None], command[None], motion, dt, dt, np.array(c)[:, None], np.array([dt]),
        count, np.array(more)[:, None], np.zeros((1, 3)), np.array([TruerState()]),
    )  # fmt: skip
    slow = naive.currents(actuator, faults, command, np.array([angle, speed, output]), dt)
    np.testing.assert_allclose(fast, slow, atol=1e-8)


def test_an_output_along_the_motion_of_a_motor_is_the_naive_one():
    dt, count = 1e-6, 20_000
    time = dt * np.arange(count)
    motion = np.array([0.05 * np.sin(800.0 * time), 40.0 * np.cos(800.0 * time)])
    load, faults = np.where(time > 0.01, 0.02, 0.0), Faults.of({"friction": 0.3, "backlash": 0.1})
    fast = output_along(
        faults.vector, motion, load, dt, 1, kernel_constants(PLAIN), truer_constants(PLAIN)
    )
    middle, pushes = (0.5 * (x[..., 1:] + x[..., :-1]) for x in (motion, load))
    slow = naive.output(PLAIN, faults, motion[:, 0], middle, pushes, dt)
    assert np.ptp(fast[0] - motion[0]) > 0.05  # it crosses the gap
    np.testing.assert_allclose(fast[0], slow, atol=1e-9)


@pytest.mark.parametrize(("phases", "others", "output"), [(3, 0.0, 0), (1, 0.1, 0), (3, 0.1, 20)])
def test_masses_along_currents_are_the_naive_ones(phases, others, output):
    every, count, dt = 20, 400, 2.5e-6
    time = every * dt * np.arange(count)
    size = 1.5 * np.sin(250.0 * time)
    currents = np.array([size, -size, 0.0 * time])[:phases].T
    load = np.where(time > 0.01, 0.02, 0.0)
    every_faults = [Faults.of({"friction": x, "backlash": 0.5 * x}) for x in (0.1, 0.12)]
    faults = every_faults[0]
    seen = [
        (0.0041, 0.2, 8e-6), (0.0078, 0.31, 8e-6), (0.0123, 0.11, 6e-5), (0.0161, -0.4, 8e-6)
    ]  # fmt: skip
    known, begin = (0.5, 40.0), (0.3, 0.005)
    angles, noise = {}, 2e-3

    def by_hand(faults=faults):
        return naive.masses(
            PLAIN, faults, currents, load, dt, every, seen, (*known, others), begin, angles, noise
        )

    slow, _ = by_hand()
    if output:
        angles |= {n: slow[1, n] + 0.003 * math.sin(n / 40.0) for n in range(0, 399, output)}
        slow, _ = by_hand()
    shown = np.full(count, np.nan)
    shown[list(angles)] = list(angles.values())
    other = others / (SIXTH_TURN / PLAIN.motor.pole_pairs)
    when, angle, jitter = np.array(seen).T
    sensed = Sensed(begin[0], 0.0, 1.0, 0.0, 1.0, 0.0, known[1], noise)
    constants = kernel_constants(PLAIN), truer_constants(PLAIN), sensed
    for many in (1, 6, 19):  # alone, in some lanes, in more than there are
        rows = (np.tile(np.array(one, dtype=float), (many, 1)) for one in constants)
        own = [every_faults[n % 2].vector for n in range(many)]
        fast, left, fixed, at = masses_along(
            np.array(own), *rows, begin[1], currents, load, every * dt, every,
            np.array([when / (every * dt), angle, jitter]), np.full(count, np.nan), shown,
            np.array([known[0], math.inf, other]),
        )  # fmt: skip
        assert fixed.shape == (many, 4, at.size) == (many, 4, len(seen) + len(angles))
        assert (np.diff(at) > 0.0).all()
        assert np.ptp(slow[0]) > 0.3  # rad
        assert np.ptp(slow[0] - slow[1]) > (0.0149 if output else 0.02)  # half the gap is 14.9 mrad
        for n in range(min(many, 2)):
            expected, innovations = by_hand(every_faults[n])
            # the torque of the currents is the same for some steps
            np.testing.assert_allclose(fast[n, [0, 2]], expected, atol=5e-5)
            np.testing.assert_allclose(left[n].T, innovations, atol=5e-5)
        for n in range(2, many):
            np.testing.assert_allclose(fast[n], fast[n % 2], rtol=1e-9, atol=1e-12)


def test_motions_are_even_between_corrections():
    """Steps of angle and speed at two instants belong to the time before them."""
    rate, when = 1000.0, np.array([100.5, 250.25])
    fixed = np.zeros((1, 4, 2))
    fixed[0, :2] = [[0.02, -0.03], [0.4, 0.3]]  # rad and rad/s, of the motor
    n = np.arange(400.0)
    found = np.zeros((1, 4, 400))
    found[0, 0], found[0, 1] = 5.0 * n / rate, 5.0
    for at, angle, speed in zip(when, *fixed[0, :2], strict=True):
        found[0, 0] += np.where(n > at, angle + speed * (n - at) / rate, 0.0)
        found[0, 1] += np.where(n > at, speed, 0.0)
    stepped = found.copy()
    evened(found, fixed, when, rate)
    angle, speed = found[0, :2]
    after = n > when[1]
    np.testing.assert_array_equal(angle[after], stepped[0, 0, after])
    np.testing.assert_allclose(np.gradient(angle)[1:-1] * rate, speed[1:-1], atol=0.01)
    assert np.abs(np.diff(speed)).max() < 0.02
    assert not found[0, 2:].any()


def recorded(structure, actuator, duration=0.4, faults=None, noise=0.0, rate=20e3):
    """A recording of the simulator of other make, without rounding."""
    time = np.arange(0.0, duration, 5e-5)
    command = 0.005 * np.sin(2.0 * np.pi * (5.0 + 12.0 * time) * time)
    load = np.where(time > 0.25, 10.0, 0.0)
    parameters = another_actuator.parameters_of(actuator)
    return another_actuator.simulate(
        parameters, time, command, load, faults, structure, noise=noise, bits=None, sample_rate=rate
    )


def as_built(lines=0):
    """A drive with all forms, by the other simulator, and as a parameter set."""
    structure = another_actuator.Structure(
        control_interval=1e-4, speed_integral=0.1, current_interval=5e-5,
        current_bandwidth=7.0 / BOTH.motor.inductance, lost_voltage=0.5, cogging=0.0015,
        cogging_cycles=12, cogging_phase=0.4, emf_rounding=0.2, encoder_lines=lines,
        output_lines=lines, encoder_phase=0.3, sampling_phase=0.6,
        speed_lag=2e-4 if lines else 0.0, bristle_stiffness=100.0, stribeck_speed=10.0,
    )  # fmt: skip
    actuator = BOTH.changed({
        "current_loop.integral_gain": structure.current_bandwidth * BOTH.motor.resistance,
        "speed_loop.delay": 0.0, "emf.rounding": 0.2, "cogging.torque": 0.0015,
        "cogging.cycles": 12, "cogging.phase": 0.4, "presliding.motor_stiffness": 100.0,
        "presliding.output_stiffness": 100.0, "presliding.damping": 0.01,
        "presliding.stribeck_speed": 10.0,
    })  # fmt: skip
    counts = {
        "encoder.motor_steps": lines, "encoder.output_steps": 500 * lines,
        "encoder.filter_time": 2e-4,
    }  # fmt: skip
    return structure, actuator.changed(counts) if lines else actuator


@pytest.mark.parametrize("times", [(62.5e-6, 5e-5), (6.3e-5, 6.25e-5)])
def test_steps_of_both_loops_err_by_less_than_the_equation(times):
    """Sample times of which a step is no part had left 0.9 %."""
    structure, actuator = as_built(10_000)
    actuator = actuator.changed({
        "current_loop.sample_time": times[0], "current_loop.delay": times[0],
        "speed_loop.sample_time": times[1],
    })  # fmt: skip
    motion = Motion(recorded(structure, actuator), actuator)
    usual = along_motion.Controller(motion, LowPass())
    error = np.linalg.norm(usual.left(actuator) - usual.left(actuator, faster=5.0)) / usual.size
    assert 0.0 < error < along_motion.LEAST


FAULTS = {
    "friction": 0.3, "backlash": 0.1, "short_a": 0.2, "short_c": 0.1, "eccentricity": 0.3,
    "eccentricity_phase": 0.2, "gain": 0.4,
}  # fmt: skip


@pytest.mark.parametrize("faults", [{}, FAULTS], ids=["healthy", "worn"])
@pytest.mark.parametrize("lines", [0, 2_000])
def test_phases_of_one_current_are_those_of_a_simulator_of_other_make(lines, faults):
    """As shares of the current in steady conduction, and of the torque of each phase."""
    structure, actuator = as_built(lines)
    record = recorded(structure, actuator, faults=faults)
    one, pairs = with_one_current(record), actuator.motor.pole_pairs
    found = divided(one.current, record.motor_position, record.sample_rate, actuator)
    known, angle = phase_currents(record), pairs * record.motor_position
    np.testing.assert_allclose(found.sum(axis=1), 0.0, atol=1e-12)
    assert np.std(found - known) < 0.03 * np.std(known)
    again = projected(found, angle - 0.5 * np.gradient(angle))
    assert np.std(again - one.current) < 0.005 * np.std(one.current)
    for phase in range(3):
        shape = trapezoid_shape(angle - 2.0 * np.pi / 3.0 * phase)
        torque, recorded_torque = shape * found[:, phase], shape * known[:, phase]
        gain = torque @ recorded_torque / (recorded_torque @ recorded_torque)
        assert gain == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize(
    ("lines", "faults", "phases"),
    [
        (0, {}, 3), (10_000, {}, 3), (2_000, {}, 3), (0, FAULTS, 3), (10_000, FAULTS, 3),
        (0, FAULTS, 1), (10_000, FAULTS, 1),
    ],
)  # fmt: skip
def test_all_equations_hold_along_the_motion_of_a_simulator_of_other_make(lines, faults, phases):
    """Of encoders the equations leave what counts that begin elsewhere say."""
    structure, actuator = as_built(lines)
    record = recorded(structure, actuator, faults=faults)
    motion = Motion(record if phases == 3 else with_one_current(record), actuator)
    assert 2.0 * np.pi / lines == pytest.approx(motion.steps[0]) if lines else motion.steps[0] == 0
    controller = along_motion.Controller(motion, LowPass())
    balance = TorqueBalance(motion)
    contact = Contact(balance, actuator, faults)
    wide = actuator.changed({"transmission.backlash": 1.05 * actuator.transmission.backlash})
    share, without = (
        np.linalg.norm(contact.left(one, faults)) / contact.size for one in (actuator, wide)
    )
    assert share < (1.5 * contact.least(actuator) if lines else 0.006)
    assert max(0.015, share) < without
    for one in (controller, balance):
        share = np.linalg.norm(one.left(actuator, faults)) / one.size
        without = np.linalg.norm(one.left(PLAIN, faults)) / one.size
        least = one.least(actuator)
        assert share < (2.0 * least if lines else 0.006)
        assert max(0.015, share) < without


@pytest.mark.parametrize("lines", [0, 10_000, 2_000])
@pytest.mark.parametrize("faults", [{}, FAULTS], ids=["healthy", "worn"])
def test_an_output_that_was_not_recorded_follows_the_motor(lines, faults):
    """Of a simulator of other make, to a share of its gap or of a count."""
    structure, actuator = as_built(lines)
    record = recorded(structure, actuator, faults=faults)
    known = Motion(record, actuator)
    motion = Motion(record.changed(output_position=None), actuator)
    gap = actuator.transmission.backlash * (1.0 + 99.0 * faults.get("backlash", 0.0))
    away = motion.followed(motion.time, actuator, faults)[0] - known.output(motion.time)
    assert away.std() < 0.02 * gap + 0.2 * known.steps[0]
    for one in (along_motion.Controller(motion, LowPass()), TorqueBalance(motion, faults)):
        share, without = (
            np.linalg.norm(one.left(actuator, {**faults, **given})) / one.size
            for given in ({"output_zero": float(-away.mean())}, {"friction": 0.1, "backlash": 0.03})
        )
        assert share < (2.0 * one.least(actuator) if lines else 0.008)
        assert share < without


@pytest.mark.parametrize(
    ("lines", "single"), [(0, False), (2_000, False), (0, True), (10_000, True)]
)
@pytest.mark.parametrize("faults", [{}, FAULTS], ids=["healthy", "worn"])
def test_a_motor_that_was_not_recorded_moves_as_currents_say(lines, faults, single):
    """Of a simulator of other make, to a milliradian beside its counts."""
    structure, actuator = as_built(lines)
    record = recorded(structure, actuator, duration=0.5, faults=faults, noise=0.02)
    known = Motion(record, actuator)
    if single:
        record = with_one_current(record)
    currents = record.current if single else phase_currents(record)
    seen = commutations(currents, known.rate, actuator)
    off = seen.angle - known.motor(seen.when / known.rate)
    off -= seen.turn * np.round(off / seen.turn)
    assert off.size > 30
    assert np.quantile(np.abs(off), 0.9) < 4e-3
    without = record.changed(motor_position=None, output_position=None)
    assert has_motion(without, actuator)
    motion = Motion(without, actuator, faults)
    last = int(seen.when[-1])
    away = motion.motor.values - known.motor.values
    away, output = away[:last], (motion.output.values - known.output.values)[:last]
    assert away.std() < 2.5e-3 + 0.2 * known.steps[0]
    assert output.std() < 3e-3 + 0.2 * known.steps[0]
    left = motion.masses.left(actuator, faults)
    assert 0.4 < np.sqrt(np.mean(left**2)) < 1.6  # standard deviations
    controller = along_motion.Controller(motion, LowPass())
    for one in (motion.masses, controller):
        share, other = (
            np.linalg.norm(one.left(actuator, {**faults, **given})) / one.size
            for given in ({}, {"friction": 0.1, "backlash": 0.03})
        )
        assert share < 2.0 * one.least(actuator)
        # beside one current much counts as no commutation
        assert other > (1.5 if single else 2.0) * share
    candidates = [(actuator, {**faults, "friction": 0.001 * n}) for n in range(3)]
    candidates.insert(1, (actuator.model_copy(update={"presliding": None}), faults))
    for one in (motion.masses, controller):
        expected = [one.left(*each) for each in candidates]
        again = Motion(without, actuator, faults)
        fresh = again.masses if one is motion.masses else along_motion.Controller(again, LowPass())
        for side_by_side, alone in zip(fresh.each(candidates), expected, strict=True):
            # lanes round otherwise, and friction holds a mass a step sooner
            assert np.linalg.norm(side_by_side - alone) < 0.01 * np.linalg.norm(alone)


def test_commutations_of_one_current_are_placed_by_where_the_motor_is():
    """Nowhere beside a closed loop that diverged."""
    record = recorded(as_built()[0], BOTH)
    current, motor = with_one_current(record).current, record.motor_position.copy()
    seen = commutations(current, record.sample_rate, BOTH)
    placed = seen.placed(motor, motor)
    away = placed.angle - np.interp(placed.when, np.arange(motor.size), motor)
    assert np.abs(away).max() < 0.5 * seen.turn
    motor[motor.size // 2 :] = np.nan
    half = seen.placed(motor, motor)
    assert 0 < half.when.size < placed.when.size
    assert np.isfinite(half.angle).all()


@pytest.mark.parametrize("single", [False, True], ids=["phases", "one"])
def test_an_output_that_comes_late_is_not_where_currents_move_it(single):
    """Its delay would pass for a gain: the controller answers the recorded output."""
    structure, actuator = as_built()
    record = recorded(structure, actuator, duration=0.5, faults=FAULTS, noise=0.02)
    record = with_one_current(record) if single else record
    output, late = record.output_position, round(3e-4 * record.sample_rate)
    after = np.r_[np.full(late, output[0]), output[:-late]]
    for position, wrong in ((output, False), (after, True)):
        lacks = record.changed(motor_position=None, output_position=position)
        share = Motion(lacks, actuator, FAULTS).masses.unexplained(actuator, FAULTS)
        assert (share > 0.1) == wrong


@pytest.mark.parametrize("share", [0.0, 0.4])
def test_masses_are_found_again_where_friction_is_far_off(share):
    """Twins whose friction is healthy lose the motor between commutations."""
    structure, actuator = as_built()
    faults = {"friction": share}
    record = recorded(structure, actuator, faults=faults, noise=0.02)
    without = record.changed(motor_position=None, output_position=None)
    masses = Motion(without, actuator).masses
    begins = masses.begins(actuator, {}).get("friction", 0.0)
    assert abs(begins - share) <= 0.2
    known = Motion(record, actuator).motor.values
    moved = masses.moved(actuator, {"friction": begins})
    assert np.abs(moved.motor - known).max() < 0.3  # rad, of sectors of 0.5


def test_the_output_tells_a_gap_that_is_far_off_and_where_the_motor_is_after_a_rest():
    structure, actuator = as_built()
    time, faults = np.arange(0.0, 0.6, 5e-5), {"friction": 0.3, "backlash": 0.4}
    command = 0.006 * np.clip((time - 0.02) / 0.1, 0.0, 1.0)
    command -= 0.006 * np.clip((time - 0.35) / 0.1, 0.0, 1.0)
    parameters = another_actuator.parameters_of(actuator)
    record = another_actuator.simulate(
        parameters, time, command, None, faults, structure, noise=0.02, bits=None
    )
    lacks = record.changed(motor_position=None)
    assert Motion(lacks, actuator).masses.begins(actuator, {}) == faults
    for gap in (0.36, 0.44):  # the output counts beside a gap that is a little wrong
        given = {**faults, "backlash": gap}
        assert math.isfinite(Motion(lacks, actuator, given).masses.noise.output)
    masses = Motion(lacks, actuator, faults).masses
    assert masses.begins(actuator, faults) == {}
    moved = masses.moved(actuator, faults)
    assert masses.unexplained(actuator, faults) < 0.2  # of a gap so wide, by one impact
    known = Motion(record, actuator).motor.values
    assert np.sqrt(np.mean((moved.motor - known) ** 2)) < 0.01  # rad
    # each is about as far off as the filter says
    assert 0.7 < np.sqrt(np.mean(moved.left**2)) < 1.5


def test_command_and_output_may_be_counted_from_elsewhere():
    structure, actuator = as_built()
    record = recorded(structure, actuator, faults=FAULTS, noise=0.02).changed(motor_position=None)
    away, ratio, lefts = 0.02, actuator.transmission.ratio, []
    for zero in (0.0, away):
        moved = {one: getattr(record, one) + zero / ratio for one in ("command", "output_position")}
        given = {**FAULTS, "output_zero": zero}
        motion = Motion(record.changed(**moved), actuator, given)
        lefts.append(along_motion.Controller(motion, LowPass()).left(actuator, given))
    np.testing.assert_allclose(lefts[1], lefts[0], atol=1e-6)


@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_the_recorded_twist_tells_from_which_gap_to_set_out(gap):
    structure, actuator = as_built(10_000)
    record = recorded(structure, actuator, faults={"backlash": gap}, noise=0.02)
    each = {one.name: one for one in MODEL.equations(record, actuator, {})}
    assert each["contact"].begins()["backlash"] == pytest.approx(gap, abs=0.01)


def test_errors_of_a_speed_grow_where_friction_falls_with_speed():
    _, actuator = as_built()
    c, truer, step = kernel_constants(actuator), truer_constants(actuator), 1e-4
    fault = plain(fault_state)(Faults.of({"friction": 0.3}).vector, c.half_gap)

    def torque(speed, dynamic):
        fade = plain(fading)(speed, truer.presliding_stribeck_speed)
        return plain(sliding_torque)(fault.friction * dynamic, c.static_ratio, fade)

    for speed in (0.0, 2.0, 7.0, 30.0):
        of_motor, of_output = (
            (torque(speed, dynamic) - torque(speed + step, dynamic)) / step
            for dynamic in (c.t_m, c.t_o)
        )
        rates = plain(growth_rates)(speed, fault, c, truer)
        expected = (
            (of_motor - c.viscous) / actuator.motor.inertia,
            of_output / actuator.transmission.output_inertia,
            (of_motor + of_output - c.viscous) * c.mobility_both,
        )
        np.testing.assert_allclose(rates, expected, rtol=1e-3, atol=0.1)


def test_commutations_are_told_to_a_share_of_a_sample():
    structure, actuator = as_built()
    for rate in (20e3, 10e3, 5e3):
        record = recorded(structure, actuator, 0.5, FAULTS, noise=0.02, rate=rate)
        seen = commutations(phase_currents(record), rate, actuator)
        samples, motor = np.arange(len(record)), record.motor_position
        angle, speed = (
            np.interp(seen.when, samples, x) for x in (motor, np.gradient(motor, 1.0 / rate))
        )
        away = np.array([math.remainder(x, seen.turn) for x in seen.angle - angle])
        late = (away / speed / seen.jitter)[np.abs(speed) > 20.0]
        assert 0.3 < np.sqrt(np.mean(late**2)) < 1.5


@pytest.mark.parametrize("ends", [False, True], ids=["carried on", "ended before"])
def test_a_phase_that_carries_nothing_when_it_changes_tells_a_commutation_less_exactly(ends):
    sizes = np.ones(40)
    if ends:  # the current passes zero as b hands over to c
        sizes[16:24] = np.r_[0.6, 0.3, 0.15, 0.0, 0.0, 0.15, 0.3, 0.6]
    first = np.arange(40) < 20
    currents = np.column_stack([sizes, -sizes * first, -sizes * ~first])
    currents += 0.01 * np.random.default_rng(0).standard_normal(currents.shape)
    seen = commutations(currents, 20e3, as_built()[1])
    assert seen.when.size == 1
    away, jitter = float(seen.when[0]) - 19.0, float(seen.jitter[0]) * 20e3  # samples
    assert abs(away) < 2.0 * jitter
    assert 0.1 < jitter < 0.2 if not ends else 0.5 < jitter < 1.0


def test_motor_and_output_keep_their_momentum_where_counts_are_coarse():
    """Aided by the load, the output leaves its face in each turn; its own counts are fine."""
    structure, actuator = as_built(2_000)
    record = recorded(structure._replace(output_lines=8192), actuator)
    balance = TorqueBalance(Motion(record, actuator))
    share = np.linalg.norm(balance.left(actuator)) / balance.size
    assert share < 1.15 * balance.least(actuator)


@pytest.mark.parametrize(
    ("lines", "faults", "most"), [(0, {}, 0.015), (0, FAULTS, 0.003), (10_000, FAULTS, 0.01)]
)
def test_each_mass_shows_alone_while_the_output_crosses_the_gap(lines, faults, most):
    """By how much inertia and friction of each are off, where the gap is crossed; 2 % noise."""
    structure, actuator = as_built(lines)
    record = recorded(structure, actuator, faults=faults, noise=0.02)
    balance = TorqueBalance(Motion(record, actuator))
    apart = Contact(balance, actuator, faults).apart()
    for mass, of_motor in (("motor", True), ("transmission", False)):
        alone = Crossing(balance, apart, actuator, of_motor=of_motor)
        left = alone.left(actuator, faults)
        # bristles that bend the other way, after the motor has turned round, leave more than noise
        assert np.linalg.norm(left) / alone.size < 3.0 * alone.least(actuator)
        for name in ("inertia" if of_motor else "output_inertia", "friction_torque"):
            place = f"{mass}.{name}"
            moved = actuator.changed({place: 1.02 * actuator.value(place)})
            change = (alone.left(moved, faults) - left) / 0.02
            assert abs(change @ left) / (change @ change) < most


def test_ripple_of_a_comparator_is_noise_of_the_angle_in_the_gap():
    faults = {"backlash": 0.3}
    record = recorded(another_actuator.Structure(), PLAIN, faults=faults, noise=0.02)
    balance = TorqueBalance(Motion(record, PLAIN))
    apart = Contact(balance, PLAIN, faults).apart()
    motor = Crossing(balance, apart, PLAIN, of_motor=True)
    share = np.linalg.norm(motor.left(PLAIN, faults)) / motor.size
    assert share < 1.2 * motor.least(PLAIN)


def test_an_output_that_friction_stops_in_the_gap_does_not_count_as_moving():
    """Speeds by coarse counts are smoothed: they show a stop later than the recorded angle."""
    structure, actuator = as_built(4096)
    structure = structure._replace(output_lines=8192)
    faults = {"friction": 0.6, "backlash": 0.2}
    record = recorded(structure, actuator, faults=faults, noise=0.02)
    balance = TorqueBalance(Motion(record, actuator))
    apart = Contact(balance, actuator, faults).apart()
    output = Crossing(balance, apart, actuator, of_motor=False)
    left = output.left(actuator, faults)
    heavier = actuator.changed({
        "transmission.output_inertia": 1.5 * actuator.transmission.output_inertia
    })  # fmt: skip
    assert apart.sum() > 100
    assert left @ left <= np.sum(output.left(heavier, faults) ** 2) + 9.0


def test_a_crossing_that_is_straight_to_the_last_digit_shows_no_less_than_noise():
    record = recorded(another_actuator.Structure(), PLAIN, noise=0.02)
    straight = record.changed(output_position=np.linspace(0.0, 1.0, len(record)))
    balance = TorqueBalance(Motion(straight, PLAIN))
    output = Crossing(balance, np.ones(len(record), bool), PLAIN, of_motor=False)
    assert output.left(PLAIN).size > 1000
    assert output.least(PLAIN) == pytest.approx(1.0, rel=0.01)


def test_a_gear_that_gives_more_than_its_file_says_does_not_seem_to_cross_its_gap():
    """While its faces touch the output feels the motor, at twists that a stiff gear never has."""
    structure, actuator = as_built()
    soft = structure._replace(gear_stiffness=100.0)
    balance = TorqueBalance(Motion(recorded(soft, actuator), actuator))
    apart = Contact(balance, actuator).apart()
    output = Crossing(balance, apart, actuator, of_motor=False)
    assert apart.sum() > 100
    assert np.linalg.norm(output.left(actuator)) / output.size < 2.0 * output.least(actuator)


@pytest.mark.parametrize("name", [*FAULTS, "load_gain", "current_gain", "skew"])
def test_equations_see_each_fault_and_sensor(name):
    """One that is taken as usual, and is not, leaves more than the equations' own error."""
    sensors = {"load_gain": 1.05, "current_gain": 1.02, "skew": 2e-4}
    structure, actuator = as_built()
    record = recorded(structure, actuator, faults=FAULTS)
    channels = dict(record.channels)
    values = {**FAULTS, **({name: sensors[name]} if name in sensors else {})}
    if name == "load_gain":
        channels["load"] = channels["load"] / sensors[name]
    elif name == "skew":
        late = record.time - sensors[name]
        channels["command"] = np.interp(late, record.time, channels["command"])
    elif name == "current_gain":
        channels |= {k: sensors[name] * x for k, x in channels.items() if k in PHASES}
    motion = Motion(type(record)(record.time, channels, units=record.units), actuator)
    balance = TorqueBalance(motion)
    every = [
        along_motion.Controller(motion, LowPass()), balance,
        Contact(balance, actuator, values),
    ]  # fmt: skip
    left, without = (
        np.array([np.linalg.norm(one.left(actuator, given)) / one.size for one in every])
        for given in (values, {k: x for k, x in values.items() if k != name})
    )
    assert (left < 0.008).all()
    assert (without > 1.3 * left).any()


def test_shapes_along_a_motion_are_those_of_the_naive_windings():
    actuator = BOTH.changed({
        "emf.rounding": 0.3, "emf.harmonic_5": 0.04, "emf.harmonic_7": -0.02,
        "torque_ripple.share": 0.05, "torque_ripple.cycles": 6, "torque_ripple.phase": 0.4,
    })  # fmt: skip
    windings, turned = truer.Windings(actuator, Faults.of({})), np.linspace(-1.0, 1.0, 50)
    slow = 2.0 * np.array([windings.kappa(x) for x in turned]) / actuator.motor.emf_constant
    c = kernel_constants(actuator)._replace(k_e=1.0)
    shapes = along_motion.emf_along(Faults().vector, turned, c, truer_constants(actuator)).T
    np.testing.assert_allclose(shapes, slow, atol=1e-6)


def test_noise_ahead_is_never_less_than_that_of_the_currents_nor_more_than_now():
    known = Noise(1e4, least=50.0)
    assert known.ahead.density == 1e3
    assert known.ahead.ahead.ahead.density == 50.0
    assert Noise(20.0, least=50.0).ahead.density == 20.0
    assert Noise(1e4).ahead.density == 1e4  # of one current
