"""The fault laws of the paper, section 6."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ematwin.models.bldc import state

shares = st.floats(0.0, 1.0)


@given(st.tuples(*[shares] * 8))
def test_fault_states_are_the_magnitudes_of_the_paper(values):
    k = np.array(values)
    f = state.fault_state(k, 0.0025)
    assert f.friction == pytest.approx(1.0 + 2.0 * k[0])
    assert 2.0 * f.half_gap == pytest.approx(0.005 * (1.0 + 99.0 * k[1]))
    assert (f.h_a, f.h_b, f.h_c) == tuple(1.0 - k[2:5])
    phi = 2.0 * math.pi * (k[6] - 0.5)
    assert f.zeta_cos == pytest.approx(k[5] * math.cos(phi))
    assert f.zeta_sin == pytest.approx(k[5] * math.sin(phi))
    assert f.gain == pytest.approx(0.5 + k[7])
