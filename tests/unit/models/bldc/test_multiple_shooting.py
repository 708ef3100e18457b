"""A record compared stretch by stretch."""

import numpy as np
import pytest

from bldc_inputs import HALF
from ematwin import Faults, identify, simulate
from ematwin.models.bldc.faults import error_percent_wrapped

# The actuator creeps on where the twin, given these very faults, stalls.
NEAR_STALL = Faults(
    friction=0.0, backlash=0.23, short_a=0.98, short_b=0.14, short_c=0.94, eccentricity=0.97,
    eccentricity_phase=0.11, gain=0.21,
)  # fmt: skip


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
