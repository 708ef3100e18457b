"""Minima of made-up problems: those that a search leaves, and with faults held healthy."""

import numpy as np
import pytest

from ematwin.estimation.descent import Descent
from ematwin.estimation.held_healthy import held_healthy
from ematwin.estimation.laplace import laplace, width_at
from ematwin.estimation.minima import other_minima
from ematwin.estimation.multistart import MultistartDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Tally
from ematwin.models.unknown import Unknown
from naive.toy import BASES, NOISE, SAMPLES, Toy, fault, stacked


def test_searches_that_fit_poorly_and_alike_are_enough_and_both_ends_are_kept():
    """Nothing tells one of the faults, so that no two searches end in the same place."""
    toy = Toy(lambda values: stacked(values["wear"]), wear=0.3)
    unexplained = BASES[3]
    toy.recording = toy.recording.changed(y=toy.recording.y + unexplained)
    state = Tally(Problem([toy], (fault("wear"), fault("idle"))), budget=10_000)
    MultistartDescent(state).run()
    assert state.stopped == "two searches fit alike"
    idle = [point[1] for point in (state.best, state.others[-1])]
    assert abs(idle[0] - idle[1]) > 0.02
    np.testing.assert_allclose([state.best[0], state.others[-1][0]], 0.3, atol=0.01)


def test_the_minimum_of_the_right_load_is_found_where_a_descent_from_none_is_not():
    """The load adds waves that no wear makes up for: a descent ends in the one where it starts."""

    def waved(values):
        load = values["load_offset"]
        waves = np.sin(2.0 * np.pi * 6.0 * load)
        return stacked(values["wear"] + 0.1 * load, 0.5 * load, waves)

    load = Unknown("load_offset", "N*m", "", 0.0, -4.0, 4.0, "nuisance", spread=0.5, valleys=7)
    problem = Problem([Toy(waved, wear=0.3, load_offset=0.71)], (fault("wear"), load))
    stuck = laplace(problem, np.array([0.0, 0.0]))
    assert abs(stuck.point[1] - 0.71) > 0.1
    (found,) = other_minima(stuck, Descent())
    assert found.cost < 0.5 * stuck.cost
    np.testing.assert_allclose(found.point, [0.3, 0.71], atol=0.02)
    assert found.evaluations > 7 * 2 * 13


# Faults held healthy, with all else free: a prior holds a parameter that acts as wear does.

SPREAD = 0.05
ERROR = NOISE / np.sqrt(SAMPLES)


def peak(wear: float, gap: float = 0.2, parameter: float = 0.0):
    """Where the recording of a toy with these values is explained by faults alone."""
    free = [fault("wear"), fault("gap")]
    free.append(fault("parameter", role="nominal", lower=-1.0, spread=SPREAD))
    truth = {"wear": wear, "gap": gap, "parameter": parameter}
    toy = Toy(lambda c: stacked(c["wear"] + c["parameter"], c["gap"]), **truth)
    point = np.array([wear + parameter, gap, 0.0])
    return width_at(Problem([toy], free), point, least_noise=NOISE)


def test_the_rise_is_that_of_the_best_fit_in_which_the_prior_takes_the_faults_place():
    found = held_healthy(peak(0.3), [["wear"], ["gap"], ["wear", "gap"]])
    wear, gap, both = found.rises
    assert wear == pytest.approx(0.3**2 / (SPREAD**2 + ERROR**2), rel=0.02)
    assert gap == pytest.approx((0.2 / ERROR) ** 2, rel=0.02)
    assert both == pytest.approx(wear + gap, rel=0.02)
    assert found.evaluations > 0


def test_a_fault_that_a_tolerance_explains_as_well_hardly_rises():
    found = held_healthy(peak(0.0, parameter=0.04), [["wear"]])
    assert 0.0 <= found.rises[0] < 1.0
