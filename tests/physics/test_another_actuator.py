"""The independent actuator in ``tests/naive`` is the documented model, and more on demand."""

import numpy as np
import pytest

from ematwin.models.bldc.envelope import signed_current
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import simulate as simulate_twin
from ematwin.numerics.signals import LowPass
from naive.another_actuator import TERMS, Structure, parameters_of, simulate, tuned

SERVO48 = parameters_of(BldcActuator.load())
RATE = 20_000.0
TIME = np.linspace(0.0, 0.5, 50_001)
COMMAND, LOAD = Scenario.load_file("default").histories(TIME)
REALISTIC = Structure.realistic()
CASES = {
    "healthy": {},
    "friction and short": {"friction": 0.25, "short_b": 0.15},
    "eccentricity and backlash": {"eccentricity": 0.4, "backlash": 0.3},
    "all": {
        "friction": 0.3, "backlash": 0.1, "short_a": 0.5, "short_b": 0.1, "short_c": 0.2,
        "eccentricity": 0.3, "eccentricity_phase": 0.9, "gain": 0.8,
    },
}  # fmt: skip


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def equivalent(record):
    current = signed_current(record, int(SERVO48["motor.pole_pairs"]))
    return LowPass(500.0).apply(record.current if current is None else current, RATE)


def answer(structure, faults=None, parameters=SERVO48):
    """Filtered equivalent current of this actuator in the default scenario, A."""
    record = simulate(parameters, TIME, COMMAND, LOAD, faults, structure, noise=0.0, bits=None)
    return equivalent(record)


def twin(model, faults, parameters=SERVO48):
    place = "controller.speed_gain"
    actuator = BldcActuator.load().changed({place: parameters[place]})
    return equivalent(simulate_twin(model, faults=faults, actuator=actuator))


def misfit(one, other):
    return rms(one - other) / rms(other)


@pytest.mark.parametrize("faults", CASES.values(), ids=CASES)
def test_neutral_structure_is_the_reference_model(faults):
    """Measured: 0.000 % in each; one switching instant that rounding moves makes some 0.1 %."""
    gap = misfit(answer(Structure(), faults), twin("reference", faults))
    print(f"{faults}: {100.0 * gap:.4f} %")
    assert gap < 0.003


@pytest.mark.parametrize("term", TERMS)
def test_each_term_changes_the_answer(term):
    """`pytest -s` prints what each makes against the neutral structure and against the twin.

    What the inverter loses is regulated away by a comparator: it shows behind a PI loop.
    """
    others = ("PI current loop",) if term == "lost voltage" else ()
    structure = REALISTIC.only(term, *others)
    parameters = tuned(SERVO48, structure)
    with_term = answer(structure, parameters=parameters)
    change = misfit(with_term, answer(REALISTIC.only(*others), parameters=parameters))
    gap = misfit(with_term, twin("monitor", {}, parameters))
    print(f"{term}: changes {100.0 * change:.2f} %, misfit of the twin {100.0 * gap:.2f} %")
    assert 0.004 < change < 0.1
