"""Recordings that are sampled faster than they are compared."""

import numpy as np
import pytest

import ematwin
from ematwin import Recording
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.sampling import averaged

MODEL = model_of(load_actuator("servo48"))


def recording(rate: float, samples: int) -> Recording:
    time = 3.0 + np.arange(samples) / rate
    return Recording(
        time, {"command": np.arange(float(samples)), "current_a": np.arange(float(samples)) ** 2},
        units={"command": "rad"}, labels={"run": "1"}, source="a.csv",
        provenance={"changed": ["something else"]},
    )  # fmt: skip


def test_currents_become_means_over_the_longer_interval_and_the_rest_keeps_every_so_many() -> None:
    found = averaged(recording(100e3, 13), 20e3, {"current_a"})
    np.testing.assert_allclose(found.time, 3.0 + np.array([0, 5, 10]) / 100e3)
    np.testing.assert_array_equal(found.command, [0.0, 5.0, 10.0])
    squares = np.arange(13.0) ** 2
    np.testing.assert_allclose(
        found.channels["current_a"], [0.0, squares[1:6].mean(), squares[6:11].mean()]
    )
    assert found.units == {"command": "rad"}
    assert (found.labels, found.source) == ({"run": "1"}, "a.csv")
    assert found.provenance["changed"] == [
        "something else",
        "samples were averaged from 100000 to 20000 Hz, as many as are compared",
    ]


@pytest.mark.parametrize("rate", [1e3, 20e3, 39.9e3])
def test_a_recording_that_has_no_double_of_the_rate_stays_itself(rate: float) -> None:
    one = recording(rate, 50)
    assert averaged(one, 20e3, {"current_a"}) is one


def test_a_rate_that_is_no_multiple_stays_above() -> None:
    assert averaged(recording(50e3, 101), 20e3, set()).sample_rate == pytest.approx(25e3)


def test_fast_currents_are_averaged_to_those_of_a_slower_simulation() -> None:
    slow, fast = (ematwin.simulate("monitor", sample_rate=rate) for rate in (20e3, 100e3))
    found = MODEL.averaged(fast)
    assert len(found) == len(slow)
    np.testing.assert_allclose(found.time, slow.time, atol=1e-12)
    away = np.abs(found.current - slow.current)
    # steps of 10 and 50 us: they differ in the one or two samples behind an impact
    assert np.sqrt(np.mean(away**2)) < 0.015 * np.sqrt(np.mean(slow.current**2))
    assert np.median(away) < 1e-4 * np.sqrt(np.mean(slow.current**2))


def test_power_is_a_product_of_samples_and_keeps_all_of_them() -> None:
    fast = ematwin.simulate("monitor", sample_rate=100e3)
    with_supply = fast.changed(bus_current=np.ones(len(fast)))
    assert MODEL.averaged(with_supply) is with_supply


def test_a_fast_recording_is_identified_and_shown_as_it_is_compared() -> None:
    faults = {"friction": 0.3, "backlash": 0.05}
    fast = ematwin.simulate("reference", faults=faults, sample_rate=100e3)
    found = ematwin.identify(fast, exact=True)
    assert found.faults.as_dict()["friction"] == pytest.approx(0.3, abs=0.01)
    assert found.faults.as_dict()["backlash"] == pytest.approx(0.05, abs=0.01)
    assert found.recording is not None
    assert found.recording.sample_rate == pytest.approx(20e3)
    assert any("averaged from 100000" in text for text in found.provenance["changed"])
    assert len(fast) == 50_001  # that of the caller is left alone
