"""A recording is turned until nothing is left to turn; one that never settles is said to be so."""

import math

import numpy as np
import pytest

from ematwin.estimation.identify import estimate_initial_angle
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import named
from ematwin.models.comparison import Placed
from naive.toy import Toy, fault, stacked

TURNS = math.inf


class Turning(Toy):
    """A toy that asks to be turned so many times more."""

    unplaced = True

    def __init__(self, left: float, explained: bool = True) -> None:
        super().__init__(lambda v: stacked(v["wear"]), wear=0.3)
        self.left, self.explained = left, explained

    def placed(self, values):
        assert values["wear"] == pytest.approx(0.3, abs=0.01)
        if not self.explained:
            return Placed(None, "Nothing explains it.")
        if self.left == 0:
            return None
        return Placed(self.recording.changed(y=self.recording.y + 0.0), "It was turned.")


def placing(left: float, explained: bool = True):
    toys = []

    def problem_of(recording):
        toys.append(Turning(left - len(toys), explained))
        return Problem([toys[-1]], [fault("wear")])

    first = Turning(left).recording
    search = named("multistart")
    problem = problem_of(first)
    found = estimate_initial_angle(first, problem, problem_of, search, seed=1, progress=None)
    return found, toys


@pytest.mark.parametrize("left", [0, 1, 2])
def test_a_recording_is_turned_until_nothing_is_left(left):
    found, toys = placing(left)
    assert len(toys) == left + 1
    assert found.problem.comparisons[0] is toys[-1]
    assert found.said == (("It was turned.",) if left else ())
    assert np.abs(found.found.point[0] - 0.3) < 0.01
    assert found.obstacles == ()


def test_one_that_never_settles_gets_no_verdict():
    found, _ = placing(TURNS)
    assert found.found is None
    assert "could not be told" in found.obstacles[0]


def test_what_no_place_explains_is_an_obstacle():
    found, toys = placing(1, explained=False)
    assert len(toys) == 1
    assert found.obstacles == ("Nothing explains it.",)
