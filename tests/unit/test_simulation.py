"""`simulate`: repeatable bit for bit, sampled at any rate, sliced without a seam."""

import numpy as np
import pytest

import ematwin
from ematwin import BldcActuator, Noise, Recording, Scenario, simulate
from ematwin.errors import DivergedError, InputError
from ematwin.models.bldc import simulate as simulation
from ematwin.models.scenario import Chirp, Step

MODELS = ("reference", "monitor")
SHORT = Scenario(
    name="short",
    duration=0.06,
    command=[Chirp(amplitude=0.005, f_start=10, f_end=30)],
    load=[Step(value=10.0, time=0.03)],
)


def equal(one: Recording, other: Recording) -> bool:
    """Whether all columns agree bit for bit."""
    columns, others = dict(one.columns()), dict(other.columns())
    return columns.keys() == others.keys() and all(
        columns[name].tobytes() == others[name].tobytes() for name in columns
    )


@pytest.mark.parametrize("model", MODELS)
def test_a_simulation_in_slices_equals_the_whole_bit_for_bit(model, monkeypatch):
    whole = simulate(model, SHORT, {"friction": 0.3, "backlash": 0.2})
    monkeypatch.setattr(simulation, "SLICE_STEPS", 137)
    shares: list[float] = []
    sliced = simulate(model, SHORT, {"friction": 0.3, "backlash": 0.2}, progress=shares.append)
    assert equal(sliced, whole)
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_white_noise_has_the_stated_share_of_the_signal_and_no_memory():
    clean = simulate("reference", "default")
    noisy = Noise(white=0.05).apply(clean, np.random.default_rng(7))
    for name in ("current_a", "current_b", "current_c"):
        signal = getattr(clean, name)
        error = getattr(noisy, name) - signal
        sigma = 0.05 * np.sqrt(np.mean(signal**2))
        n = error.size
        assert abs(error.mean()) < 4 * sigma / np.sqrt(n)
        assert error.std() == pytest.approx(sigma, rel=4 / np.sqrt(2 * n))
        neighbours = np.corrcoef(error[1:], error[:-1])[0, 1]
        assert abs(neighbours) < 4 / np.sqrt(n)
        assert abs(np.corrcoef(error, signal)[0, 1]) < 4 / np.sqrt(n)
    between = np.corrcoef(noisy.current_a - clean.current_a, noisy.current_b - clean.current_b)
    assert abs(between[0, 1]) < 4 / np.sqrt(n)


@pytest.mark.parametrize("rate", [100.0, 3333.0, 20_000.0, 100_000.0, 250_000.0])
@pytest.mark.parametrize("model", MODELS)
def test_a_record_has_the_rate_that_was_asked_for(model, rate):
    record = simulate(model, SHORT, sample_rate=rate)
    assert record.sample_rate == pytest.approx(rate, rel=1e-9)
    assert record.time[0] == 0.0
    assert len(record) == int(0.06 * rate + 1e-9) + 1
    assert record.time[-1] <= 0.06 + 1e-12


@pytest.mark.parametrize("model", MODELS)
def test_a_slower_record_has_the_same_states_and_the_mean_of_the_currents(model):
    # 100 kHz and 20 kHz run on one grid of inputs, so that only the sampling differs
    step = 1e-6 if model == "reference" else 1e-5
    fine = simulate(model, SHORT, sample_rate=100_000, step=step)
    slow = simulate(model, SHORT, step=step)
    for name in ("motor_position", "motor_speed", "output_position", "command", "load"):
        assert getattr(slow, name) == pytest.approx(getattr(fine, name)[::5], rel=1e-9, abs=1e-12)
    for name in ("current_a", "current_b", "current_c") if model == "reference" else ("current",):
        means = getattr(fine, name)[1:].reshape(-1, 5).mean(axis=1)
        assert getattr(slow, name)[1:] == pytest.approx(means, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_it_starts_at_rest_where_it_is_told_to(model):
    hold = Scenario(duration=0.05, command=[Step(value=0.1)])
    record = simulate(model, hold, initial_position=0.1)
    assert record.output_position[0] == 0.1
    assert record.motor_position[0] == pytest.approx(50.0)
    assert record.motor_speed[0] == 0.0
    # commanded to where it stands, without a load, it stays
    assert np.abs(record.output_position - 0.1).max() < 1e-12
    moved = simulate(model, hold)
    assert moved.output_position[0] == 0.0
    assert moved.output_position[-1] > 0.05


def test_provenance_tells_how_to_make_the_record_again():
    record = simulate(
        "monitor", SHORT, {"friction": 0.25}, noise=Noise(white=0.1), seed=5, sample_rate=10_000
    )
    made = record.provenance
    assert made["model"] == "monitor"
    assert made["scenario"] == "short"
    assert made["actuator"] == "servo48"
    assert made["actuator_fingerprint"] == BldcActuator.load().fingerprint
    assert made["ematwin"] == ematwin.__version__
    again = simulate(
        made["model"], SHORT, made["faults"], made["actuator"],
        noise=Noise(**made["noise"]), seed=made["seed"], sample_rate=record.sample_rate,
        initial_position=made["initial_position_rad"],
    )  # fmt: skip
    assert equal(again, record)
    assert again.provenance == made


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"sample_rate": 0.0}, "received 0.0"),
        ({"sample_rate": float("nan")}, "received nan"),
        ({"sample_rate": float("inf")}, "received inf"),
        ({"sample_rate": 1e12}, "6e.10 samples; at most"),
        ({"sample_rate": 10.0}, "fewer than two samples at 10 Hz"),
        ({"step": 0.0}, "received 0 s"),
        ({"step": float("nan")}, "received nan s"),
        ({"step": 1e-15}, "received 1e-15 s"),
        ({"seed": 1.5}, "received 1.5"),
        ({"initial_position": 1.0}, "received 1"),
        ({"initial_position": float("nan")}, "received nan"),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_in_one_sentence(arguments, said):
    with pytest.raises(InputError, match=said) as caught:
        simulate(**{"model": "monitor", "scenario": SHORT, **arguments})
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_a_diverged_simulation_is_an_error_and_no_record(monkeypatch):
    from ematwin.models.bldc import batch

    monkeypatch.setattr(
        batch, "monitor_trace", lambda k, command, *_: np.full((command.size - 1, 6), np.nan)
    )
    with pytest.raises(DivergedError, match="diverged at a step of 1e-05 s"):
        simulate("monitor", SHORT, sample_rate=100_000)
