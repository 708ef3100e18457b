"""The independent actuator in ``tests/naive`` is the documented model.

With more in its structure it is compared with the truer forms (`test_truer_forms`).
"""

import numpy as np
import pytest

from bldc_inputs import equivalent, misfit
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import simulate as simulate_twin
from naive.another_actuator import Structure, parameters_of, simulate

TIME = np.linspace(0.0, 0.5, 50_001)
COMMAND, LOAD = Scenario.load_file("default").histories(TIME)
CASES = {
    "healthy": {},
    "friction and short": {"friction": 0.25, "short_b": 0.15},
    "eccentricity and backlash": {"eccentricity": 0.4, "backlash": 0.3},
    "all": {
        "friction": 0.3, "backlash": 0.1, "short_a": 0.5, "short_b": 0.1, "short_c": 0.2,
        "eccentricity": 0.3, "eccentricity_phase": 0.9, "gain": 0.8,
    },
}  # fmt: skip


@pytest.mark.parametrize("faults", CASES.values(), ids=CASES)
def test_neutral_structure_is_the_reference_model(faults):
    """Measured: 0.000 % in each; one switching instant that rounding moves makes some 0.1 %."""
    parameters = parameters_of(BldcActuator.load())
    other = simulate(parameters, TIME, COMMAND, LOAD, faults, Structure(), noise=0.0, bits=None)
    assert misfit(equivalent(other), equivalent(simulate_twin("reference", faults=faults))) < 0.003
