"""A load beside the recorded one parts the misfit into valleys; the search finds the right one."""

import numpy as np

import ematwin
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import laplace
from ematwin.estimation.minima import other_minima
from ematwin.estimation.problem import Problem
from ematwin.models.bldc.channels import PHASES
from ematwin.models.unknown import Unknown
from naive.toy import Toy, fault, stacked

WAVES = 6.0  # to a unit of load: a descent from none ends in the wave where it starts


def waved(values):
    """Wear and load on one basis each; the load adds waves that no wear makes up for."""
    load = values["load_offset"]
    return stacked(values["wear"] + 0.1 * load, 0.5 * load, np.sin(2.0 * np.pi * WAVES * load))


def load(valleys: int) -> Unknown:
    return Unknown(
        "load_offset", "N*m", "", 0.0, -4.0, 4.0, "nuisance", spread=0.5, valleys=valleys
    )


def problem(valleys: int = 7) -> Problem:
    toy = Toy(waved, wear=0.3, load_offset=0.71)
    return Problem([toy], (fault("wear"), load(valleys)))


def test_the_valley_of_the_right_load_is_found_where_a_descent_from_none_is_not():
    case = problem()
    stuck = laplace(case, np.array([0.0, 0.0]))
    assert abs(stuck.point[1] - 0.71) > 0.1
    (found,) = other_minima(stuck, Descent())
    assert found.cost < 0.5 * stuck.cost
    np.testing.assert_allclose(found.point, [0.3, 0.71], atol=0.02)
    assert found.evaluations > 7 * 2 * 13


def test_nothing_is_looked_for_where_the_twin_explains_nothing():
    """Seconds for values that mean nothing: here the currents belong to another motion."""
    record = ematwin.simulate("reference", faults={"short_b": 0.2})
    backwards = {name: record.channels[name][::-1] for name in PHASES}
    kept = {name: x for name, x in record.channels.items() if name in ("command", "load")}
    found = ematwin.identify(ematwin.Recording(record.time, {**kept, **backwards}), threads=1)
    assert found.relative_misfit > 0.5
    assert found.verdict.grade == "none"
    assert found.evaluations < 3000
    assert any("these values mean nothing" in said for said in found.warnings)
