"""Load, clocks and sensors of a brushless recording: against recordings changed by hand."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from bldc_inputs import rms
from ematwin import BldcActuator, Faults, Noise, Recording, simulate
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.faults import FAULTS, aliases, nuisances
from ematwin.models.registry import model_of
from ematwin.models.scenario import Scenario
from ematwin.numerics.signals import LowPass

ACTUATOR = BldcActuator.load()
MODEL = model_of(ACTUATOR)
FAULTY = Faults(friction=0.2, backlash=0.02, short_b=0.3, gain=0.6)
INTERVAL = 5e-5  # s
NEUTRAL = {one.name: one.healthy for one in nuisances(ACTUATOR)}


@pytest.fixture(scope="module")
def record() -> Recording:
    """With a load that moves all the time."""
    load = [{"type": "step", "value": 8.0, "time": 0.1},
            {"type": "sine", "amplitude": 3.0, "frequency": 30.0}]  # fmt: skip
    chirp = [{"type": "chirp", "amplitude": 0.005, "f_start": 5.0, "f_end": 25.0}]
    scenario = Scenario(duration=0.2, command=chirp, load=load)
    return simulate("monitor", scenario, FAULTY, noise=Noise(white=0.02), seed=1)


def response(record: Recording, **values: float) -> np.ndarray:
    """The filtered current (S,) of a candidate with some faults and some nuisances."""
    found = BldcComparison(record, ACTUATOR, threads=1).responses(batch([values]), 1)
    return found["current"][0]


def batch(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    names = {name: None for row in rows for name in row}
    every = FAULTY.as_dict() | NEUTRAL
    return {
        **{name: np.full(len(rows), value) for name, value in FAULTY.as_dict().items()},
        **{name: np.array([row.get(name, every[name]) for row in rows]) for name in names},
    }


def late(record: Recording, names: tuple[str, ...], delay: float) -> Recording:
    """The recording with some channels so much later, on straight lines between samples."""
    t = record.time
    return record.changed(
        **{name: np.interp(t - delay, t, record.channels[name]) for name in names}
    )


# The load


@pytest.mark.parametrize(("gain", "offset"), [(1.2, 0.0), (1.0, -2.5), (0.8, 1.5)])
def test_a_corrected_load_answers_as_a_recording_with_that_load(record, gain, offset) -> None:
    corrected = record.changed(load=gain * record.load + offset)
    expected = response(corrected)
    found = response(record, load_gain=gain, load_offset=offset)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert rms(expected - response(record)) > 0.01 * rms(expected)


def test_a_recording_without_a_load_takes_the_offset_for_one(record) -> None:
    channels = {name: x for name, x in record.channels.items() if name != "load"}
    blind = Recording(record.time, channels)
    expected = response(record.changed(load=np.full(len(record), 2.0)))
    assert np.allclose(response(blind, load_offset=2.0), expected, rtol=0.0, atol=1e-9)


# Clocks


def test_a_command_that_came_late_is_followed_late_and_set_back(record) -> None:
    """By whole samples, where nothing needs to be interpolated: exactly."""
    both = response(late(record, ("command", "load"), 4 * INTERVAL))
    found = response(record_with_late_command(record, 4), skew=4 * INTERVAL)
    assert np.allclose(found[:-4], both[4:], rtol=0.0, atol=1e-12)


def record_with_late_command(record: Recording, samples: float) -> Recording:
    return late(record, ("command",), samples * INTERVAL)


@pytest.mark.parametrize("samples", [2.5, -3.3])
def test_a_skew_between_samples_is_the_late_answer_at_that_time(record, samples) -> None:
    """``skew`` delays the load as the command was delayed and reads the answer earlier."""
    delay = samples * INTERVAL
    late_command = record_with_late_command(record, samples)
    both = late(late_command, ("load",), delay)
    at = record.time + delay
    inside = (at > record.time[20]) & (at < record.time[-20])
    expected = CubicSpline(record.time, response(both))(at)
    found = response(late_command, skew=delay)
    # cubic convolution of a signal without anything above 500 Hz, at 20 kHz
    assert rms((found - expected)[inside]) < 1e-3 * rms(expected[inside])
    wrong = response(late_command)
    assert rms((wrong - expected)[inside]) > 0.03 * rms(expected[inside])


@pytest.mark.parametrize("samples", [-12, -3.3, 2.5, 12])
def test_what_was_not_recorded_for_a_skewed_clock_counts_for_nothing(samples) -> None:
    """At the end of a recording the actuator moves on."""
    chirp = [{"type": "chirp", "amplitude": 0.005, "f_start": 5.0, "f_end": 25.0}]
    scenario = Scenario(duration=0.2, command=chirp)
    whole = record_with_late_command(simulate("monitor", scenario, FAULTY), samples)
    subject = BldcComparison(whole, ACTUATOR, threads=1)
    skews = batch([{"skew": samples * INTERVAL}, {"skew": 0.0}])
    right, none = subject.residuals(skews, 2)
    assert none @ none > 1e-4 * subject.scale
    assert right @ right < 0.03 * (none @ none)
    ends = right[-40:]
    assert ends @ ends < 0.5 * (right @ right)


# Sensors


def test_gain_and_offset_of_the_current_are_put_on_the_answer(record) -> None:
    found = response(record, current_gain=0.97, current_offset=0.05)
    assert np.allclose(found, 0.97 * response(record) + 0.05, rtol=0.0, atol=1e-12)


# What cannot be told apart

POINT = {
    "friction": 0.3, "backlash": 0.03, "short_a": 0.1, "short_b": 0.2, "short_c": 0.15,
    "eccentricity": 0.2, "eccentricity_phase": 0.3, "gain": 0.6, "load_gain": 0.9,
}  # fmt: skip
STEP = 0.02  # of the pivot


def smooth_answers(actuator: BldcActuator, rows: list[dict[str, float]]) -> np.ndarray:
    """Answers (B, S) through a slow filter, without a direction of rotation that may turn."""
    record = simulate("monitor", faults=POINT_FAULTS, actuator=actuator)
    subject = BldcComparison(record, actuator, low_pass=LowPass(50.0), threads=1)
    names = dict.fromkeys(name for row in rows for name in row)
    candidates = {
        name: np.array([row.get(name, base(actuator, name)) for row in rows]) for name in names
    }
    return subject.responses(candidates, len(rows))["current"]


POINT_FAULTS = {name: POINT[name] for name in FAULTS}


def base(actuator: BldcActuator, name: str) -> float:
    return actuator.value(name) if "." in name else POINT.get(name, NEUTRAL.get(name, 0.0))


def moved(actuator: BldcActuator, changes: dict[str, float]) -> dict[str, float]:
    """The point with some changes, of logarithms where a parameter is meant."""
    found = dict(POINT)
    for name, change in changes.items():
        value = base(actuator, name)
        found[name] = value * np.exp(change) if "." in name else value + change
    return found


@pytest.fixture(scope="module")
def blind() -> dict[str, tuple[float, float]]:
    """By pivot: how the answer changes with it, and with the alias taken back (relative RMS)."""
    told = aliases(ACTUATOR, POINT)
    rows = []
    for one in told:
        for size in (STEP, -STEP):
            rows.append(moved(ACTUATOR, {one.pivot: size}))
            taken_back = {name: -size * change for name, change in one.same.items()}
            rows.append(moved(ACTUATOR, {one.pivot: size, **taken_back}))
    answers = smooth_answers(ACTUATOR, rows)
    found = {}
    for n, one in enumerate(told):
        up, up_back, down, down_back = answers[4 * n : 4 * n + 4]
        found[one.pivot] = (rms(up - down) / rms(up), rms(up_back - down_back) / rms(up))
    return found


ALIASES = {one.pivot: one for one in aliases(ACTUATOR, POINT)}


@pytest.mark.parametrize("pivot", ALIASES)
def test_an_alias_is_a_direction_in_which_the_answer_stays(blind, pivot: str) -> None:
    """What is left of the change that the pivot makes alone; measured: less than 0.2 %."""
    alone, left = blind[pivot]
    assert alone > 1e-4
    assert left < 0.005 * alone


# Motion


def chirp(amplitude: float) -> Recording:
    parts = [{"type": "chirp", "amplitude": amplitude, "f_start": 5.0, "f_end": 25.0}]
    return simulate("monitor", Scenario(duration=0.3, command=parts))


def test_a_motion_of_20_urad_tells_no_faults() -> None:
    found = MODEL.excitation(chirp(20e-6), ACTUATOR)
    assert found
    assert "less than the" in found[0]
    assert "electrical turn" in found[0]


def test_a_motion_must_cross_the_healthy_gap() -> None:
    turn = 2.0 * np.pi / ACTUATOR.motor.pole_pairs
    wide = ACTUATOR.changed({"transmission.backlash": 30.0 * turn})
    said = MODEL.excitation(simulate("monitor"), wide)
    assert len(said) == 1
    assert "times the healthy gap" in said[0]
