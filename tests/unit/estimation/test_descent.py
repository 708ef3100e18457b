"""Descents of everything together: where they begin, what they hold, and when they end."""

import numpy as np
import pytest

from ematwin.estimation.descent import Descent, TooFarError
from ematwin.estimation.problem import Problem
from naive.toy import Toy, fault, stacked


def features(values):
    return stacked(values["a"], values["b"] + values["a"] ** 2)


@pytest.fixture
def problem():
    return Problem([Toy(features, a=0.3, b=0.6)], (fault("a"), fault("b")))


TRUTH = np.array([0.3, 0.6])


def test_it_goes_to_the_truth_and_counts_what_it_took(problem) -> None:
    simulated = []
    toy = problem.comparisons[0]
    plain = toy.residuals
    toy.residuals = lambda candidates, count: simulated.append(count) or plain(candidates, count)
    point, spent = Descent().end(problem, np.array([0.9, 0.1]))
    np.testing.assert_allclose(point, TRUTH, atol=1e-4)
    assert spent == sum(simulated)


def test_what_is_held_stays_and_the_rest_goes_where_that_has_it(problem) -> None:
    point, _ = Descent(held=("a",)).end(problem, np.array([0.5, 0.0]))
    assert point[0] == 0.5
    assert point[1] == pytest.approx(0.6 + 0.3**2 - 0.5**2, abs=1e-4)


def test_a_smooth_stage_that_ends_too_far_is_not_gone_on_with(problem) -> None:
    noise = problem.comparisons[0].expected_misfit
    best = problem.relative_misfit(problem.costs(TRUTH[None])[0])
    assert best > noise
    Descent(within=1.1 * best).end(problem, np.array([0.9, 0.1]))
    with pytest.raises(TooFarError):
        Descent(within=0.9 * best).end(problem, np.array([0.9, 0.1]))
