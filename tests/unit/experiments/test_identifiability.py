"""Identifiability of faults, beside what is known of it otherwise."""

import json
import math

import numpy as np
import pytest

import ematwin
from ematwin.estimation.constants import SMALLEST
from ematwin.experiments.identifiability import ranked
from ematwin.models.scenario import Scenario

NOISE = ematwin.Noise(white=0.02, bits=12)


@pytest.fixture(scope="module")
def sheet():
    return ematwin.identifiability(noise=NOISE)


@pytest.fixture(scope="module")
def exact():
    return ematwin.identifiability(noise=NOISE, exact=True)


def test_unknown_parameters_only_widen(sheet, exact):
    for one in exact.told:
        assert one.error == pytest.approx(one.sharp_error, rel=1e-6)
        assert sheet[one.name].error >= 0.8 * one.error
        assert sheet[one.name].sharp_error == pytest.approx(one.error, rel=0.5)
    assert all(one.how == "pinned" for one in exact.told)


def test_what_a_fault_multiplies_is_named_as_what_it_is_traded_off_against(sheet):
    partners = {
        "friction": "friction_torque", "backlash": "transmission.backlash",
        "gain": "controller.position_gain",
    }  # fmt: skip
    for fault, place in partners.items():
        assert sheet[fault].how == "traded"
        name, correlation = sheet[fault].partners[0]
        assert place in name
        assert correlation < -0.9
        assert name in sheet[fault].sentence


def test_of_equal_shorts_the_difference_is_known_and_the_sum_is_not(sheet):
    assert sheet.contrasts["short_common"] > 20.0 * sheet.contrasts["short_a_beyond_common"]


def test_the_smallest_fault_follows_from_the_rates(sheet):
    strict = ematwin.identifiability(noise=NOISE, false_alarm=1e-4, miss=0.01)
    for one, other in zip(sheet.told, strict.told, strict=True):
        assert one.smallest >= SMALLEST * one.range
        assert other.smallest >= one.smallest
    one = sheet["short_a"]  # 3 + 1.2816 standard errors
    assert one.smallest == pytest.approx(4.2815 * one.error, rel=1e-3)
    assert one.physical.value == pytest.approx(one.smallest * 40.0, rel=1e-6)  # turns


def test_a_motion_within_the_gap_reveals_nothing(exact):
    chirp = [{"type": "chirp", "amplitude": 20e-6, "f_start": 5.0, "f_end": 25.0}]
    still = ematwin.identifiability(
        Scenario(name="still", duration=0.5, command=chirp), noise=NOISE, exact=True
    )
    assert "turn" in still.obstacles[0]
    assert all(one.smallest == math.inf and one.physical is None for one in still.told)
    assert "null" in json.dumps(still.as_dict(), allow_nan=False)
    assert ranked([still, exact]) == [exact, still]


def test_another_kind_is_asked_alike():
    found = ematwin.identifiability(actuator="rm1605")
    assert {one.name for one in found.told} == {"friction", "backlash", "gain"}
    assert np.allclose(np.diag(found.correlation), 1.0)
    assert np.abs(found.correlation).max() < 1.0 + 1e-9


def test_it_is_the_standard_error_that_identify_states():
    faults = {
        "friction": 0.3, "backlash": 0.3, "short_a": 0.2, "short_b": 0.3, "short_c": 0.4,
        "eccentricity": 0.3, "eccentricity_phase": 0.3, "gain": 0.4,
    }  # fmt: skip
    noise = ematwin.Noise(white=0.02)
    record = ematwin.simulate("reference", faults=faults, noise=noise, seed=8)
    found = ematwin.identify(record, exact=True)
    expected = ematwin.identifiability(faults=faults, noise=noise, exact=True)
    ratios = [one.error / found.estimate.standard_errors[one.name] for one in expected.told]
    assert 0.8 < float(np.median(ratios)) < 1.3
    assert all(0.4 < one < 2.5 for one in ratios)
