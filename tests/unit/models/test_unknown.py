"""One table says what is unknown of an actuator; everything else is derived from it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ematwin import BldcActuator, Faults
from ematwin.errors import InputError
from ematwin.models.bldc.faults import UNKNOWNS, error_percent_wrapped
from ematwin.models.chart import Chart
from ematwin.models.registry import model_of
from ematwin.models.sensors import as_sensed, sensors_of
from ematwin.models.unknown import Unknown

ACTUATOR = BldcActuator.load()


def test_the_laws_are_those_of_the_kernel() -> None:
    from ematwin.models.bldc.constants import fault_state, kernel_constants

    k = [0.25, 0.5, 0.1, 0.2, 0.3, 0.4, 0.7, 0.9]
    half_gap = kernel_constants(ACTUATOR).half_gap
    state = fault_state.py_func(k, half_gap)
    told = {row.name: row.value for row in Faults.of(np.array(k)).physical(ACTUATOR)}
    torque = ACTUATOR.motor.friction_torque + ACTUATOR.transmission.friction_torque
    assert told["friction"] == pytest.approx(torque * state.friction)
    assert told["backlash"] == pytest.approx(2.0 * state.half_gap)
    assert told["short_b"] == pytest.approx(ACTUATOR.motor.turns_per_phase * (1.0 - state.h_b))
    assert told["gain"] == pytest.approx(ACTUATOR.controller.position_gain * state.gain)
    angle = np.arctan2(state.zeta_sin, state.zeta_cos)
    assert told["eccentricity_phase"] == pytest.approx(np.degrees(angle))


def test_impossible_unknowns_are_refused() -> None:
    for values, said in (
        ((2.0, 0.0, 1.0), "healthy value between"),
        ((0.5, 1.0, 0.0), "lower < upper"),
    ):
        with pytest.raises(InputError, match=said):
            Unknown("x", "", "", *values)
    with pytest.raises(InputError, match="positive lower bound"):
        Unknown("x", "", "", 0.5, 0.0, 1.0, logarithmic=True)
    with pytest.raises(InputError, match="positive spread"):
        Unknown("x", "", "", 0.5, 0.0, 1.0, spread=0.0)


def test_a_name_that_there_is_not_is_refused_with_the_closest() -> None:
    model = model_of("bldc")
    for name, close in (("fricton", "friction"), ("motor.resistence", "motor.resistance")):
        with pytest.raises(InputError, match=f"Did you mean {close}"):
            model.unknown(ACTUATOR, name)


# The coordinates in which slopes are followed

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


# Gain and offset of sensors, and a command that was recorded late


def test_an_answer_is_scaled_moved_and_read_later():
    time = np.arange(400) * 1e-3
    traces = np.sin(40.0 * time) * np.array([[1.0], [2.0], [3.0]])
    values = {
        "x_gain": np.array([1.0, 1.1, 1.0]), "x_offset": np.array([0.0, 0.02, 0.0]),
        "skew": np.array([0.0, 0.0, 0.4e-3]),
    }  # fmt: skip
    seen = as_sensed({"x": traces}, values, {"x": 5.0}, 1e-3)["x"]
    np.testing.assert_array_equal(seen[0], traces[0])
    np.testing.assert_allclose(seen[1], 1.1 * traces[1] + 0.02 * 5.0)
    later = 3.0 * np.sin(40.0 * (time + 0.4e-3))
    np.testing.assert_allclose(seen[2, 20:-20], later[20:-20], atol=1e-5)


def test_an_author_who_states_sensors_gets_the_time_of_the_command_alone():
    channels = "x", "y"
    every = sensors_of(channels, 1000.0, ())
    assert {one.name for one in every} == {"skew", "x_gain", "x_offset", "y_gain", "y_offset"}
    assert [one.name for one in sensors_of(channels, 1000.0, {"my_gain"})] == ["skew"]
    assert not sensors_of(channels, 1000.0, {"my_gain", "skew"})
