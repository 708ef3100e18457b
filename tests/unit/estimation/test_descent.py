"""Descents of everything together: where they begin, what they hold, and when they end."""

import numpy as np
import pytest

from ematwin.estimation.aliases import directions, held_by
from ematwin.estimation.descent import Descent, TooFarError
from ematwin.estimation.problem import Problem
from ematwin.models.unknown import Alias, Unknown
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


def test_directions_are_in_shares_of_ranges() -> None:
    toy = Toy(lambda values: stacked(values["a"] + values["b"]), a=0.3, b=0.6)
    wide = Unknown("b", "", "", 0.0, -2.0, 2.0)
    case = Problem([toy], (fault("a"), wide))

    def aliases(values):
        assert values == {"a": 0.1, "b": 0.2}
        return [Alias("b", {"a": 1.0}), Alias("a", {"gone": 1.0}), Alias("gone", {"a": 1.0})]

    point = np.array([0.1, 0.2])
    (one,) = directions(case, point, aliases)
    assert one.pivot == 1
    np.testing.assert_allclose(one.same, [4.0, 0.0])  # one of b's range is four of a's
    np.testing.assert_allclose(one.blind, [-1.0, 0.25])
    along = case.chart.to_values(case.chart.from_values(point[None]) + 0.1 * one.blind)
    left = case.residuals(np.vstack([point, along]))
    np.testing.assert_allclose(left[0], left[1], atol=1e-12)
    assert held_by(case, point, aliases) == {"b"}
    assert held_by(case, point, None) == set()
    free = [Alias("b", {"a": 1.0}, held=False)]
    assert held_by(case, point, lambda values: free) == set()
