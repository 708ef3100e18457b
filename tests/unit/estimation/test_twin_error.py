"""How much larger errors are than the noise of a fit, from noise to what a twin lacks."""

import math
from types import SimpleNamespace

import pytest

import ematwin
from ematwin.estimation.problem import Problem
from ematwin.estimation.twin_error import twin_error


@pytest.fixture(scope="module")
def problem() -> Problem:
    recording = ematwin.simulate("reference", noise=ematwin.Noise(white=0.02), seed=1)
    return Problem.of(recording, "servo48")


def test_a_fit_within_noise_has_the_usual_error(problem) -> None:
    kind = SimpleNamespace(model_error=2.0, lacking_error=4.0)
    scale = sum(one.scale for one in problem.comparisons)
    for misfit in (0.0, 0.5 * problem.recorded_misfit, problem.recorded_misfit):
        assert twin_error(kind, problem, misfit**2 * scale) == pytest.approx(2.0)


def test_errors_grow_with_what_noise_does_not_leave_and_have_a_limit(problem) -> None:
    kind = SimpleNamespace(model_error=2.0, lacking_error=4.0)
    scale = sum(one.scale for one in problem.comparisons)
    found = [
        twin_error(kind, problem, (n * problem.recorded_misfit) ** 2 * scale) for n in (1, 2, 3, 99)
    ]
    assert found == sorted(found)
    assert found[1] == pytest.approx(math.sqrt(0.25 * 4.0 + 0.75 * 16.0))
    assert found[-1] == pytest.approx(4.0, rel=1e-3)


def test_a_kind_that_does_not_say_has_one_error(problem) -> None:
    kind = SimpleNamespace(model_error=2.0, lacking_error=None)
    assert twin_error(kind, problem, 100.0) == 2.0
