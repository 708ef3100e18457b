"""What every optimiser must do, as checks that can be run on any of them.

Under pytest::

    import pytest
    from ematwin.testing.optimizer_contract import CHECKS

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_contract(check):
        check(MyOptimizer)

or plainly ``check_optimizer(MyOptimizer)``, which runs all of them.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import closing

import numpy as np

from ematwin.errors import InputError
from ematwin.optimizers import Box, Optimizer, OptimizerFactory, RandomSearch, minimize
from ematwin.optimizers.base import FloatArray

POPULATION = 20
ITERATIONS = 30

Costs = Callable[[FloatArray], FloatArray]

# Not the unit cube and nothing in the middle: a method that rescales wrongly shows.
_LOWER = np.array([-1.0, 2.0, -30.0, 0.0])
_UPPER = np.array([3.0, 2.5, 10.0, 1.0])
_OPTIMUM = _LOWER + np.array([0.31, 0.62, 0.44, 0.73]) * (_UPPER - _LOWER)


def sphere(points: FloatArray) -> FloatArray:
    """Squared distance to a point inside the box, in spans of the box."""
    return (((points - _OPTIMUM) / (_UPPER - _LOWER)) ** 2).sum(axis=1)


def _made(factory: OptimizerFactory, seed: int = 3) -> closing[Optimizer]:
    box = Box(_LOWER, _UPPER)
    return closing(factory(box, population=POPULATION, iterations=ITERATIONS, seed=seed))


def _run(optimizer: Optimizer, costs: Costs, batches: int) -> list[FloatArray]:
    asked = []
    for _ in range(batches):
        points = optimizer.ask()
        asked.append(points)
        optimizer.tell(points, costs(points))
    return asked


def _equal(first: list[FloatArray], second: list[FloatArray]) -> bool:
    return len(first) == len(second) and all(map(np.array_equal, first, second))


def check_batches_are_float_arrays_inside_the_box(factory: OptimizerFactory) -> None:
    with _made(factory) as optimizer:
        for points in _run(optimizer, sphere, ITERATIONS + 3):
            assert points.dtype == np.float64
            assert points.ndim == 2
            assert points.shape[1] == len(_LOWER)
            assert optimizer.box.contains(points), "a point lies outside the box"


def check_batch_size_is_constant(factory: OptimizerFactory) -> None:
    """All batches have as many rows, unless the optimiser says otherwise."""
    with _made(factory) as optimizer:
        sizes = {len(points) for points in _run(optimizer, sphere, ITERATIONS)}
        assert len(sizes) == 1 or not optimizer.constant_batch, f"batches of {sorted(sizes)}"


def check_asking_twice_gives_the_same_batch(factory: OptimizerFactory) -> None:
    """A batch waits for its costs; it may be changed by who asked."""
    with _made(factory) as optimizer:
        _run(optimizer, sphere, 2)
        first = optimizer.ask()
        kept = first.copy()
        first[:] = np.nan
        assert np.array_equal(optimizer.ask(), kept)


def check_same_seed_same_run(factory: OptimizerFactory) -> None:
    """A seed makes the run repeatable bit for bit, whatever the global random state."""
    with _made(factory) as one, _made(factory) as two:
        first = _run(one, sphere, 10)
        np.random.seed(5)  # noqa: NPY002
        np.random.random(7)  # noqa: NPY002
        assert _equal(first, _run(two, sphere, 10)), "two runs with one seed differ"


def check_other_seed_other_run(factory: OptimizerFactory) -> None:
    with _made(factory, seed=3) as one, _made(factory, seed=4) as two:
        assert not _equal(_run(one, sphere, 3), _run(two, sphere, 3))


def check_pickled_in_mid_run_it_goes_on_identically(factory: OptimizerFactory) -> None:
    """Restored from a pickle, between batches or while one waits, it gives the same run."""
    with _made(factory) as whole, _made(factory) as optimizer:
        if not whole.picklable:
            return
        expected = _run(whole, sphere, 12)
        head = _run(optimizer, sphere, 5)
        again = pickle.loads(pickle.dumps(optimizer))
        again.ask()
        again = pickle.loads(pickle.dumps(again))
        assert _equal(head + _run(again, sphere, 7), expected)


def check_costs_that_are_not_finite_count_as_worst(factory: OptimizerFactory) -> None:
    """NaN, inf and -inf lead to the same run, and to finite points."""

    def bad(value: float) -> Costs:
        return lambda points: np.where(points[:, 0] < 1.5, sphere(points), value)

    runs = []
    for value in (np.nan, np.inf, -np.inf):
        with _made(factory) as optimizer:
            runs.append(_run(optimizer, bad(value), ITERATIONS))
        assert all(np.isfinite(points).all() for points in runs[-1])
    assert _equal(runs[0], runs[1]), "NaN and inf lead to different runs"
    assert _equal(runs[1], runs[2]), "inf and -inf lead to different runs"


def check_all_costs_nan_is_survived(factory: OptimizerFactory) -> None:
    with _made(factory) as optimizer:
        nothing = _run(optimizer, lambda points: np.full(len(points), np.nan), 5)
        assert all(optimizer.box.contains(points) for points in nothing)


def check_limits_change_nothing(factory: OptimizerFactory) -> None:
    """Told infinity for costs above its limits, where it gives any, it asks the same batches."""

    def in_steps(points: FloatArray) -> FloatArray:
        return np.round(sphere(points), 2)  # ties: a cost at its limit is not above it

    with _made(factory) as plain, _made(factory) as stopped:
        for costs in (sphere, in_steps):
            for expected in _run(plain, costs, ITERATIONS):
                points = stopped.ask()
                assert np.array_equal(points, expected), "limits change the search"
                told, limits = costs(points), stopped.limits()
                if limits is not None:
                    assert limits.shape == told.shape
                    told[told > limits] = np.inf
                stopped.tell(points, told)


def check_part_of_a_batch_can_be_told(factory: OptimizerFactory) -> None:
    with _made(factory) as optimizer:
        _run(optimizer, sphere, 2)
        points = optimizer.ask()
        part = points[: max(1, len(points) // 3)]
        optimizer.tell(part, sphere(part))
        _run(optimizer, sphere, 2)


def check_wrong_answers_are_refused(factory: OptimizerFactory) -> None:
    """Telling without asking, or with costs that do not fit, raises InputError."""
    with _made(factory) as optimizer:
        points = optimizer.ask()
        wrong: list[tuple[FloatArray, FloatArray]] = [
            (points, np.zeros(len(points) + 1)),
            (points, np.zeros((len(points), 1))),
            (points[:, :2], np.zeros(len(points))),
            (points + 1e-3, np.zeros(len(points))),
        ]
        for given, costs in wrong:
            _refused(optimizer, given, costs)
        optimizer.tell(points, sphere(points))
        _refused(optimizer, points, sphere(points))


def _refused(optimizer: Optimizer, points: FloatArray, costs: FloatArray) -> None:
    try:
        optimizer.tell(points, costs)
    except InputError:
        return
    raise AssertionError(f"points {points.shape} with costs {costs.shape} were accepted")


def check_the_budget_is_spent_exactly(factory: OptimizerFactory) -> None:
    spent = 0

    def counting(points: FloatArray) -> FloatArray:
        nonlocal spent
        spent += len(points)
        return sphere(points)

    budget = POPULATION * 7 + 3
    result = minimize(counting, _LOWER, _UPPER, factory, population=POPULATION, budget=budget)
    assert result.stopped == "budget", result.stopped
    assert spent == result.evaluations == budget


def check_it_beats_random_search(factory: OptimizerFactory) -> None:
    """On a sphere its median of five seeds is better than the median of random search.

    Random search itself is let off.
    """
    if factory is RandomSearch:
        return

    def median(of: OptimizerFactory) -> float:
        results = [
            minimize(sphere, _LOWER, _UPPER, of, population=POPULATION, iterations=50, seed=seed)
            for seed in range(5)
        ]
        return float(np.median([result.cost for result in results]))

    own, random = median(factory), median(RandomSearch)
    assert own < random, f"median cost {own:.3g}, random search {random:.3g}"


CHECKS: tuple[Callable[[OptimizerFactory], None], ...] = tuple(
    one for name, one in globals().items() if name.startswith("check_")
)


def check_optimizer(factory: OptimizerFactory) -> None:
    """Run all checks on an optimiser; the first that fails raises AssertionError."""
    for check in CHECKS:
        check(factory)
