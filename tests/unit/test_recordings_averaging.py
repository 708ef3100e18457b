"""Recordings that are sampled faster than they are compared."""

import numpy as np
import pytest

import ematwin
from ematwin.models.registry import load_actuator, model_of

MODEL = model_of(load_actuator("servo48"))


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
