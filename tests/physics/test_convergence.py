"""Halving the step moves the answer at the expected rate; the default steps are short enough."""

import pytest
from benchmarks.convergence import STEPS, table

from ematwin.models.bldc.parameters import BldcActuator

# Share of the RMS of the filtered current that the default step may cost (docs/models.md).
BOUND = 0.002


@pytest.mark.parametrize("model", STEPS)
def test_the_smooth_case_converges_with_order_one(model):
    orders = [row.order for row in table(model, "smooth") if row.order is not None]
    assert orders == pytest.approx([1.0] * len(orders), abs=0.15)


@pytest.mark.parametrize("model", STEPS)
def test_the_default_step_errs_by_less_than_its_bound_in_the_default_case(model):
    rows = table(model, "default")
    default = pytest.approx(getattr(BldcActuator.load().steps, model))
    (at_default,) = [row.error for row in rows if row.step == default]
    assert at_default < BOUND
    # events spoil the order of a single halving, not the fall
    assert rows[-1].error < 0.5 * rows[0].error
