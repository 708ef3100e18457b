"""The search loop: budgets, reasons to stop, interrupts, checkpoints, bad input."""

import os
from functools import partial

import numpy as np
import pytest

from ematwin.errors import FileError, InputError
from ematwin.optimizers import Box, DifferentialEvolution, GreyWolf, Progress, minimize

LOWER, UPPER = [0.0] * 4, [1.0] * 4
OPTIMUM = np.array([0.3, 0.6, 0.4, 0.7])
SIX = ["ga", "pso", "de", "gwo", "da", "woa"]


def sphere(points):
    return ((points - OPTIMUM) ** 2).sum(axis=1)


def same(one, two):
    return (
        np.array_equal(one.x, two.x)
        and one.cost == two.cost
        and np.array_equal(one.history.cost, two.history.cost)
        and np.array_equal(one.history.evaluations, two.history.evaluations)
    )


class Stopping:
    """An objective that gives no cost above its limit, and counts how often it did not."""

    def __init__(self, costs):
        self.costs, self.stopped = costs, 0

    def __call__(self, points):
        return self.costs(points)

    def costs_within(self, points, limits):
        costs = self.costs(points)
        over = costs > limits
        self.stopped += over.sum()
        return np.where(over, np.inf, costs)


def test_limits_are_given_again_after_a_checkpoint(tmp_path):
    path = tmp_path / "search"
    minimize(Stopping(sphere), LOWER, UPPER, "de", checkpoint=path, checkpoint_every=1,
             callback=lambda now: now.evaluations >= 500)  # fmt: skip
    stopping = Stopping(sphere)
    resumed = minimize(stopping, LOWER, UPPER, "de", checkpoint=path)
    assert same(resumed, minimize(sphere, LOWER, UPPER, "de"))
    assert stopping.stopped > 0


def test_history_falls_and_ends_at_the_best():
    result = minimize(sphere, LOWER, UPPER, "pso", iterations=20)
    assert np.all(np.diff(result.history.cost) <= 0)
    assert result.history.cost[-1] == result.cost == sphere(result.x[None])[0]
    assert len(result.history) == 20


def test_a_target_ends_the_search():
    result = minimize(sphere, LOWER, UPPER, "de", target=1e-3)
    assert result.stopped == "target"
    assert result.cost <= 1e-3
    assert result.evaluations < 10_000


def test_stagnation_ends_the_search():
    result = minimize(lambda points: np.ones(len(points)), LOWER, UPPER, "pso", stagnation=200)
    assert result.stopped == "stagnation"
    assert result.evaluations == 250  # the first batch found the cost, four more did not lower it


def test_a_callback_sees_progress_and_can_stop():
    seen = []

    def callback(progress):
        seen.append(progress)
        return progress.evaluations >= 150

    result = minimize(sphere, LOWER, UPPER, callback=callback)
    assert result.stopped == "callback"
    assert [progress.evaluations for progress in seen] == [50, 100, 150]
    assert isinstance(seen[0], Progress)
    assert seen[-1].cost == result.cost
    assert seen[-1].budget == 10_000


def test_algorithms_are_names_classes_partials_or_objects():
    settings = {"population": 20, "iterations": 5, "seed": 3}
    by_name = minimize(sphere, LOWER, UPPER, "de", **settings)
    by_class = minimize(sphere, LOWER, UPPER, DifferentialEvolution, **settings)
    ready = DifferentialEvolution(Box(LOWER, UPPER), **settings)
    by_object = minimize(sphere, LOWER, UPPER, ready)
    assert same(by_name, by_class)
    assert same(by_name, by_object)
    assert by_object.seed == 3
    other = minimize(sphere, LOWER, UPPER, partial(DifferentialEvolution, F=0.9), **settings)
    assert not same(by_name, other)


def test_the_objective_may_write_into_its_points():
    def spoils(points):
        costs = sphere(points)
        points[:] = 7.0
        return costs

    assert same(minimize(spoils, LOWER, UPPER, "pso"), minimize(sphere, LOWER, UPPER, "pso"))


@pytest.mark.parametrize("name", [*SIX, "ga-binary", "random", "cma", "nevergrad-de"])
def test_a_search_killed_and_resumed_gives_the_same_result(name, tmp_path):
    path = tmp_path / "search.ckpt"
    settings = {"algorithm": name, "population": 20, "budget": 615}
    whole = minimize(sphere, LOWER, UPPER, **settings)

    class KilledError(Exception):
        pass

    calls = 0

    def dies(points):
        nonlocal calls
        calls += 1
        if calls == 18:
            raise KilledError
        return sphere(points)

    with pytest.raises(KilledError):
        minimize(dies, LOWER, UPPER, **settings, checkpoint=path, checkpoint_every=5)
    calls = 100
    resumed = minimize(dies, LOWER, UPPER, **settings, checkpoint=path, checkpoint_every=5)
    assert calls == 100 + 31 - 15  # 15 batches had been saved
    assert same(whole, resumed)
    again = minimize(dies, LOWER, UPPER, **settings, checkpoint=path)
    assert calls == 116
    assert same(whole, again)
    assert [file.name for file in tmp_path.iterdir()] == ["search.ckpt"]


def test_a_checkpoint_of_another_search_is_refused(tmp_path):
    path = tmp_path / "search.ckpt"
    minimize(sphere, LOWER, UPPER, "gwo", iterations=3, checkpoint=path)
    with pytest.raises(InputError, match="its seed is 1, but 2"):
        minimize(sphere, LOWER, UPPER, "gwo", iterations=3, seed=2, checkpoint=path)
    with pytest.raises(InputError, match="algorithm"):
        minimize(sphere, LOWER, UPPER, "woa", iterations=3, checkpoint=path)


def test_a_file_that_is_no_checkpoint_is_refused(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a checkpoint")
    with pytest.raises(FileError, match="not a checkpoint"):
        minimize(sphere, LOWER, UPPER, checkpoint=path)
    assert path.read_text() == "not a checkpoint"
    with pytest.raises(FileError, match="No such file or directory"):
        minimize(sphere, LOWER, UPPER, iterations=1, checkpoint=tmp_path / "none" / "c")


@pytest.mark.skipif(os.name != "posix", reason="there are no POSIX rights")
def test_a_checkpoint_is_for_its_user_alone(tmp_path):
    path = tmp_path / "search.ckpt"
    minimize(sphere, LOWER, UPPER, iterations=1, checkpoint=path)
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_method_that_cannot_be_pickled_takes_no_checkpoint(tmp_path):
    with pytest.raises(InputError, match="cannot be written to a checkpoint"):
        minimize(sphere, LOWER, UPPER, "pygmo-de", checkpoint=tmp_path / "c")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["pso", "scipy-de"])
def test_an_interrupt_keeps_the_best_found_so_far(name):
    calls = 0

    def interrupted(points):
        nonlocal calls
        calls += 1
        if calls == 4:
            raise KeyboardInterrupt
        return sphere(points)

    result = minimize(interrupted, LOWER, UPPER, name)
    assert result.stopped == "interrupted"
    assert result.evaluations == 150
    assert "best found so far" in result.message
    assert result.cost == sphere(result.x[None])[0]


def test_an_interrupt_before_any_cost_is_an_interrupt():
    def interrupted(points):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        minimize(interrupted, LOWER, UPPER)


def test_an_error_of_the_objective_reaches_the_caller_and_ends_threads():
    import threading

    before = threading.active_count()
    with pytest.raises(ZeroDivisionError):
        minimize(lambda points: 1 / 0, LOWER, UPPER, "pygmo-de")
    assert threading.active_count() == before


# Objectives of one point


def of_one_point(x):
    """The sphere, for a point of shape (4,)."""
    return (
        (x[0] - OPTIMUM[0]) ** 2 + (x[1] - OPTIMUM[1]) ** 2
        + (x[2] - OPTIMUM[2]) ** 2 + (x[3] - OPTIMUM[3]) ** 2
    )  # fmt: skip


@pytest.mark.parametrize("population", [4, 50])
@pytest.mark.parametrize(
    "mistaken",
    [
        of_one_point,
        lambda x: x[0] ** 2 + x[1] ** 2,
        lambda x: np.sum((x - 0.5) ** 2),
        lambda x: float(np.abs(x).max()),
        lambda x: (x**2).sum(axis=0),
    ],
    ids=["each variable", "two variables", "a sum", "a float", "first axis"],
)
def test_an_objective_of_one_point_that_is_given_a_batch_is_recognised(mistaken, population):
    with pytest.raises(InputError, match="vectorized=False"):
        minimize(mistaken, LOWER, UPPER, population=population, vectorized=True)


def test_an_error_at_the_first_points_names_the_mistake_and_stays_what_it_is():
    def branches(x):
        return 1.0 if x[0] > 0.5 else 2.0

    with pytest.raises(ValueError, match="ambiguous") as caught:
        minimize(branches, LOWER, UPPER, vectorized=True)
    assert "vectorized=False" in caught.value.__notes__[0]

    def broken(x):
        raise ValueError("my own mistake")

    with pytest.raises(ValueError, match="my own mistake"):
        minimize(broken, LOWER, UPPER, "random", 5, 2)


@pytest.mark.parametrize("population", [1, 2, 10])
@pytest.mark.parametrize(
    "objective",
    [
        lambda x: float(x @ x),
        lambda x: np.sum(x**2),
        lambda x: x[0] ** 2 + x[1] ** 2,
        lambda x: sum(value * value for value in x),
        lambda x: np.linalg.norm(x) ** 2,
        lambda x: (x**2).sum(axis=-1),
        lambda points: [float(point @ point) for point in np.atleast_2d(points)],
    ],
)
def test_one_point_or_a_batch_is_found_out(objective, population):
    settings = [-1, -1], [1, 1], "random", population, 4
    given = minimize(lambda x: x @ x, *settings, vectorized=False)
    found = minimize(objective, *settings)
    assert found.cost == pytest.approx(given.cost, rel=1e-12)
    np.testing.assert_array_equal(found.x, given.x)
    assert found.evaluations == given.evaluations


def bad(match, **changed):
    settings = {"objective": sphere, "lower": LOWER, "upper": UPPER} | changed
    return pytest.param(settings, match, id=match)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        bad("no finite cost in 100", objective=lambda p: np.full(len(p), np.nan), budget=100),
        bad("one cost per point", objective=lambda p: np.ones((len(p), 1))),
        bad("must give one cost: .* leave out", objective=lambda p: p, vectorized=False),
        bad("numbers, received str", objective=lambda p: "a", vectorized=False),
        bad("must give numbers", objective=lambda p: ["a"] * len(p)),
        bad("budget must be a whole number of at least 1, received 0", budget=0),
        bad("budget must be a whole number of at least 1, received 2.5", budget=2.5),
        bad("population must be a whole number of at least 1", population=0),
        bad("iterations must be a whole number of at least 1", iterations=0),
        bad("seed must be a whole number of at least 0", seed=-1),
        bad("variable 2 has 1 to 1", lower=[0, 0, 1, 0]),
        bad("differ in length", lower=[0.0]),
        bad("must be finite", upper=[np.inf] * 4),
        bad("list of d numbers", lower=0.0, upper=1.0),
        bad("must be numbers", lower=["a", "b", "c", "d"]),
        bad("overflows", lower=[-1e308] * 4, upper=[1e308] * 4),
        bad("Did you mean", algorithm="gow"),
        bad("Known are ga", algorithm="zzzzzz"),
        bad("a name, an Optimizer or a factory", algorithm=3),
        bad("must make an ematwin.optimizers.Optimizer", algorithm=lambda box, **_: 3),
        bad("a different box", algorithm=GreyWolf(Box([0.0], [1.0]))),
        bad("target must be a cost", target=float("nan")),
        bad("stagnation must be a whole number of at least 1", stagnation=0),
        bad("population must be a whole number of at least 5", algorithm="de", population=4),
    ],
)
def test_bad_input_is_told_in_a_sentence(settings, match):
    with pytest.raises(InputError, match=match) as caught:
        minimize(**settings)
    assert "\n" not in str(caught.value)
