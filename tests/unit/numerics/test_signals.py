"""Low-pass, beside that of scipy; white noise; cubic convolution, beside its definition."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi

from ematwin.numerics.filters import advanced, compare
from ematwin.numerics.signals import LowPass, filtered, white_noise
from naive import signals

TIME = np.arange(10_000) / 20_000.0
MOTION = 5.0 * np.sin(2.0 * np.pi * 40.0 * TIME) + 3.0 * TIME


@pytest.mark.parametrize("rate", [2_000.0, 20_000.0])
@pytest.mark.parametrize("cutoff", [50.0, 100.0, 500.0])
def test_taps_and_signals_are_those_of_scipy(rate, cutoff):
    b, a = butter(2, cutoff, fs=rate)
    taps = LowPass(cutoff).taps(rate, 3.0)
    np.testing.assert_allclose(taps[:3], b, rtol=1e-9)
    np.testing.assert_allclose(taps[3:5], a[1:], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(taps[5:], 3.0 * lfilter_zi(b, a), rtol=1e-9)
    signal = np.random.default_rng(1).standard_normal(500)
    signal[0] = 3.0
    expected, state = lfilter(taps[:3], np.r_[1.0, taps[3:5]], signal, zi=taps[5:])
    found, after = filtered(taps, signal)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(after, state, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(LowPass(cutoff).apply(signal, rate), found)


def test_a_signal_in_parts_is_filtered_as_a_whole():
    signal = np.random.default_rng(2).standard_normal(300)
    taps = LowPass(200.0).taps(5e3, 0.0)
    whole, _ = filtered(taps, signal)
    first, state = filtered(taps, signal[:120])
    second, _ = filtered(np.r_[taps[:5], state], signal[120:])
    np.testing.assert_array_equal(np.r_[first, second], whole)


@pytest.mark.parametrize("cutoff", [50.0, 100.0, 500.0])
def test_white_noise_passes_as_far_as_the_impulse_response_says(cutoff):
    impulse = np.zeros(20_000)
    impulse[1] = 1.0
    response = LowPass(cutoff).apply(impulse, 20_000.0)
    assert LowPass(cutoff).noise_gain(20_000.0) == pytest.approx(response @ response, rel=0.02)


@pytest.mark.parametrize("size", [1e-3, 0.1, 2.0])
def test_noise_is_found_beneath_a_motion(size):
    noise = size * np.random.default_rng(1).standard_normal(TIME.size)
    assert white_noise(MOTION + noise) == pytest.approx(size, rel=0.05)


def test_commutations_are_no_noise():
    noise = 0.1 * np.random.default_rng(2).standard_normal(TIME.size)
    steps = 4.0 * (np.arange(TIME.size) // 200 % 2)
    assert white_noise(MOTION + steps + noise) == pytest.approx(0.1, rel=0.1)


def test_rows_are_what_the_definition_gives():
    rng = np.random.default_rng(3)
    rows, shift = rng.standard_normal((6, 25)), np.array([0.0, 0.3, -4.7, 24.5, -70.0, 1e9])
    expected = [signals.advanced(row, s) for row, s in zip(rows, shift, strict=True)]
    assert np.allclose(advanced(rows, shift), expected, rtol=0.0, atol=1e-13)


def test_rows_are_compared_with_what_was_recorded_earlier_and_with_nothing_else():
    rng = np.random.default_rng(5)
    target, roots = rng.standard_normal(60), rng.uniform(0.0, 2.0, 60)
    starts, stride = np.array([0, 30]), 7
    shift = np.array([0.0, 1.3, -2.75, 16.2, -29.4, 80.0, -1e9])
    rows = rng.standard_normal((len(shift), 2, 4))
    places = starts[:, None] + stride * np.arange(4)
    expected = [
        (row - np.array(signals.advanced(target, -s))[places])
        * np.interp(places - s, np.arange(-1, 61), [0.0, *roots, 0.0])
        for row, s in zip(rows, shift, strict=True)
    ]
    compare(rows, target, roots, starts, stride, shift)
    assert np.allclose(rows, expected, rtol=0.0, atol=1e-12)
