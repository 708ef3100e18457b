import math
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

import ematwin
from bldc_inputs import HALF
from ematwin import Faults, Noise, identify, simulate
from ematwin.errors import InputError
from ematwin.estimation.identification import Identification
from ematwin.models.bldc.faults import PAPER_CASES, error_percent_wrapped

THREE = Faults(friction=0.3, short_b=0.2, eccentricity=0.4, eccentricity_phase=0.7)


@pytest.fixture(scope="module")
def record() -> ematwin.Recording:
    return simulate("reference", faults=THREE, noise=Noise(white=0.02, bits=12), seed=1)


@pytest.fixture(scope="module")
def short(record: ematwin.Recording) -> ematwin.Recording:
    """For what does not depend on the recording."""
    return record.between(0.0, 0.1)


@pytest.fixture(scope="module")
def found(record: ematwin.Recording) -> Identification:
    return identify(record)


def error(found: Identification, injected: Faults) -> float:
    return float(error_percent_wrapped(found.faults.vector, injected.vector))


def test_three_faults_are_found_through_noise(found: Identification) -> None:
    assert error(found, THREE) < 0.5
    assert found.stopped == "good fit"
    assert found.evaluations < 1000
    for name in ("friction", "short_b", "eccentricity", "eccentricity_phase"):
        miss = abs(getattr(found.faults, name) - getattr(THREE, name))
        assert miss < 3.0 * found.standard_error[name] + 1e-4


def test_same_seed_gives_the_same_answer_bit_for_bit(short):
    found, again = (identify(short, threads=count) for count in (None, 1))
    assert (again.faults.vector == found.faults.vector).all()
    assert again.evaluations == found.evaluations


@pytest.mark.parametrize("case", PAPER_CASES)
def test_each_case_of_the_paper_is_found_within_half_a_per_cent(case: str) -> None:
    injected = Faults(**PAPER_CASES[case])
    assert error(identify(simulate("reference", HALF, injected)), injected) < 0.5


def test_only_the_named_faults_are_searched(record: ematwin.Recording) -> None:
    held = {name: value for name, value in THREE.as_dict().items() if name != "friction"}
    found = identify(record, only=["friction"], held=held, exact=True)
    assert found.searched == ("friction",)
    assert found.faults.friction == pytest.approx(0.3, abs=0.001)
    assert found.faults.short_b == 0.2
    assert list(found.standard_error) == ["friction"]
    alike = identify(record, held=held, exact=True)  # what is held is not searched
    assert (alike.searched, alike.faults) == (found.searched, found.faults)
    with pytest.raises(InputError, match="friction cannot be searched and held"):
        identify(record, only=["friction"], held={"friction": 0.0})


def test_actuator_that_cannot_move_is_reported_as_undetermined() -> None:
    stuck = simulate("reference", HALF, {"short_b": 1.0, "short_c": 0.97, "friction": 0.2})
    found = identify(stuck)
    assert any("does not determine" in warning for warning in found.warnings)
    assert not math.isfinite(found.standard_error["friction"])


def test_twin_that_does_not_fit_is_doubted_aloud() -> None:
    other = ematwin.BldcActuator.load().changed({"motor.inertia": 1.5e-5})
    found = identify(simulate("reference", HALF, actuator=other), budget=2000)
    assert found.verdict.grade == "none"
    assert "standard deviations off what is known of it" in found.verdict.reason


@pytest.mark.parametrize("algorithm", ["multistart", "pso", "scipy-trf"])
def test_interruption_keeps_the_best_so_far(short: ematwin.Recording, algorithm: str) -> None:
    calls = 0

    def interrupt(evaluations: int, cost: float, budget: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 2:
            signal.raise_signal(signal.SIGINT)

    assert threading.current_thread() is threading.main_thread()
    found = identify(short, algorithm=algorithm, progress=interrupt)
    assert found.stopped == "interrupted"
    assert 0 < found.evaluations < 10_000
    assert math.isfinite(found.cost)


def test_interrupted_population_run_goes_on_from_its_checkpoint(short, tmp_path):
    whole = identify(short, algorithm="gwo", budget=1500, seed=2)
    state = tmp_path / "run.state"

    def interrupt(evaluations: int, cost: float, budget: int) -> None:
        if evaluations == 1000:
            signal.raise_signal(signal.SIGINT)

    identify(short, algorithm="gwo", budget=1500, seed=2, checkpoint=state, progress=interrupt)
    rest = identify(short, algorithm="gwo", budget=1500, seed=2, checkpoint=state)
    assert rest.cost == whole.cost
    assert (rest.faults.vector == whole.faults.vector).all()


def test_a_recording_in_degrees_is_told_from_one_that_the_twin_cannot_explain(tmp_path: Path):
    record = simulate("reference", HALF, {"friction": 0.25}, noise=0.02)
    names = ("command", "load", "current_a", "current_b", "current_c")
    frame = record.to_frame()[["time", *names]]
    frame["command"] = np.degrees(frame["command"])
    frame.to_csv(tmp_path / "bench.csv", index=False)
    found = identify(tmp_path / "bench.csv", "servo48")
    assert found.verdict.grade == "none"
    assert 'unexplained with unit = "deg" for command, and' in found.warnings[0]
    right = frame.rename(columns={"command": "command [deg]"})
    right.to_csv(tmp_path / "bench.csv", index=False)
    assert identify(tmp_path / "bench.csv", "servo48", exact=True).relative_misfit < 0.03
