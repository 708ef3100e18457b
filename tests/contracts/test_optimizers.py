"""Every algorithm that can be named keeps the optimiser contract."""

import pytest

from ematwin.optimizers import algorithms
from ematwin.testing.optimizer_contract import (
    CHECKS,
    check_batches_are_float_arrays_inside_the_box,
    check_the_budget_is_spent_exactly,
)

FACTORIES = {one.name: one for one in algorithms()}
# an adapter keeps the contract for all algorithms of its library
ADAPTERS = {"cma", "scipy-de", "nevergrad-de", "pymoo-ga", "pygmo-de", "pygmo-pso-gen"}
OF_THEIR_OWN = (check_batches_are_float_arrays_inside_the_box, check_the_budget_is_spent_exactly)


@pytest.mark.parametrize(
    ("name", "check"),
    [
        pytest.param(name, check, id=f"{name}-{check.__name__}")
        for name, one in FACTORIES.items()
        for check in (OF_THEIR_OWN if one.requires and name not in ADAPTERS else CHECKS)
    ],
)
def test_contract(name, check):
    check(FACTORIES[name].factory())


def test_every_library_is_among_the_adapters():
    libraries = {one.requires for one in FACTORIES.values() if one.requires}
    assert libraries == {FACTORIES[name].requires for name in ADAPTERS}
