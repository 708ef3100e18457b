"""Every algorithm that can be named keeps the optimiser contract."""

import pytest

from ematwin.optimizers import algorithms
from ematwin.testing.optimizer_contract import CHECKS

NAMES = [algorithm.name for algorithm in algorithms()]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_contract(name, check):
    factories = {algorithm.name: algorithm for algorithm in algorithms()}
    check(factories[name].factory())
