"""From recordings of the reference model to faults, end to end."""

import numpy as np
import pytest

import ematwin
from ematwin.models.pmsm.channels import to_phases, to_rotor
from ematwin.models.pmsm.comparison import PmsmComparison
from ematwin.models.pmsm.model import MODEL
from pmsm_inputs import ACTUATOR

MIXTURE = {"short_b": 0.3, "demagnetisation": 0.25, "friction": 0.4, "sensor_offset_a": 0.7}
ALSO = ("current_d", "current_q", "voltage_d", "voltage_q", "motor_speed")


@pytest.fixture(scope="module")
def mixture():
    return ematwin.simulate(None, None, MIXTURE, ACTUATOR, also=ALSO)


@pytest.fixture(scope="module")
def healthy():
    return ematwin.simulate(None, None, None, ACTUATOR, also=ALSO)


def without(recording, *quantities):
    return recording.changed(**{
        name: None for name in recording.channels if name.startswith(quantities)
    })  # fmt: skip


def test_a_mixture_is_found_under_noise_of_two_per_cent(mixture):
    noisy = ematwin.Noise(white=0.02, bits=12, full_scale=20.0).apply(
        without(mixture, "current_d", "current_q"), np.random.default_rng(1)
    )
    found = ematwin.identify(noisy, ACTUATOR, exact=True)
    truth = MODEL.values_of(ACTUATOR, MIXTURE)
    assert MODEL.error_percent(found.values, truth, ACTUATOR) < 1.0
    assert set(found.present) == set(MIXTURE)
    assert found.verdict.grade == "fault"
    for name in MIXTURE:
        low, high = found.intervals[name]
        assert low <= truth[name] <= high, name
    value, low, high = found.physical_values["demagnetisation"]  # as the flux that is left
    assert low < value < high


def test_voltages_tell_a_short_from_lost_flux(healthy):
    """With them each is sharp; without them the least bounds on either are several times wider."""
    step = 0.01
    errors = []
    for recording in (healthy, without(healthy, "voltage")):
        comparison = PmsmComparison(recording, ACTUATOR)
        names = ["demagnetisation", "short_a", "friction", "sensor_gain_a", "sensor_gain_b"]
        base = [MODEL.unknown(ACTUATOR, name).healthy for name in names]
        rows = np.vstack([base, base + step * np.eye(len(names))])
        residuals = comparison.residuals(dict(zip(names, rows.T, strict=True)), len(rows))
        jacobian = (residuals[1:] - residuals[0]) / step
        errors.append(np.sqrt(np.diag(np.linalg.inv(jacobian @ jacobian.T))))
    assert errors[1][0] > 3.0 * errors[0][0]


def test_phases_and_rotating_channels_are_the_same_recording(healthy):
    by_phases = PmsmComparison(without(healthy, "current_d", "current_q", "voltage_d", "voltage_q"),
                               ACTUATOR)  # fmt: skip
    rotating = PmsmComparison(
        without(healthy, *(f"{q}_{x}" for q in ("current", "voltage") for x in "abc")), ACTUATOR
    )
    for name, trace in by_phases.measured().items():
        np.testing.assert_allclose(rotating.measured()[name], trace, atol=1e-9)


def test_park_transformation_goes_there_and_back():
    random = np.random.default_rng(0)
    d, q, angle = random.normal(size=(3, 50))
    np.testing.assert_allclose(to_rotor(*to_phases(d, q, angle), angle), [d, q], atol=1e-12)


@pytest.mark.parametrize("rate", [5000.0, 2500.0])
def test_each_second_or_fourth_sample_will_do(rate):
    slow = ematwin.simulate(None, None, {"friction": 0.5}, ACTUATOR, sample_rate=rate)
    found = ematwin.identify(slow, ACTUATOR, exact=True, only=["friction", "gain", "short_a"])
    assert found.values["friction"] == pytest.approx(0.5, abs=0.02)
    assert found.values["short_a"] == pytest.approx(0.0, abs=0.02)


def test_a_start_that_turns_with_the_resolver_is_held(healthy):
    """The motor begins where it was read, whatever the resolver's slip: no jump of the twin."""
    comparison = PmsmComparison(healthy, ACTUATOR)
    slips = np.array([0.5, 0.3, 0.9])
    answer = comparison.responses({"resolver_offset": slips}, 3)
    for row in answer["motor_speed"]:
        assert np.abs(row[:150]).max() < 1.0
