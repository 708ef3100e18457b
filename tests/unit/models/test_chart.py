"""The coordinates in which slopes are followed."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ematwin.models.bldc.faults import UNKNOWNS, error_percent_wrapped
from ematwin.models.chart import Chart

vectors = arrays(float, (3, 8), elements=st.floats(0.0, 1.0))


@given(vectors)
def test_coordinates_of_a_fault_vector_lead_back_to_it(k: np.ndarray) -> None:
    chart = Chart(UNKNOWNS)
    back = chart.to_values(chart.from_values(k))
    assert np.allclose(error_percent_wrapped(back, k), 0.0, atol=1e-6)


@given(arrays(float, (4, 8), elements=st.floats(-3.0, 3.0)))
def test_projected_points_are_fault_vectors(z: np.ndarray) -> None:
    chart = Chart(UNKNOWNS)
    inside = chart.project(z)
    assert (inside >= chart.lower).all()
    assert (inside <= chart.upper).all()
    k = chart.to_values(inside)
    assert (k >= 0.0).all()
    assert (k <= 1.0).all()
    assert np.allclose(chart.project(inside), inside)
