"""Answers by what arrays hold."""

import numpy as np

from ematwin.numerics.remembered import Remembered


def test_an_answer_is_asked_for_once_and_by_content() -> None:
    asked = []

    def summed(x: np.ndarray) -> float:
        asked.append(x.sum())
        return float(x.sum())

    known = Remembered[float]()
    x = np.arange(6.0).reshape(2, 3)
    found = [known.of([one], lambda one=one: summed(one)) for one in (x, x.copy(), x[::-1], x)]
    assert found == [15.0] * 4
    assert len(asked) == 2  # the second is the first, the third has other rows
    x[0, 0] = 7.0
    assert known.of([x], lambda: summed(x)) == 22.0


def test_nothing_found_is_an_answer_too() -> None:
    asked = []
    known = Remembered[None]()
    for _ in range(3):
        assert known.of([np.ones(3)], lambda: asked.append(1)) is None
    assert len(asked) == 1


def test_only_the_latest_are_kept() -> None:
    asked = []
    known = Remembered[None]()
    for n in (*range(20), 0, 19):
        known.of([np.array([float(n)])], lambda n=n: asked.append(n))
    assert asked == [*range(20), 0]
