"""Reference and monitor model answer alike, and each fault moves the current as physics says."""

import math

import numpy as np
import pytest

from bldc_inputs import misfit, rms, signed
from ematwin.models.bldc.channels import current_envelope, trapezoid_shape
from ematwin.models.bldc.faults import FAULTS, PAPER_CASES, Faults
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Chirp, Profile, Ramp, Scenario, Step
from ematwin.models.simulating import simulate
from ematwin.numerics.signals import LowPass

MODELS = ("reference", "monitor")
ACTUATOR = BldcActuator.load()
MOTOR, GEAR, CONTROL = ACTUATOR.motor, ACTUATOR.transmission, ACTUATOR.controller
RATE = 20_000.0
LOW_PASS = LowPass(500.0)

# up to half of friction, eccentricity and gain, a third of the other faults, at any angle
MIXTURES = np.random.default_rng(0).random((6, 8)) * [0.5, 0.3, 0.3, 0.3, 0.3, 0.5, 1.0, 0.5]
MIXTURES[:, 7] += 0.25
AGREE = {  # share of RMS, in the vectors of the paper and in others
    "healthy": ({}, 0.02),
    **{name: (faults, 0.05) for name, faults in PAPER_CASES.items()},
    **{f"mixture {n}": (faults, 0.02) for n, faults in enumerate(MIXTURES)},
}


@pytest.mark.parametrize(("faults", "limit"), AGREE.values(), ids=AGREE)
def test_models_agree_within_two_per_cent_and_five_on_the_vectors_of_the_paper(faults, limit):
    """RMS difference of the filtered equivalent currents, as a share of the reference's RMS.

    `pytest -s` prints them: they are the table in docs/models.md.
    """
    records = [simulate(model, faults=faults) for model in MODELS]
    for equivalent in (current_envelope, signed):
        first, second = (LOW_PASS.apply(equivalent(one), RATE) for one in records)
        gap = misfit(second, first)
        print(f"{Faults.of(faults)!r}: {equivalent.__name__} {100.0 * gap:.2f} %")
        assert gap < limit


def same(one, other):
    for (name, x), (_, y) in zip(one.columns(), other.columns(), strict=True):
        np.testing.assert_array_equal(x, y, err_msg=name)


HEALTHY_VALUES = dict.fromkeys(FAULTS, 0.0) | {"eccentricity_phase": 0.5, "gain": 0.5}
MIXED = {
    "friction": 0.3, "backlash": 0.1, "short_a": 0.2, "short_c": 0.1, "eccentricity": 0.3,
    "eccentricity_phase": 0.7, "gain": 0.6,
}  # fmt: skip


@pytest.mark.parametrize("model", MODELS)
def test_values_of_a_healthy_actuator_reproduce_the_healthy_trace_bit_for_bit(model):
    """Whatever was simulated before, and however healthy is said."""
    healthy = simulate(model)
    for faults in (MIXED, *PAPER_CASES.values()):
        assert rms(signed(simulate(model, faults=faults)) - signed(healthy)) > 0.01
    for faults in ({}, HEALTHY_VALUES, Faults(), np.array(list(HEALTHY_VALUES.values()))):
        same(healthy, simulate(model, faults=faults))


SWING = Scenario(
    name="swing", duration=0.2, command=[Chirp(amplitude=0.005, f_start=5.0, f_end=25.0)]
)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    "faults",
    [
        {"friction": 0.25},
        {"friction": 1.0},
        {"backlash": 0.1},
        {"backlash": 0.8},
        {"gain": 0.1},
        {"gain": 1.0},
        {"friction": 0.5, "backlash": 0.2, "gain": 0.7},
    ],
    ids=str,
)
def test_a_faulty_actuator_is_a_healthy_one_with_those_parameters(model, faults):
    """The laws of the paper's section 6, as anybody would put them into a parameter file."""
    faulty = simulate(model, SWING, faults)
    rubbing = 1.0 + 2.0 * faults.get("friction", 0.0)
    parameters = {
        "motor.friction_torque": rubbing * MOTOR.friction_torque,
        "transmission.friction_torque": rubbing * GEAR.friction_torque,
        "transmission.backlash": (1.0 + 99.0 * faults.get("backlash", 0.0)) * GEAR.backlash,
        "controller.position_gain": (0.5 + faults.get("gain", 0.5)) * CONTROL.position_gain,
    }
    worn = simulate(model, SWING, actuator=ACTUATOR.changed(parameters))
    for (name, x), (_, y) in zip(faulty.columns(), worn.columns(), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-6 * np.abs(y).max(), err_msg=name)
    assert rms(signed(worn) - signed(simulate(model, SWING))) > 0.01


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("phase", [0.0, 0.123, 1.0])
def test_direction_means_nothing_without_eccentricity(model, phase):
    same(simulate(model), simulate(model, faults={"eccentricity_phase": phase}))


@pytest.mark.parametrize("model", MODELS)
def test_opposite_ends_of_the_direction_are_the_same_angle(model):
    ends = [
        signed(simulate(model, faults={"eccentricity": 0.5, "eccentricity_phase": phase}))
        for phase in (0.0, 1.0)
    ]
    assert rms(ends[0] - ends[1]) < 1e-2 * rms(ends[0])


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    "faults",
    [
        {"short_a": 1.0},
        {"short_b": 1.0},
        {"short_c": 1.0},
        {"short_a": 1.0, "short_b": 1.0, "short_c": 1.0},
        {"eccentricity": 1.0},
        {"eccentricity": 1.0, "short_a": 1.0, "eccentricity_phase": 0.25},
        np.ones(8),
        np.array([1, 1, 1, 1, 1, 1, 0, 0]),
    ],
)
def test_extreme_faults_stay_finite(model, faults):
    """`simulate` raises where a trace leaves the finite numbers; nothing exceeds the drive."""
    record = simulate(model, faults=faults)
    # the largest ripple of a fully shorted pair: a step of the supply on leakage alone
    assert np.abs(signed(record)).max() < 2.0 * ACTUATOR.drive.current_limit


# A steady run: constant speed against a constant load, where currents follow from a torque balance.

SPEED = 200.0  # rad/s on the motor: a turn in 31 ms
LOAD = 50.0  # N m on the output
STEADY = Scenario(
    name="steady", duration=0.5, command=[Ramp(rate=SPEED / GEAR.ratio)], load=[Step(value=LOAD)]
)
LATE = slice(-round(8 * 2.0 * math.pi / SPEED * RATE), None)  # the last eight turns


def needed_torque(friction=0.0):
    """Torque of the motor that keeps the speed, N m."""
    load = LOAD / GEAR.ratio
    dry = MOTOR.friction_torque + GEAR.friction_torque + (1 / GEAR.efficiency_opposing - 1) * load
    return MOTOR.viscous_damping * SPEED + load + (1.0 + 2.0 * friction) * dry


def steady(model, **faults):
    record = simulate(model, STEADY, faults)
    return record, signed(record)[LATE]


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("friction", [0.0, 0.25, 1.0])
def test_friction_raises_the_current_by_its_torque(model, friction):
    _, current = steady(model, friction=friction)
    expected = needed_torque(friction) / MOTOR.emf_constant
    assert current.mean() == pytest.approx(expected, rel=0.01)


def kappa_of_pair(theta_m, short_a=0.0, eccentricity=0.0, eccentricity_phase=0.5):
    """Torque constant of the conducting pair: the two phases whose EMF is on its flat."""
    total = np.zeros_like(theta_m)
    phi = 2.0 * math.pi * (eccentricity_phase - 0.5)
    for k in range(3):
        lag = 2.0 * math.pi * k / 3.0
        flat = np.abs(trapezoid_shape(MOTOR.pole_pairs * theta_m - lag)) == 1.0
        turns = 1.0 - short_a if k == 0 else 1.0
        gap = 1.0 + eccentricity * np.cos(theta_m + phi - lag)
        total += np.where(flat, turns * gap * MOTOR.emf_constant / 2.0, 0.0)
    return total


def filtered_turns(x):
    """Without what is faster than eight times an electrical turn: ripple and commutation."""
    return LowPass(8.0 * MOTOR.pole_pairs * SPEED / (2.0 * math.pi)).apply(x, RATE)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("short", [0.3, 0.8])
def test_a_short_raises_the_current_in_the_sectors_of_its_phase(model, short):
    """Two of three pairs hold the shorted phase; their torque constant falls from 2 to 1 + h."""
    record, current = steady(model, short_a=short)
    expected = needed_torque() / kappa_of_pair(record.motor_position[LATE], short_a=short)
    mean_ratio = (2.0 / 3.0) * 2.0 / (2.0 - short) + 1.0 / 3.0
    healthy = needed_torque() / MOTOR.emf_constant
    assert expected.mean() / healthy == pytest.approx(mean_ratio, rel=0.02)
    if model == "reference":
        # the projection on healthy EMF shapes counts what three phases carry; the envelope is
        # the current of the pair
        current = current_envelope(record)[LATE]
    assert current.mean() == pytest.approx(expected.mean(), rel=0.02)
    assert rms(filtered_turns(current) - filtered_turns(expected)) < 0.05 * rms(expected)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("phase", [0.5, 0.75, 0.1])
def test_eccentricity_modulates_the_current_with_the_rotor_angle_at_its_phase(model, phase):
    faults = {"eccentricity": 0.4, "eccentricity_phase": phase}
    record, current = steady(model, **faults)
    theta = record.motor_position[LATE]
    expected = needed_torque() / kappa_of_pair(theta, **faults)
    assert np.ptp(expected) > 0.3 * expected.mean()
    assert rms(filtered_turns(current) - filtered_turns(expected)) < 0.03 * rms(expected)
    # turned by a quarter, the same modulation does not fit
    turned = {**faults, "eccentricity_phase": (phase + 0.25) % 1.0}
    wrong = needed_torque() / kappa_of_pair(theta, **turned)
    assert rms(current - wrong) > 3.0 * rms(current - expected)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("gain", [0.0, 0.5, 1.0])
def test_gain_sets_how_far_the_output_lags(model, gain):
    """Speed reference = gain times lag, and the speed loop needs T/k to make the torque."""
    record, _ = steady(model, gain=gain)
    lag = (record.command - record.output_position)[LATE].mean() * GEAR.ratio
    reference = SPEED + needed_torque() / CONTROL.speed_gain
    assert lag == pytest.approx(reference / (CONTROL.position_gain * (0.5 + gain)), rel=0.01)


@pytest.mark.parametrize("model", MODELS)
def test_gain_raises_the_current_of_a_fast_motion(model):
    currents = [rms(signed(simulate(model, faults={"gain": k}))) for k in (0.0, 0.25, 0.5, 0.75, 1)]
    assert (np.diff(currents) > 0.0).all()


# There and back at a slow constant speed: the motor crosses the gap once.
TURN = 0.15  # s
BACK_SPEED = 40.0  # rad/s on the motor
PEAK = BACK_SPEED * TURN / GEAR.ratio
BACK = Scenario(
    name="back",
    duration=2.0 * TURN,
    command=[Profile(time=[0.0, TURN, 2.0 * TURN], value=[0.0, PEAK, 0.0])],
)


def crossing(model, backlash):
    """Record, and which samples after the turn have the gap open."""
    record = simulate(model, BACK, {"backlash": backlash})
    half_gap = 0.5 * GEAR.backlash * (1.0 + 99.0 * backlash)
    twist = record.motor_position - record.output_position * GEAR.ratio
    is_open = (np.abs(twist) < half_gap * (1.0 - 1e-6) - 1e-9) & (record.time > TURN)
    return record, twist, half_gap, is_open


@pytest.mark.parametrize("model", MODELS)
def test_backlash_is_the_motion_lost_between_motor_and_output(model):
    _, twist, half_gap, _ = crossing(model, 0.5)
    bend = 1e-3 if model == "reference" else 1e-9  # of the contact, when it is hit
    assert twist.max() == pytest.approx(half_gap, abs=bend)
    assert twist.min() == pytest.approx(-half_gap, abs=bend)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("backlash", [0.1, 0.4, 0.8])
def test_backlash_delays_the_output_and_lets_the_motor_run_ahead_alone(model, backlash):
    """While the output rests, the speed reference grows by gain times the speed of the command.

    So the motor, from rest, crosses the gap with that acceleration, against its own friction.
    """
    record, _, half_gap, is_open = crossing(model, backlash)
    acceleration = CONTROL.position_gain * BACK_SPEED
    resting = (record.output_speed == 0.0) & (record.time > TURN)
    expected = math.sqrt(2.0 * 2.0 * half_gap / acceleration)
    assert resting.sum() / RATE == pytest.approx(expected, abs=5e-4)

    middle = np.flatnonzero(is_open & (record.motor_speed < 0.0))
    middle = middle[len(middle) // 2 : -5]
    torque = (
        MOTOR.friction_torque
        + MOTOR.viscous_damping * np.abs(record.motor_speed[middle])
        + MOTOR.inertia * acceleration
    )
    current = -signed(record)[middle]
    assert current.mean() == pytest.approx(torque.mean() / MOTOR.emf_constant, rel=0.05)


@pytest.mark.parametrize("model", MODELS)
def test_a_wider_gap_ends_in_a_harder_impact(model):
    peaks = []
    for backlash in (0.1, 0.4, 0.8):
        record = crossing(model, backlash)[0]
        peaks.append(np.abs(LOW_PASS.apply(signed(record), RATE)[record.time > TURN]).max())
    assert (np.diff(peaks) > 0.1).all()
