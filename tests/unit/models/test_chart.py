"""The coordinates in which slopes are followed."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ematwin.models.bldc.faults import Faults, error_percent_wrapped
from ematwin.models.bldc.unknowns import UNKNOWNS, fault
from ematwin.models.chart import Chart
from ematwin.models.unknown import Unknown

vectors = arrays(float, (3, 8), elements=st.floats(0.0, 1.0))
MASS = Unknown("mass", "kg", "of the nut", 2.0, 0.5, 8.0, logarithmic=True)


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


def test_a_magnitude_and_its_direction_are_the_components_of_a_vector() -> None:
    chart = Chart([fault("eccentricity"), fault("eccentricity_phase")])
    z = chart.from_values(np.array([[0.4, 0.75]]))[0]
    assert np.allclose(z, [0.4 * np.cos(np.pi / 2), 0.4])
    assert chart.names == ("eccentricity x", "eccentricity y")


def test_a_direction_alone_is_searched_as_an_angle() -> None:
    chart = Chart([fault("eccentricity_phase")])
    assert chart.lower == [0.0]
    assert chart.to_values(np.array([[0.9]])) == [[0.9]]


def test_opposite_ends_of_the_phase_are_one_point() -> None:
    k = np.tile(Faults(eccentricity=0.5).vector, (2, 1))
    k[:, 6] = [0.0, 1.0]
    z = Chart(UNKNOWNS).from_values(k)
    assert np.allclose(z[0], z[1])


def test_a_logarithmic_unknown_is_even_in_its_ratios() -> None:
    chart = Chart([MASS])
    assert np.allclose(chart.from_values(np.array([[0.5], [2.0], [8.0]])), [[0.0], [0.5], [1.0]])
    assert np.allclose(chart.from_unit(np.array([[0.5]])), 2.0)


def test_unscaled_ranges_become_shares() -> None:
    chart = Chart([Unknown("load", "N", "", 0.0, -100.0, 300.0)])
    assert np.allclose(chart.from_values(np.array([[100.0]])), 0.5)
    assert np.allclose(chart.to_values(np.array([[0.5]])), 100.0)
