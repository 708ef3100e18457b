"""Traces with fewer samples."""

import numpy as np
import pytest

from ematwin.numerics.means import means


def test_a_mean_stands_at_the_last_of_its_samples():
    assert means(np.array([7.0, 1.0, 3.0, 5.0, 9.0]), 2).tolist() == [7.0, 2.0, 7.0]


@pytest.mark.parametrize(("size", "stride"), [(11, 3), (10, 3), (1, 3), (4, 1)])
def test_there_are_as_many_as_samples_that_are_that_far_apart(size, stride):
    trace = np.arange(float(size))
    assert means(trace, stride).size == trace[::stride].size
    if stride == 1:
        assert (means(trace, stride) == trace).all()
