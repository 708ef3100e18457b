"""A problem: points in, costs and residuals out, whatever the actuator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ematwin import BldcActuator, Noise, Problem, identify, simulate
from ematwin.errors import InputError, RecordError
from ematwin.estimation.prior import Prior
from ematwin.estimation.search import find, named
from ematwin.models.unknown import Unknown
from naive.toy import Line

SLOPE = Unknown("slope", "A/s", "", 0.0, -5.0, 5.0)
OFFSET = Unknown("offset", "A", "", 0.0, -2.0, 2.0, role="nuisance")


@pytest.mark.parametrize(
    "algorithm", ["multistart", "levenberg-marquardt", "scipy-trf", "de", "cma"]
)
def test_every_method_solves_a_problem_without_any_actuator(algorithm: str) -> None:
    problem = Problem([Line(2.0, -1.0)], [SLOPE, OFFSET])
    found = find(problem, named(algorithm), budget=3000, seed=1)
    assert np.allclose(found.point, [2.0, -1.0], atol=0.02)
    assert found.evaluations <= 3000


def test_a_bound_is_met_where_least_squares_of_scipy_meet_it() -> None:
    narrow = replace(OFFSET, upper=0.2)
    line = Line(2.0, 1.0)
    found = find(Problem([line], [SLOPE, narrow]), named("levenberg-marquardt"))
    columns = np.column_stack([line.t, np.ones(line.t.size)])
    expected = lsq_linear(columns, line.recording.y, ([-5.0, -2.0], [5.0, 0.2])).x
    assert np.allclose(found.point, expected, atol=1e-3)


def test_recordings_share_an_unknown_and_have_others_of_their_own() -> None:
    lines = [Line(2.0, -1.0), Line(2.0, 0.5), Line(2.0, 1.5)]
    problem = Problem(lines, [SLOPE, OFFSET], own=["offset"])
    assert problem.names == ("slope", "offset@0", "offset@1", "offset@2")
    found = find(problem, named("lm"))
    assert np.allclose(found.point, [2.0, -1.0, 0.5, 1.5], atol=1e-4)
    assert problem.residuals(found.point[None]).shape == (1, 150)


class Stopping(Line):
    """A line that gives no cost above its limit."""

    stopped = 0

    def costs_within(self, candidates, count, limits):
        costs = self.costs(candidates, count)
        self.stopped += (costs > limits).sum()
        return np.where(costs > limits, np.inf, costs)


@pytest.mark.parametrize("algorithm", ["de", "pso", "gwo", "woa", "random", "ga"])
def test_stopping_candidates_early_changes_nothing_of_a_search(algorithm: str) -> None:
    """Over several recordings and a prior too: each gets what the others leave of the limit."""
    prior = Unknown("slope", "A/s", "", 1.0, 0.1, 5.0, spread=0.2, logarithmic=True)
    answers = []
    for kind in (Line, Stopping):
        lines = [kind(2.0, -1.0), kind(2.5, 0.5), kind(2.0, 0.0)]
        answers.append(find(Problem(lines, [prior, OFFSET]), named(algorithm), budget=777))
    plain, stopping = answers
    np.testing.assert_array_equal(plain.point, stopping.point)
    np.testing.assert_array_equal(plain.history, stopping.history)
    stopped = [line.stopped for line in lines if isinstance(line, Stopping)]
    assert (min(stopped) > 0) == (algorithm != "ga")


def test_costs_are_the_sums_of_squared_residuals_priors_included() -> None:
    prior = Unknown("slope", "A/s", "", 1.0, 0.1, 5.0, spread=0.2, logarithmic=True)
    problem = Problem([Line(2.0, 0.0), Line(2.5, 0.0)], [prior, OFFSET])
    points = np.random.default_rng(1).uniform(problem.lower, problem.upper, (9, 2))
    squares = (problem.residuals(points) ** 2).sum(axis=1)
    assert np.allclose(problem.costs(points), squares)
    assert problem.residuals(points).shape == (9, 101)
    assert np.allclose(problem.residuals(points)[:, -1], np.log(points[:, 0]) / 0.2)


def test_holding_an_unknown_leaves_what_its_prior_says_of_the_others() -> None:
    """The distance from a prior is that of the held value and that of the rest, given it."""
    covariance = np.array([[0.5, 0.3], [0.3, 0.4]])
    prior = Prior(("slope", "offset"), np.array([0.4, -0.1]), covariance)
    full = Problem([Line(1.0, 0.0, noise=0.1)], [SLOPE, OFFSET], prior=prior)
    points = np.column_stack([np.full(9, 1.2), np.linspace(-2.0, 2.0, 9)])
    rest = full.costs(points) - full.holding({"slope": 1.2}).costs(points[:, 1:])
    assert np.allclose(rest, full.noise**2 * (1.2 - 0.4) ** 2 / 0.5)


def test_a_parameter_is_searched_beside_the_faults() -> None:
    actuator = BldcActuator.load()
    warm = actuator.changed({"motor.emf_constant": 0.96 * actuator.motor.emf_constant})
    record = simulate("reference", faults={"friction": 0.2}, actuator=warm, noise=Noise(white=0.02))
    found = identify(record, actuator, only=["friction", "motor.emf_constant"])
    ratio = found.values["motor.emf_constant"] / actuator.motor.emf_constant
    # half of its standard error by a data sheet: all else is uncertain too
    assert ratio == pytest.approx(0.96, abs=0.017)
    low, high = found.intervals["motor.emf_constant"]
    assert high - low == pytest.approx(0.14 * actuator.motor.emf_constant, rel=0.15)
    assert found.faults.friction == pytest.approx(0.2, abs=0.02)


def test_least_squares_of_scipy_start_anew_until_the_budget_is_spent() -> None:
    problem = Problem([Line(2.0, -1.0)], [SLOPE, OFFSET])
    spent: list[int] = []
    search = named("scipy-trf")
    found = search.run(problem, budget=100, seed=1, report=lambda n, cost: spent.append(n))
    assert found.evaluations == spent[-1] == 99  # a residual and its slopes are three
    assert np.all(np.diff(found.history[:, 1]) <= 0.0)
    again = search.run(problem, budget=100, seed=1, report=lambda n, cost: None)
    assert np.array_equal(found.history, again.history)
    with pytest.raises(InputError, match="at least 3 evaluations, received 2"):
        search.run(problem, budget=2, seed=1, report=lambda n, cost: None)


def test_a_twin_that_diverges_everywhere_is_told() -> None:
    class Diverging(Line):
        def residuals(self, candidates, count):
            return np.full((count, 50), np.nan)

    with pytest.raises(RecordError, match="diverged for each"):
        named("scipy-trf").run(
            Problem([Diverging(2.0, -1.0)], [SLOPE, OFFSET]),
            budget=90,
            seed=1,
            report=lambda n, cost: None,
        )
