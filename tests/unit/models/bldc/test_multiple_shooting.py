"""A record compared stretch by stretch."""

import numpy as np
import pytest

import ematwin
from bldc_inputs import HALF
from ematwin import Faults, Problem, identify, simulate
from ematwin.models.bldc.faults import HEALTHY, error_percent_wrapped
from ematwin.recordings.recording import Recording

# The actuator creeps on where the twin, given these very faults, stalls.
NEAR_STALL = Faults(
    friction=0.0, backlash=0.23, short_a=0.98, short_b=0.14, short_c=0.94, eccentricity=0.97,
    eccentricity_phase=0.11, gain=0.21,
)  # fmt: skip


@pytest.fixture(scope="module")
def twin_record() -> Recording:
    return simulate("monitor", faults=Faults(friction=0.3, short_b=0.2, backlash=0.4))


@pytest.fixture(scope="module")
def actuator() -> ematwin.BldcActuator:
    return ematwin.BldcActuator.load("servo48")


def without(record: Recording, *names: str) -> Recording:
    return record.changed(**dict.fromkeys(names))


def restarted(record: Recording, actuator: ematwin.BldcActuator, **options: int) -> Problem:
    problem = Problem.of(record, actuator, **options).restarted()
    assert problem is not None
    return problem


def test_twin_explains_every_stretch_of_its_own_record(twin_record, actuator):
    stretches = restarted(twin_record, actuator)
    true = np.array([[0.3, 0.4, 0.0, 0.2, 0.0, 0.0, 0.5, 0.5]])
    assert stretches.relative_misfit(stretches.costs(true)[0]) < 0.005
    assert stretches.relative_misfit(stretches.costs(HEALTHY[None])[0]) > 0.1


def test_positions_of_motor_and_output_are_needed(twin_record: Recording) -> None:
    assert Problem.of(twin_record, "servo48").restarted() is not None
    blind = without(twin_record, "output_position", "output_speed")
    assert Problem.of(blind, "servo48").restarted() is None


def test_faults_are_found_where_the_twin_stalls_and_the_actuator_does_not() -> None:
    found = identify(simulate("reference", faults=NEAR_STALL), seed=32)
    assert found.stopped == "good fit of stretches"
    assert error_percent_wrapped(found.faults.vector, NEAR_STALL.vector) < 2.5
    assert found.relative_misfit > 1.0  # of the whole record
    assert found.evaluations < 2500
    assert "stretches" in found.warnings[-1]


@pytest.mark.parametrize("budget", [900, 1700])
def test_budget_holds_in_every_stage(budget: int) -> None:
    record = simulate("reference", HALF, NEAR_STALL)
    found = identify(record, seed=32, budget=budget, exact=True)
    assert found.evaluations <= budget
    assert np.isfinite(found.cost)
