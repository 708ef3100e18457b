"""Errors of the current sensors of three phases are found without a twin, and nothing else is."""

import numpy as np
import pytest

import ematwin
from bldc_inputs import NOISE, recorded
from ematwin import Noise
from ematwin.models.bldc.channels import PHASES
from ematwin.models.bldc.phase_sensors import balanced, phase_sensors
from ematwin.models.channels_agree import contradictions
from ematwin.models.plausibility import check_sum
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.recording import Recording

GAINS, OFFSETS = np.array([1.01, 0.985, 1.0]), np.array([0.15, -0.05, 0.3])
FAULTY = [
    {},
    {"short_b": 0.6, "friction": 0.5},
    {"eccentricity": 0.9, "eccentricity_phase": 0.3, "backlash": 0.8},
]


def shown(record: Recording, gains: np.ndarray, offsets: np.ndarray) -> Recording:
    each = zip(PHASES, gains, offsets, strict=True)
    return record.changed(**{n: g * record.channels[n] + o for n, g, o in each})


@pytest.mark.parametrize("scenario", ["default", "sine", "ramp"])
@pytest.mark.parametrize("faults", FAULTY)
def test_offsets_and_gains_are_found_whatever_the_fault(scenario, faults):
    found = phase_sensors(shown(recorded(scenario, faults), GAINS, OFFSETS))
    assert found.offsets == pytest.approx(OFFSETS, abs=0.003)
    assert found.gains == pytest.approx(GAINS / GAINS.mean(), abs=0.0015)


@pytest.mark.parametrize("scenario", ["default", "sine", "ramp", "step"])
@pytest.mark.parametrize("faults", FAULTY)
@pytest.mark.parametrize("noise", [None, NOISE], ids=["no noise", "noise"])
def test_good_sensors_are_left_alone(scenario, faults, noise):
    record = recorded(scenario, faults, noise)
    assert phase_sensors(record) is None
    assert balanced(record) is record


def test_samples_that_were_masked_do_not_count_where_channels_are_compared():
    record, actuator = recorded("default", {}), load_actuator("servo48")
    current, hole = record.current_a.copy(), slice(3 * len(record) // 8, 5 * len(record) // 8)
    current[hole] = 1.0
    filled = record.changed(current_a=current)
    ends = [float(record.time[hole.start]), float(record.time[hole.stop - 1])]
    told = filled.changed(provenance={**record.provenance, "masked_s": [ends]})
    model = model_of(actuator)
    for one, good in ((told, True), (filled, False)):
        assert (check_sum(one) == []) is good
        assert (phase_sensors(one) is None) is good
        assert (contradictions(model, one, actuator) == {}) is good


@pytest.mark.parametrize("two", [False, True], ids=["three", "two"])
@pytest.mark.parametrize("scenario", ["default", "step"])
@pytest.mark.parametrize("share", [0.05, 0.1, 0.2, 0.4])
def test_loud_noise_is_not_taken_for_gains(share, scenario, two):
    """The magnitude of a regression on noisy currents would be too small: up to 6 % at a tenth."""
    for seed in range(3):
        noise = Noise(white=share, bits=12)
        clean = recorded(scenario, {"short_b": 0.5}, None)
        record = noise.apply(clean, np.random.default_rng(seed))
        if two:
            record = record.changed(current_c=-(record.current_a + record.current_b))
        assert phase_sensors(record) is None


@pytest.mark.parametrize("made", range(3))
def test_a_current_made_of_two_sensors_is_made_of_them_once_they_are_corrected(made):
    """It shows the gain of the one while the phase of the other is open."""
    record = recorded("default", {"short_a": 0.3})
    name = PHASES[made]
    seen = shown(record, GAINS, OFFSETS)
    seen = seen.changed(**{name: -sum(seen.channels[x] for x in PHASES if x != name)})
    found = phase_sensors(seen)
    there = [n for n in range(3) if n != made]
    assert found.made == made
    assert found.offsets[there] == pytest.approx(OFFSETS[there], abs=0.003)
    gains = GAINS[there] / GAINS[there].mean()
    assert found.gains[there] == pytest.approx(gains, abs=0.0015)
    true = -sum(record.channels[PHASES[n]] for n in there) * GAINS[there].mean()
    # what is left is the gain of both, and the error of two gains and offsets
    assert balanced(seen).channels[name] == pytest.approx(true, rel=2e-3, abs=0.02)


def test_a_held_current_is_not_taken_for_a_large_offset():
    """After a step one phase is open nearly all the time; the two others hold a current."""
    record = recorded("step", {}, Noise(white=0.1, bits=10))
    found = phase_sensors(record)
    assert found is None or np.abs(found.offsets).max() < 0.05
    small = phase_sensors(shown(recorded("step", {}), GAINS, 0.1 * OFFSETS))
    assert small.offsets == pytest.approx(0.1 * OFFSETS, abs=0.005)


def test_a_sine_drive_has_no_open_phase_and_is_left_alone():
    time = np.arange(20_000) / 20_000.0
    angle = 2.0 * np.pi * 20.0 * time
    currents = {n: np.sin(angle - 2.0 * np.pi * k / 3.0) for k, n in enumerate(PHASES)}
    noise = np.random.default_rng(1).normal(0.0, 0.01, (3, time.size))
    noisy = {name: x + noise[k] for k, (name, x) in enumerate(currents.items())}
    record = Recording(time, {"command": 0.01 * np.sin(angle / 20.0), **noisy})
    assert phase_sensors(record) is None


def test_another_scale_is_no_error_of_a_sensor():
    assert phase_sensors(shown(recorded("default", {}), np.array([1.0, 1.5, 1.0]), OFFSETS)) is None


def test_without_three_currents_or_without_current_there_is_nothing_to_tell():
    record = recorded("default", {})
    single = record.changed(current=record.current_a, **dict.fromkeys(PHASES))
    assert phase_sensors(single) is None
    assert phase_sensors(record.changed(**{name: 0.0 * record.time for name in PHASES})) is None


def test_the_answer_is_that_of_good_sensors_and_says_what_was_corrected():
    faults = {"friction": 0.25, "short_b": 0.15}
    record = recorded("default", faults).between(0.0, 0.3)
    good = ematwin.identify(record, threads=1)
    seen = ematwin.identify(shown(record, GAINS / GAINS.mean(), OFFSETS), threads=1)
    assert seen.verdict.grade == good.verdict.grade == "fault"
    assert seen.present == good.present
    assert [seen.values[n] for n in faults] == pytest.approx(list(faults.values()), abs=0.02)
    (said,) = (one for one in seen.warnings if "sensors of the phases" in one)
    assert said.startswith("The current sensors of the phases are off (a +15")
