"""Candidates that were just simulated are not simulated again."""

import numpy as np
import pytest

from ematwin.estimation.latest import Latest


class Counting:
    """A comparison whose residuals are a sum and a difference; it counts its candidates."""

    def __init__(self) -> None:
        self.simulated = 0

    def residuals(self, candidates, count):
        self.simulated += count
        a, b = candidates["a"], candidates["b"]
        return np.stack([a + b, a - b], axis=1)


@pytest.fixture
def comparison():
    return Counting()


def candidates(*rows):
    return dict(zip("ab", np.array(rows, dtype=float).T, strict=True))


def test_one_candidate_of_the_latest_few_is_simulated_once(comparison):
    latest = Latest()
    trials = latest.residuals(comparison, candidates((1, 2), (3, 4), (5, 7)), 3)
    assert trials.tolist() == [[3, -1], [7, -1], [12, -2]]
    again = latest.residuals(comparison, candidates((5, 7)), 1)
    assert again.tolist() == [[12, -2]]
    # whatever the order in which values are named
    swapped = {"b": np.array([4.0]), "a": np.array([3.0])}
    assert latest.residuals(comparison, swapped, 1).tolist() == [[7, -1]]
    assert comparison.simulated == 3


def test_what_is_handed_out_can_be_changed(comparison):
    latest = Latest()
    latest.residuals(comparison, candidates((1, 2)), 1)[:] = 0.0
    latest.residuals(comparison, candidates((1, 2)), 1)[:] = 0.0
    assert latest.residuals(comparison, candidates((1, 2)), 1).tolist() == [[3, -1]]
    assert comparison.simulated == 1


def test_others_are_simulated(comparison):
    latest = Latest()
    latest.residuals(comparison, candidates((1, 2)), 1)
    assert latest.residuals(comparison, candidates((1, np.nextafter(2, 3))), 1).shape == (1, 2)
    other = Counting()
    assert latest.residuals(other, candidates((1, 2)), 1).tolist() == [[3, -1]]
    more = {**candidates((1, 2)), "c": np.array([0.0])}
    assert latest.residuals(comparison, more, 1).tolist() == [[3, -1]]
    assert (comparison.simulated, other.simulated) == (3, 1)


def test_memory_is_bounded(comparison):
    latest = Latest()
    latest.residuals(comparison, candidates((1, 2)), 1)
    for n in range(6):
        latest.residuals(comparison, candidates((n, 0)), 1)
    latest.residuals(comparison, candidates((1, 2)), 1)
    assert comparison.simulated == 8
    many = candidates(*[(n, 1) for n in range(40)])
    latest.residuals(comparison, many, 40)
    latest.residuals(comparison, candidates((7, 1)), 1)
    assert comparison.simulated == 49
