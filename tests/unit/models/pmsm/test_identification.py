"""From recordings of the reference model to faults, end to end."""

import re

import numpy as np
import pytest

import ematwin
from ematwin.models.pmsm.channels import TERMINALS
from ematwin.models.pmsm.comparison import PmsmComparison
from ematwin.models.pmsm.model import MODEL
from ematwin.models.pmsm.unknowns import constants_of
from ematwin.models.reading import read
from ematwin.recordings.recording import Recording
from pmsm_inputs import ACTUATOR, bristles

MIXTURE = {"short_b": 0.3, "demagnetisation": 0.25, "friction": 0.4, "sensor_offset_a": 0.7}
OTHERS = {
    "backlash": 0.4, "gain": 0.7, "static_eccentricity": 0.3, "static_direction": 0.6,
    "dynamic_eccentricity": 0.3, "dynamic_direction": 0.4, "connector_c": 0.4,
    "sensor_gain_a": 0.7, "resolver_offset": 0.7,
}  # fmt: skip
ALSO = ("current_d", "current_q", "voltage_d", "voltage_q", "motor_speed")


@pytest.fixture(scope="module")
def healthy():
    return ematwin.simulate(None, None, None, ACTUATOR, also=ALSO)


def without(recording, *quantities):
    return recording.changed(**{
        name: None for name in recording.channels if name.startswith(quantities)
    })  # fmt: skip


def identified(recording, faults):
    """With a noise of two per cent; each fault is found, and no other."""
    noisy = ematwin.Noise(white=0.02, bits=12, full_scale=20.0).apply(
        recording, np.random.default_rng(1)
    )
    found = ematwin.identify(noisy, ACTUATOR, exact=True)
    truth = MODEL.values_of(ACTUATOR, faults)
    assert MODEL.study.error_percent(MODEL.faults(ACTUATOR), found.values, truth) < 1.0
    assert set(found.present) == {name for name in faults if "direction" not in name}
    assert found.verdict.grade == "fault"
    for name in faults:
        low, high = found.intervals[name]
        assert low <= truth[name] <= high, name
    return found


def test_a_mixture_is_found_by_the_voltages_that_are_commanded():
    recording = ematwin.simulate(None, None, OTHERS, ACTUATOR, also=ALSO)
    identified(without(recording, "current_d", "current_q"), OTHERS)


def test_another_is_found_by_the_voltages_that_are_measured():
    recording = ematwin.simulate(None, None, MIXTURE, ACTUATOR, also=TERMINALS)
    measured = without(recording, "voltage")
    assert MODEL.check(measured, ACTUATOR) == []
    found = identified(measured, MIXTURE)
    value, low, high = found.physical_values["demagnetisation"]  # as the flux that is left
    assert low <= value <= high


def test_faults_to_which_no_descent_from_healthy_leads_are_found_by_a_search():
    faults = {
        "connector_b": 0.18, "sensor_gain_a": 0.43, "short_a": 0.64, "gain": 0.44,
        "dynamic_eccentricity": 0.79, "dynamic_direction": 0.15,
    }  # fmt: skip
    found = ematwin.identify(ematwin.simulate(None, None, faults, ACTUATOR), ACTUATOR, exact=True)
    for name, value in faults.items():
        assert found.values[name] == pytest.approx(value, abs=0.03)


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


def test_each_fourth_sample_will_do():
    slow = ematwin.simulate(None, None, {"friction": 0.5}, ACTUATOR, sample_rate=2500.0)
    found = ematwin.identify(slow, ACTUATOR, exact=True, only=["friction", "gain", "short_a"])
    assert found.values["friction"] == pytest.approx(0.5, abs=0.02)
    assert found.values["short_a"] == pytest.approx(0.0, abs=0.02)


def test_a_drive_that_crept_before_the_recording_rests_where_it_did():
    """A current offset pushes the motor through the gap, against bristles that give."""
    built = ACTUATOR.changed(bristles(50.0, 30.0))
    faults = {"sensor_offset_b": 0.8}
    recording = ematwin.simulate(None, None, faults, built)
    assert abs(recording.channels["motor_position"][0]) > 0.01
    comparison = PmsmComparison(recording, built)
    answer = comparison.exact(MODEL.values_of(built, faults))
    for name, trace in comparison.measured().items():
        np.testing.assert_allclose(answer[name], trace, atol=1e-9)


def test_a_start_that_turns_with_the_resolver_is_held(healthy):
    """The motor stands still, whatever the resolver's slip: no jump of the twin."""
    comparison = PmsmComparison(healthy, ACTUATOR)
    slips = np.array([0.5, 0.3, 0.9])
    answer = comparison.responses({"resolver_offset": slips}, 3)
    for row in answer["motor_speed"]:
        assert np.abs(row[:150]).max() < 1.0


def test_a_short_is_told_with_the_contact_that_it_holds_for():
    found, healthy = (
        ematwin.identify(
            ematwin.simulate(None, None, faults, ACTUATOR), ACTUATOR, exact=True,
            only=["short_a", "friction"],
        )
        for faults in ({"short_a": 0.3}, None)
    )  # fmt: skip
    (said,) = [one for one in found.warnings if "motor.short_resistance" in one]
    alike = float(re.search(r"look like ([\d.]+) % over twice", said)[1]) / 100.0
    # a tenth over the contact of the file, as a fault, and what it is said to look like
    other = ACTUATOR.changed({"motor.short_resistance": 2.0 * ACTUATOR.motor.short_resistance})
    drawn = [
        constants_of(one, {"short_a": (share / 0.3) ** 2}, 5e-5).loop_a
        for one, share in ((ACTUATOR, 0.1), (other, alike))
    ]
    assert drawn[1] == pytest.approx(drawn[0], rel=0.1)  # two digits are said
    assert not any("short_resistance" in one for one in healthy.warnings)


def test_a_short_and_its_contact_are_one_number():
    """The contact stays where it is known to be, and widens the interval of the share."""
    values = {"short_a": 0.5, "short_resistance": 0.5}
    (alias,) = [one for one in MODEL.aliases(ACTUATOR, values) if one.pivot == "short_resistance"]
    assert alias.held
    assert alias.multiplies
    step = 1e-4
    grown = 0.5 * (1.0 - step * alias.same["short_a"])
    beside = {"short_a": grown, "short_resistance": 0.5 + step}
    drawn = [
        constants_of(ACTUATOR, one, 1e-4).loop_a
        for one in (values, beside, values | {"short_resistance": 0.5 + step})
    ]
    assert drawn[1] == pytest.approx(drawn[0], rel=1e-7)
    assert drawn[2] < drawn[0] * (1.0 - 1e-5)


def test_a_cold_winding_is_a_connector_in_each_phase_whatever_is_there(healthy):
    comparison = PmsmComparison(healthy, ACTUATOR)
    names = ("motor.resistance", "connector_a", "connector_b", "connector_c", "short_a")
    point = dict(zip(names, (ACTUATOR.motor.resistance, 0.1, 0.4, 0.7, 0.01), strict=True))
    (alias,) = [one for one in MODEL.aliases(ACTUATOR, point) if one.pivot == names[0]]
    step = 1e-3
    colder = {**point, names[0]: point[names[0]] * (1.0 - step)}
    beside = {n: x + step * alias.same.get(n, 0.0) for n, x in colder.items()}
    rows = {n: np.array([one[n] for one in (point, colder, beside)]) for n in names}
    here, alone, together = comparison.residuals(rows, 3)
    assert np.linalg.norm(together - here) < 0.02 * np.linalg.norm(alone - here)


def test_a_short_is_certain_whatever_its_contact():
    """Its share is as vague as the contact, which counts as a factor: no short stays none."""
    noisy = ematwin.simulate(None, None, {"short_b": 0.3}, ACTUATOR, noise=ematwin.Noise(0.02))
    found = ematwin.identify(noisy, ACTUATOR)
    low, high = found.intervals["short_b"]
    assert found.probabilities["short_b"] > 0.99
    assert low > 0.05
    assert high - low > 0.2
    assert found.intervals["short_a"][1] < 0.01


def test_voltages_may_be_measured_from_line_to_line_or_against_any_point():
    recording = without(ematwin.simulate(None, None, MIXTURE, ACTUATOR, also=TERMINALS), "voltage")
    phases = {name: recording.channels[name] for name in TERMINALS}
    a, b, c = phases.values()
    shifted = recording.changed(**{name: volts + 12.0 for name, volts in phases.items()})
    lines = Recording(
        recording.time,
        {n: v for n, v in recording.channels.items() if n not in TERMINALS}
        | {"line_voltage_ab": a - b, "line_voltage_bc": b - c},
        units=recording.units,
    )
    one = PmsmComparison(recording, ACTUATOR).measured()
    for other in (shifted, read(lines.to_dataframe(), actuator=ACTUATOR)):
        again = PmsmComparison(other, ACTUATOR).measured()
        for name in ("voltage_d", "voltage_q"):
            np.testing.assert_allclose(again[name], one[name], atol=1e-9)


def test_voltages_at_the_terminals_lack_what_the_legs_take():
    """Of three signs as those of the currents the vector is 4/3 long; the knee makes it less."""
    recording = ematwin.simulate(
        None, None, None, ACTUATOR, also=(*TERMINALS, "voltage_d", "voltage_q")
    )
    commanded = PmsmComparison(recording, ACTUATOR).measured()
    at_terminals = PmsmComparison(without(recording, "voltage"), ACTUATOR).measured()
    drive, tick = ACTUATOR.drive, ACTUATOR.controller.current_time
    lost = drive.supply_voltage * drive.dead_time / tick + drive.device_drop
    gap = np.hypot(*(commanded[f"voltage_{x}"] - at_terminals[f"voltage_{x}"] for x in "dq"))
    assert 0.5 * lost < np.median(gap) < 1.5 * lost


def test_no_fault_is_named_from_a_dead_current_sensor(healthy):
    recording = without(healthy, "current_d", "current_q")
    dead = recording.changed(current_a=np.zeros(len(recording)))
    verdict = ematwin.identify(dead, ACTUATOR, exact=True).verdict
    assert (verdict.grade, verdict.faults) == ("none", ())
    assert verdict.reason.startswith("current_a stands still at 0 A while")
