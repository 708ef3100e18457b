"""An algorithm of one's own gets a name in one line; objectives of one point need no flag."""

import numpy as np
import pytest

import ematwin
from ematwin.errors import InputError
from ematwin.optimizers import registry
from ematwin.optimizers.base import Optimizer
from ematwin.optimizers.random_search import RandomSearch


class Mine(RandomSearch):
    """Random search, renamed."""


@pytest.fixture
def named():  # type: ignore[no-untyped-def]
    ematwin.register("My_Search", Mine)
    yield "my-search"
    registry._REGISTERED.clear()


def sphere(point: np.ndarray) -> float:
    return float(point @ point)


def test_a_registered_name_is_used_like_any_other(named: str) -> None:
    found = ematwin.minimize(sphere, [-1, -1], [1, 1], named, 10, 5)
    assert found.algorithm == "my-search"
    assert registry.find("my_search").title == "Random search, renamed"
    again = ematwin.minimize(sphere, [-1, -1], [1, 1], "random", 10, 5)
    assert found.cost == again.cost


def test_a_name_of_ours_or_what_cannot_be_called_is_refused() -> None:
    with pytest.raises(InputError, match="'gwo' is taken"):
        ematwin.register("gwo", Mine)
    with pytest.raises(InputError, match="function that makes one"):
        ematwin.register("mine", 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no algorithm 'mine'"):
        registry.find("mine")


def test_what_cannot_search_is_refused_before_a_study_begins() -> None:
    class NoInit(Optimizer):
        """Its bases take no arguments."""

        def ask(self) -> np.ndarray:
            return np.zeros((1, 3))

        def tell(self, points: np.ndarray, costs: np.ndarray) -> None: ...

    class Flat(RandomSearch):
        def ask(self) -> np.ndarray:
            return super().ask()[0]

    class Outside(RandomSearch):
        def ask(self) -> np.ndarray:
            return super().ask() + 2.0

    with pytest.raises(InputError, match=r"'mine' is called with .* TypeError: NoInit"):
        ematwin.register("mine", NoInit)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"of shape \(3,\)\. Correct its ask"):
        ematwin.register("mine", Flat)
    with pytest.raises(InputError, match="asked for points outside the box"):
        ematwin.register("mine", Outside)
    with pytest.raises(InputError, match="Optimizer, but made dict"):
        ematwin.register("mine", lambda box, **given: dict(given))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no algorithm 'mine'"):
        registry.find("mine")


@pytest.mark.parametrize("population", [1, 2, 10])
@pytest.mark.parametrize(
    "objective",
    [
        sphere,
        lambda x: np.sum(x**2),
        lambda x: x[0] ** 2 + x[1] ** 2,
        lambda x: sum(value * value for value in x),
        lambda x: np.linalg.norm(x) ** 2,
        lambda x: (x**2).sum(axis=-1),
        lambda points: (
            [float(point @ point) for point in np.atleast_2d(points)][:1]
            if points.ndim == 1
            else [float(point @ point) for point in points]
        ),
    ],
)
def test_one_point_or_a_batch_is_found_out(objective, population: int) -> None:  # type: ignore[no-untyped-def]
    given = ematwin.minimize(sphere, [-1, -1], [1, 1], "random", population, 4, vectorized=False)
    found = ematwin.minimize(objective, [-1, -1], [1, 1], "random", population, 4)
    assert found.cost == pytest.approx(given.cost, rel=1e-12)
    np.testing.assert_array_equal(found.x, given.x)
    assert found.evaluations == given.evaluations


def test_an_error_of_the_objective_itself_comes_through() -> None:
    def broken(point: np.ndarray) -> float:
        raise ValueError("my own mistake")

    with pytest.raises(ValueError, match="my own mistake"):
        ematwin.minimize(broken, [-1, -1], [1, 1], "random", 5, 2)
