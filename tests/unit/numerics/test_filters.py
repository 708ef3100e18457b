"""Shifting by cubic convolution, beside its definition."""

import numpy as np

from ematwin.numerics.filters import advanced, compare
from naive import signals


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
