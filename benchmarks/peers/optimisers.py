"""What population methods themselves cost: microseconds an evaluation beside a free objective.

Population 50, 200 generations, 8 variables, a sphere. The time within the objective is taken off.
Who offers ask and tell is driven by it, who does not runs its own loop. pygmo evaluates point by
point, so the call from C++ into Python counts; the same algorithm on an objective in C++ (pygmo's
own Rosenbrock function, its arithmetic included) shows how much of it that is.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmarks.peers.measure import Line, Part, missing, progress, versions

from ematwin.optimizers import Box
from ematwin.optimizers.registry import find

POPULATION, GENERATIONS, DIMENSION = 50, 200, 8
OPTIMUM = np.array([0.3, 0.62, 0.41, 0.77, 0.55, 0.23, 0.68, 0.36])


class Sphere:
    """A sphere that measures itself.

    Attributes
    ----------
    spent : float, s
    evaluations : int
    """

    def __init__(self) -> None:
        self.spent, self.evaluations = 0.0, 0

    def batch(self, points: np.ndarray) -> np.ndarray:
        """Costs (B,) of points (B, d)."""
        started = time.perf_counter()
        costs = ((points - OPTIMUM) ** 2).sum(axis=1)
        self.evaluations += len(points)
        self.spent += time.perf_counter() - started
        return np.asarray(costs)

    def single(self, point: np.ndarray) -> float:
        """Cost of a point (d,)."""
        started = time.perf_counter()
        cost = float(((point - OPTIMUM) ** 2).sum())
        self.evaluations += 1
        self.spent += time.perf_counter() - started
        return cost


Drive = Callable[[Sphere, int, int], None]  # objective, generations, seed


def ematwin(name: str) -> Drive:
    def drive(sphere: Sphere, generations: int, seed: int) -> None:
        box = Box(np.zeros(DIMENSION), np.ones(DIMENSION))
        make = find(name).factory()
        optimizer = make(box, population=POPULATION, iterations=generations, seed=seed)
        try:
            while sphere.evaluations < POPULATION * generations:
                points = optimizer.ask()
                optimizer.tell(points, sphere.batch(points))
        finally:
            optimizer.close()

    return drive


def scipy_de(sphere: Sphere, generations: int, seed: int) -> None:
    from scipy.optimize import differential_evolution

    rng = np.random.default_rng(seed)
    differential_evolution(
        lambda columns: sphere.batch(columns.T), [(0.0, 1.0)] * DIMENSION, tol=0.0, polish=False,
        init=rng.random((POPULATION, DIMENSION)), maxiter=generations - 1, vectorized=True,
        updating="deferred", rng=rng,
    )  # fmt: skip


def pymoo(name: str) -> Drive:
    def drive(sphere: Sphere, generations: int, seed: int) -> None:
        import importlib

        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        class Task(Problem):
            def _evaluate(self, x: np.ndarray, out: dict[str, Any], *_: Any, **__: Any) -> None:
                out["F"] = sphere.batch(x)[:, None]

        module = importlib.import_module(f"pymoo.algorithms.soo.nonconvex.{name.lower()}")
        algorithm = getattr(module, name)(pop_size=POPULATION)
        task = Task(n_var=DIMENSION, n_obj=1, xl=0.0, xu=1.0)
        algorithm.setup(task, termination=NoTermination(), seed=seed, verbose=False)
        while sphere.evaluations < POPULATION * generations:
            before = sphere.evaluations
            algorithm.next()
            if sphere.evaluations == before:  # nothing new left to ask
                break

    return drive


def pygmo(name: str, *, inside: bool = False, **options: Any) -> Drive:
    def drive(sphere: Sphere, generations: int, seed: int) -> None:
        import pygmo as library

        class Task:
            def __deepcopy__(self, memo: object) -> "Task":
                return self

            def fitness(self, x: np.ndarray) -> list[float]:
                return [sphere.single(x)]

            def get_bounds(self) -> tuple[list[float], list[float]]:
                return [0.0] * DIMENSION, [1.0] * DIMENSION

        task = library.problem(library.rosenbrock(DIMENSION) if inside else Task())
        population = library.population(task, POPULATION, seed=seed)
        make = getattr(library, name)
        algorithm = library.algorithm(make(gen=generations - 1, seed=seed, **options))
        population = algorithm.evolve(population)
        sphere.evaluations = population.problem.get_fevals()

    return drive


def cma_es(sphere: Sphere, generations: int, seed: int) -> None:
    import cma

    rng = np.random.default_rng(seed)
    options = {
        "bounds": [0.0, 1.0], "popsize": POPULATION, "verbose": -9,
        "tolfun": 0.0, "tolx": 0.0, "seed": seed,
    }  # fmt: skip
    while sphere.evaluations < POPULATION * generations:
        strategy = cma.CMAEvolutionStrategy(rng.random(DIMENSION), 0.3, options)
        while not strategy.stop() and sphere.evaluations < POPULATION * generations:
            points = strategy.ask()
            strategy.tell(points, sphere.batch(np.array(points)).tolist())


def nevergrad(name: str) -> Drive:
    def drive(sphere: Sphere, generations: int, seed: int) -> None:
        import nevergrad as library

        space = library.p.Array(shape=(DIMENSION,), lower=0.0, upper=1.0)
        space.random_state = np.random.RandomState(seed)
        optimizer = library.optimizers.registry[name](
            parametrization=space, budget=POPULATION * generations, num_workers=POPULATION
        )
        for _ in range(generations):
            asked = [optimizer.ask() for _ in range(POPULATION)]
            for candidate in asked:
                optimizer.tell(candidate, sphere.single(candidate.value))

    return drive


@dataclass(frozen=True)
class Competitor:
    """A method, which of ematwin's it is compared with, and what it needs."""

    name: str
    drive: Drive
    beside: str
    module: str = ""


COMPETITORS = (
    *(Competitor(f"ematwin {name}", ematwin(name), name)
      for name in ("ga", "pso", "de", "gwo", "da", "woa")),
    Competitor("scipy differential_evolution", scipy_de, "de"),
    Competitor("pymoo DE", pymoo("DE"), "de", "pymoo"),
    Competitor("pymoo GA", pymoo("GA"), "ga", "pymoo"),
    Competitor("pymoo PSO", pymoo("PSO"), "pso", "pymoo"),
    Competitor("pygmo de", pygmo("de", ftol=0.0, xtol=0.0), "de", "pygmo"),
    Competitor(
        "pygmo de, objective in C++", pygmo("de", inside=True, ftol=0.0, xtol=0.0), "de", "pygmo"
    ),
    Competitor("pygmo sga", pygmo("sga"), "ga", "pygmo"),
    Competitor("pygmo pso", pygmo("pso"), "pso", "pygmo"),
    Competitor("pygmo gwo", pygmo("gwo"), "gwo", "pygmo"),
    Competitor("cma", cma_es, "de", "cma"),
    Competitor("nevergrad TwoPointsDE", nevergrad("TwoPointsDE"), "de", "nevergrad"),
    Competitor("nevergrad PSO", nevergrad("PSO"), "pso", "nevergrad"),
)  # fmt: skip


def microseconds(drive: Drive, generations: int, seed: int) -> float:
    """Own time an evaluation."""
    sphere = Sphere()
    started = time.perf_counter()
    drive(sphere, generations, seed)
    total = time.perf_counter() - started
    return 1e6 * (total - sphere.spent) / sphere.evaluations


def run(*, quick: bool, repeats: int) -> Part:
    """Time all that are installed, each in turn with its counterpart."""
    generations = 20 if quick else GENERATIONS
    lines, remarks = [], []
    with warnings.catch_warnings(action="ignore"):
        for one in COMPETITORS:
            progress(f"optimisers: {one.name}")
            if one.module and (absent := missing(one.module, one.module, one.name)):
                remarks.append(absent)
                continue
            own = ematwin(one.beside)
            is_own = one.name.startswith("ematwin")
            microseconds(one.drive, 3, 1), microseconds(own, 3, 1)
            values, ratios = [], []
            for seed in range(1, repeats + 1):
                values.append(microseconds(one.drive, generations, seed))
                mine = values[-1] if is_own else microseconds(own, generations, seed)
                ratios.append(values[-1] / mine)
            lines.append(Line(one.name, tuple(values), tuple(ratios), (one.beside,), is_own))
    return Part(
        "Own time of population methods",
        f"Microseconds an evaluation that a method spends itself, without the objective: "
        f"population {POPULATION}, {generations} generations, {DIMENSION} variables. pygmo and "
        "nevergrad handle one point at a time, the others a generation.",
        "us an evaluation",
        "times ematwin's",
        ("compared with",),
        tuple(lines),
        tuple(remarks),
        versions("scipy", "pymoo", "pygmo", "cma", "nevergrad"),
    )
