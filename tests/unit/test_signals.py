"""Equivalent current, low-pass, misfit and noise."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.errors import InputError
from ematwin.models.bldc.channels import (
    PHASES,
    current_envelope,
    phase_currents,
    signed_current,
    trapezoid_shape,
)
from ematwin.numerics.signals import LowPass, SlopeWeighting
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording
from naive import motor as naive_motor
from naive import signals as naive_signals

RATE = 20_000.0
POLE_PAIRS = 2


def misfit(measured, simulated, interval, weighting=None):
    weights = (weighting or SlopeWeighting()).weights(measured, interval)
    return float(np.sum(weights * (measured - simulated) ** 2))


signals = st.lists(st.floats(-20.0, 20.0), min_size=8, max_size=60).map(np.array)


def three_phases(theta_m, amplitude):
    """Record of a commutated motor: the pair on its flats carries ``amplitude``, signed."""
    theta_m = np.asarray(theta_m)
    amplitude = np.broadcast_to(amplitude, theta_m.shape)
    phases = np.array(
        [
            np.array(naive_motor.gates(naive_motor.sector(POLE_PAIRS * x), 1)) * a
            for x, a in zip(theta_m, amplitude, strict=True)
        ]
    )
    time = np.arange(theta_m.size) / RATE
    return Recording(
        time=time, command=np.zeros(time.size), motor_position=theta_m,
        **dict(zip(PHASES, phases.T, strict=True)),
    )  # fmt: skip


def single(current):
    time = np.arange(len(current)) / RATE
    return Recording(
        time=time, command=np.zeros(time.size), current=np.asarray(current, dtype=float)
    )


# Equivalent current


@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=2, max_size=20))
def test_envelope_of_currents_that_sum_to_zero_is_the_largest(pairs):
    a, b = np.array(pairs).T
    phases = np.column_stack([a, b, -a - b])
    record = three_phases(np.zeros(len(pairs)), 0.0).changed(
        current_a=phases[:, 0], current_b=phases[:, 1], current_c=phases[:, 2]
    )
    np.testing.assert_allclose(
        current_envelope(record), np.abs(phases).max(axis=1), rtol=1e-12, atol=1e-12
    )


def test_both_forms_give_the_current_of_the_pair():
    theta = np.linspace(0.01, 2.0 * math.pi, 500)
    amplitude = 3.0 * np.cos(5.0 * theta)
    record = three_phases(theta, amplitude)
    np.testing.assert_allclose(current_envelope(record), np.abs(amplitude), atol=1e-12)
    np.testing.assert_allclose(signed_current(record, POLE_PAIRS), amplitude, atol=1e-9)


def test_projection_makes_the_torque_of_a_healthy_motor():
    """k_e times sum f_k i_k is the torque, and 2 k_e that of the equivalent current."""
    rng = np.random.default_rng(3)
    theta = rng.uniform(0.0, 20.0, 200)
    record = three_phases(theta, 0.0)
    a, b = rng.normal(size=(2, theta.size))
    record = record.changed(current_a=a, current_b=b, current_c=-a - b)
    torque = [
        sum(
            naive_motor.trapezoid(POLE_PAIRS * x - 2.0 * math.pi * k / 3.0) * i
            for k, i in enumerate(currents)
        )
        for x, currents in zip(theta, phase_currents(record), strict=True)
    ]
    np.testing.assert_allclose(2.0 * signed_current(record, POLE_PAIRS), torque, atol=1e-9)


@given(st.floats(-1e3, 1e3))
def test_shape_is_the_trapezoid_of_the_naive_version(theta):
    assert trapezoid_shape(np.array([theta]))[0] == pytest.approx(
        naive_motor.trapezoid(theta), abs=1e-9
    )


def test_sign_is_not_guessed():
    assert signed_current(single([1.0, 2.0, 3.0]), POLE_PAIRS) is None
    np.testing.assert_array_equal(signed_current(single([1.0, -2.0]), POLE_PAIRS), [1.0, -2.0])
    assert signed_current(three_phases([0.0, 0.1], 1.0).changed(motor_position=None), 2) is None


def test_envelope_of_an_equivalent_current_is_its_magnitude():
    np.testing.assert_array_equal(current_envelope(single([1.0, -2.0, 0.5])), [1.0, 2.0, 0.5])


@given(signals, st.floats(50.0, 5000.0))
def test_low_pass_is_the_explicit_recursion(signal, cutoff):
    expected = naive_signals.low_pass(signal, cutoff, RATE)
    np.testing.assert_allclose(LowPass(cutoff).apply(signal, RATE), expected, atol=1e-8)


# Misfit


@given(signals, st.integers(0, 2**32 - 1), st.sampled_from([1.0, 500.0]))
def test_misfit_is_equation_2_of_the_paper(measured, seed, scale):
    simulated = measured + np.random.default_rng(seed).normal(size=measured.size)
    seen = misfit(measured, simulated, 1.0 / RATE, SlopeWeighting(scale))
    expected = naive_signals.misfit(measured, simulated, 1.0 / RATE, scale)
    assert seen == pytest.approx(expected, rel=1e-9)


def test_a_shift_in_time_counts_less_where_the_current_is_steep():
    """The point of total least squares: a lag costs by slope squared, the weight takes one back."""
    time = np.arange(2000) / RATE
    costs = []
    for slope in (1e3, 4e3):
        ramp = slope * time
        costs.append(misfit(ramp, ramp - slope * 1e-4, 1.0 / RATE, SlopeWeighting(1.0)))
    assert costs[1] / costs[0] == pytest.approx(4.0, rel=1e-3)  # least squares would give 16


# Noise


@given(st.integers(2, 16), signals)
def test_a_converter_gives_whole_steps_and_errs_by_half_a_step(bits, signal):
    seen = Noise(bits=bits, full_scale=25.0).apply(single(signal), np.random.default_rng(0)).current
    step = 50.0 / 2**bits
    np.testing.assert_allclose(seen / step, np.round(seen / step), atol=1e-9)
    inside = signal < 25.0 - step  # the highest code lies a step below full scale
    assert (np.abs(seen - signal)[inside] <= 0.5 * step + 1e-12).all()
    assert len(np.unique(seen)) <= 2**bits


def test_a_converter_saturates_at_full_scale():
    seen = Noise(bits=8, full_scale=10.0).apply(single([-30.0, 30.0]), np.random.default_rng(0))
    np.testing.assert_allclose(seen.current, [-10.0, 10.0 - 20.0 / 256])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("white=0.02", Noise(white=0.02)),
        ("white=0.02, offset=0.05,bits=12,full_scale=30", Noise(0.02, 0.05, 12, 30.0)),
    ],
)
def test_noise_is_read_from_text(text, expected):
    assert Noise.parse(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pink=0.1", "Noise knows white"),
        ("white=loud", "must be a number"),
        ("bits=12.5", "must be a whole number"),
        ("white=-0.1", "share of at least 0"),
        ("bits=1", "2 to 32 bits"),
        ("offset=nan", "number of amperes"),
        ("full_scale=0", "positive amperes"),
    ],
)
def test_impossible_noise_is_refused_in_one_sentence(text, message):
    with pytest.raises(InputError, match=message):
        Noise.parse(text)
