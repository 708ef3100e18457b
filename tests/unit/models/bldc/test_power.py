"""Electrical power as evidence: what is recorded of it, and what a comparison makes of it."""

import numpy as np
import pytest

import ematwin
from ematwin import simulate
from ematwin.errors import InputError, RecordError
from ematwin.models.bldc.channels import PHASES, VOLTAGES, phase_currents
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.stretches import recorded_power
from ematwin.models.comparison import Comparison
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording

ACTUATOR = ematwin.BldcActuator.load("servo48")
FAULTS = {"friction": 0.25, "short_b": 0.15}
TRUTH = {name: np.array([value]) for name, value in FAULTS.items()}


@pytest.fixture(scope="module")
def record() -> Recording:
    also = (*VOLTAGES, "bus_current", "bus_voltage")
    return simulate("reference", faults=FAULTS, actuator=ACTUATOR, also=also)


def without(record: Recording, *names: str) -> Recording:
    return record.changed(**dict.fromkeys(names))


def watts(record: Recording) -> np.ndarray:
    power = recorded_power(record, ACTUATOR)
    assert power is not None
    return LowPass().apply(power.watts, record.sample_rate)


def test_a_simulation_gives_voltages_only_where_they_are_asked_for() -> None:
    plain = simulate("reference", actuator=ACTUATOR)
    assert not set(plain.channels) & {*VOLTAGES, "bus_current", "bus_voltage"}
    some = simulate("reference", actuator=ACTUATOR, also=["bus_current"])
    assert "bus_current" in some.channels
    assert "voltage_a" not in some.channels
    with pytest.raises(InputError, match="cannot also give torque; it can give voltage_a"):
        simulate("reference", also=["torque"])
    with pytest.raises(InputError, match="monitor model has no bus_current"):
        simulate("monitor", also="bus_current")


def test_power_of_phases_does_not_depend_on_what_voltages_are_measured_against(record) -> None:
    shifted = record.changed(**{name: record.channels[name] - 24.0 for name in VOLTAGES})
    np.testing.assert_allclose(watts(shifted), watts(record), atol=1e-9)


def test_power_of_the_phases_is_that_of_the_supply(record) -> None:
    supply = without(record, *VOLTAGES)
    nominal = without(supply, "bus_voltage")
    # diodes take some of it; and samples hold means of voltages and currents, not of products
    away = watts(record) - watts(supply)
    assert np.sqrt(np.mean(away**2)) < 0.015 * np.sqrt(np.mean(watts(supply) ** 2))
    np.testing.assert_allclose(watts(nominal), watts(supply))
    assert recorded_power(without(nominal, "bus_current"), ACTUATOR) is None
    assert recorded_power(without(record, "voltage_b", "bus_current"), ACTUATOR) is None


@pytest.mark.parametrize("left_out", [(), VOLTAGES, (*VOLTAGES, "bus_voltage")])
def test_the_twin_explains_the_power_of_the_reference_model(record, left_out) -> None:
    """To what is expected of it; the healthy twin does not."""
    subject = BldcComparison(without(record, *left_out), ACTUATOR).with_evidence()
    assert subject.evidence > 0
    for candidates, low, high in ((TRUTH, 0.1, 1.3), ({}, 2.5, np.inf)):
        rows = subject.residuals(candidates, 1)[0]
        evidence = rows[-subject.evidence :]
        assert low < np.sqrt(evidence @ evidence / subject.independent) < high
    # the current counts as before
    plain = BldcComparison(record, ACTUATOR)
    np.testing.assert_array_equal(
        subject.residuals(TRUTH, 1)[0, : -subject.evidence], plain.residuals(TRUTH, 1)[0]
    )
    assert subject.costs(TRUTH, 1) == plain.costs(TRUTH, 1)


@pytest.mark.parametrize("sensors", [{}, {"skew": 1.3e-5, "current_gain": 1.02}])
def test_the_reference_leaves_the_same_without_the_fast_model_as_by_its_error(record, sensors):
    """Of the current and, as evidence, the power; also of a comparison that is corrected."""
    subject = BldcComparison(record, ACTUATOR).with_evidence()
    values = {**{name: float(x[0]) for name, x in TRUTH.items()}, "friction": 0.3, **sensors}
    slow = Comparison.exact_residuals(subject, values)
    corrected = subject.with_missed(subject.missed(values))
    for one in (subject, corrected):
        off = np.linalg.norm(one.exact_residuals(values) - slow) / np.linalg.norm(slow)
        assert off < (5e-3 if sensors else 1e-12)  # late commands are interpolated elsewhere


def test_stretches_explain_the_power_as_the_whole_does(record) -> None:
    stretches = BldcComparison(record, ACTUATOR).restarted()
    assert stretches is not None
    subject = stretches.with_evidence()
    rows = subject.residuals(TRUTH, 1)[0]
    evidence = rows[-subject.evidence :]
    assert np.sqrt(evidence @ evidence / subject.independent) < 1.3
    np.testing.assert_allclose(
        rows[: -subject.evidence], stretches.residuals(TRUTH, 1)[0], rtol=0.0, atol=1e-12
    )


def residual_watts(subject: BldcComparison, **candidates: float) -> np.ndarray:
    """What the twin has beyond the recording, W."""
    given = {name: np.array([value]) for name, value in {**FAULTS, **candidates}.items()}
    rows = subject.residuals(given, 1)[0, -subject.evidence :]
    power = subject.whole.power
    assert power is not None
    stride = -(-len(subject.recording) // subject.evidence)
    return rows / np.sqrt(stride * power.weights.max())


def test_sensors_act_on_the_power_as_their_names_say(record) -> None:
    phases = BldcComparison(record, ACTUATOR).with_evidence()
    supply = BldcComparison(without(record, *VOLTAGES, "bus_voltage"), ACTUATOR).with_evidence()
    for subject in (phases, supply):
        plain = residual_watts(subject)
        twin = plain + np.r_[0.0, subject.whole.power.target[:: -(-10_001 // plain.size)][1:]]
        for name, value, expected in (
            ("power_offset", 2.0, plain + 2.0),
            ("power_gain", 1.1, plain + 0.1 * twin),
        ):
            found = residual_watts(subject, **{name: value})
            np.testing.assert_allclose(found[1:], expected[1:], atol=1e-9)
    base = residual_watts(phases)
    twin = base + np.r_[0.0, phases.whole.power.target[:: -(-10_001 // base.size)][1:]]
    # the sensors of the phases make their power; those of the supply do not
    louder = residual_watts(phases, current_gain=1.1)
    np.testing.assert_allclose(louder[1:], (base + 0.1 * twin)[1:], atol=1e-9)
    plain = residual_watts(supply)
    np.testing.assert_allclose(residual_watts(supply, current_gain=1.1), plain)
    # a volt for each ampere is lost before the motor
    drop = residual_watts(supply, voltage_drop=1.5) - plain
    current = np.abs(supply.responses(TRUTH, 1)["current"][0])
    stride = -(-10_001 // drop.size)
    np.testing.assert_allclose(drop[1:], 1.5 * current[::stride][1:], atol=1e-9)
    # as much power is less current out of a higher supply
    higher = residual_watts(supply, **{"drive.supply_voltage": 52.8})
    twin = plain + np.r_[0.0, supply.whole.power.target[::stride][1:]]
    moving = np.abs(twin) > 5.0
    ratio = (higher + twin - plain)[moving] / twin[moving]
    assert np.median(ratio) == pytest.approx(48.0 / 52.8, rel=2e-3)


def test_noisy_power_counts_less(record) -> None:
    rng = np.random.default_rng(1)
    noisy = record.changed(
        **{n: record.channels[n] + 20.0 * rng.standard_normal(len(record)) for n in VOLTAGES}
    )
    quiet, loud = (
        BldcComparison(one, ACTUATOR).with_evidence().whole.power.weights.max()
        for one in (record, noisy)
    )
    assert loud < 0.2 * quiet
    subject = BldcComparison(noisy, ACTUATOR).with_evidence()
    evidence = subject.residuals(TRUTH, 1)[0, -subject.evidence :]
    assert 0.7 < np.sqrt(evidence @ evidence / subject.independent) < 1.3


def test_what_cannot_be_voltages_is_refused_or_said(record) -> None:
    milli = record.changed(**{name: 1e3 * record.channels[name] for name in VOLTAGES})
    with pytest.raises(RecordError, match=r"voltage_a to voltage_b reaches 4.8.*looks like mV"):
        MODEL.check(milli, ACTUATOR)
    with pytest.raises(RecordError, match=r"bus_current reaches .* It looks like mA"):
        MODEL.check(record.changed(bus_current=1e3 * record.channels["bus_current"]), ACTUATOR)
    with pytest.raises(RecordError, match=r"bus_voltage reaches 4.8e\+04 V"):
        MODEL.check(record.changed(bus_voltage=1e3 * record.channels["bus_voltage"]), ACTUATOR)
    assert not [x for x in MODEL.check(record, ACTUATOR) if "oltage" in x]
    told = MODEL.check(without(record, "voltage_b"), ACTUATOR)
    assert any("voltage_b is missing, so the voltages are not used" in one for one in told)
    envelope = 0.5 * np.abs(phase_currents(record)).sum(axis=1)
    told = MODEL.check(without(record, *PHASES).changed(current=envelope), ACTUATOR)
    assert any("not used without the currents of all three phases" in one for one in told)
