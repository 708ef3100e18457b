"""Sensors of any kind: gain, offset, and a command that was recorded late."""

import numpy as np

from ematwin.models.sensors import as_sensed, sensors_of


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
