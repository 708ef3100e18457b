"""How well a recording is explained without a fault, everything else free."""

import numpy as np
import pytest

from ematwin.estimation.held_healthy import held_healthy
from ematwin.estimation.laplace import width_at
from ematwin.estimation.problem import Problem
from naive.toy import NOISE, SAMPLES, Toy, fault, stacked

SPREAD = 0.05
FREE = [
    fault("wear"),
    fault("gap"),
    fault("nominal", role="nominal", lower=-1.0, spread=SPREAD),
]


def problem_of(wear: float, gap: float = 0.2, nominal: float = 0.0) -> Problem:
    """Wear and a nominal parameter have the same effect; a prior holds the latter."""
    toy = Toy(
        lambda c: stacked(c["wear"] + c["nominal"], c["gap"]), wear=wear, gap=gap, nominal=nominal
    )
    return Problem([toy], FREE)


def peak_at(problem: Problem, *point: float):
    return width_at(problem, np.array(point), least_noise=NOISE)


def test_the_rise_is_that_of_the_best_fit_in_which_the_prior_takes_the_faults_place() -> None:
    problem = problem_of(0.3)
    found = held_healthy(peak_at(problem, 0.3, 0.2, 0.0), [["wear"], ["gap"]])
    error = NOISE / np.sqrt(SAMPLES)
    assert found.rises[0] == pytest.approx(0.3**2 / (SPREAD**2 + error**2), rel=0.02)
    assert found.rises[1] == pytest.approx((0.2 / error) ** 2, rel=0.02)
    assert found.evaluations > 0


def test_a_fault_that_a_tolerance_explains_as_well_hardly_rises() -> None:
    problem = problem_of(0.0, nominal=0.04)
    found = held_healthy(peak_at(problem, 0.04, 0.2, 0.0), [["wear"]])
    assert 0.0 <= found.rises[0] < 1.0


def test_faults_that_are_held_together_rise_together() -> None:
    problem = problem_of(0.3)
    found = held_healthy(peak_at(problem, 0.3, 0.2, 0.0), [["wear", "gap"], ["wear"], ["gap"]])
    assert found.rises[0] == pytest.approx(found.rises[1] + found.rises[2], rel=0.02)
