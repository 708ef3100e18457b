"""A load beside the recorded one parts the misfit into valleys; the search finds the right one."""

from dataclasses import replace

import numpy as np

import ematwin
from ematwin.estimation.descent import Descent
from ematwin.estimation.laplace import laplace
from ematwin.estimation.other_minima import other_minima
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


def test_nothing_is_looked_for_where_no_unknown_has_valleys_or_it_is_held():
    case = problem(valleys=1)
    stuck = laplace(case, np.array([0.0, 0.0]))
    assert other_minima(stuck, Descent()) == []
    case = problem()
    stuck = laplace(case, np.array([0.0, 0.0]))
    assert other_minima(stuck, Descent(held={"load_offset"})) == []


def test_anew_parameters_set_out_from_what_was_known_of_them():
    """What a wrong valley forced on a parameter leads the next descents astray."""

    def stiffened(values):
        stiffer = values["motor.stiffness"] - 1.0
        load = values["load_offset"]
        wave = np.sin(2.0 * np.pi * WAVES * (load - stiffer))
        return stacked(values["wear"] + 0.1 * load, 0.5 * load, wave, 0.5 * stiffer)

    toy = Toy(stiffened, **{"wear": 0.3, "load_offset": 0.71, "motor.stiffness": 1.0})
    stiffness = Unknown("motor.stiffness", "", "", 1.0, 0.0, 2.0, "nominal")
    case = Problem([toy], (fault("wear"), load(7), stiffness))
    stuck = laplace(case, np.array([0.0, 0.0, 1.0]))
    forced = replace(stuck, z=case.chart.from_values(np.array([[0.3, 0.0, 1.5]]))[0])
    (astray,) = other_minima(forced, Descent())
    (found,) = other_minima(forced, Descent(), anew=True)
    assert found.cost < 0.5 * astray.cost
    np.testing.assert_allclose(found.point, [0.3, 0.71, 1.0], atol=0.02)
    (kept,) = other_minima(forced, Descent(held={"motor.stiffness"}), anew=True)
    assert kept.point[2] == 1.5


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
