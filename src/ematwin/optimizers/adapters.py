"""Optimisers of other libraries behind the same ask and tell, and their names.

Each has its library's own settings. Nothing here imports such a library before one of its
algorithms is made. A library that only knows how to call an objective runs in a separate thread
(`ThreadedOptimizer`); the others are asked and told.
"""

import importlib
import threading
import warnings
from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Any, Self

import numpy as np

from ematwin.errors import EmatwinError, InputError
from ematwin.optimizers.base import (
    Algorithm,
    Box,
    FloatArray,
    OptimizerFactory,
    PopulationOptimizer,
)

Evaluate = Callable[[FloatArray], FloatArray]

_WORST = 1e300  # these libraries take differences of costs, which must stay finite
_PYMOO = "pymoo.algorithms.soo.nonconvex"


class CmaEs(PopulationOptimizer):
    """CMA-ES of the package ``cma``; the population is its popsize.

    The first mean is drawn uniformly in the box and the first step is 0.3 of the box in every
    variable. Where the package declares itself converged it starts afresh from another mean, so
    that the budget is spent.
    """

    minimum_population = 4

    def _start(self) -> FloatArray:
        import cma

        options = {
            "bounds": [self.box.lower.tolist(), self.box.upper.tolist()],
            "CMA_stds": self.box.span.tolist(),
            "popsize": self.population,
            "seed": np.nan,
            "randn": self._normal,
            "verbose": -9,
        }
        first = self.box.sample(self.rng, 1)[0]
        self._strategy = cma.CMAEvolutionStrategy(first, 0.3, options)
        return self._sampled()

    def _move(self) -> FloatArray:
        return self._start() if self._strategy.stop() else self._sampled()

    def _normal(self, *shape: int) -> FloatArray:
        """Standard normal numbers; the package would draw them from numpy's global generator."""
        return self.rng.standard_normal(shape)

    def _sampled(self) -> FloatArray:
        # the package warns shortly before it converges
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            self._solutions = self._strategy.ask()
        return self.box.clip(np.array(self._solutions, dtype=np.float64))

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            self._strategy.tell(self._solutions, np.minimum(costs, _WORST).tolist())


class Pymoo(PopulationOptimizer):
    """An algorithm of pymoo, by the ``name`` of its class; its module has that in lower case.

    pymoo drops duplicates, so that a batch can be smaller than the population. Its genetic
    algorithm holds local functions that cannot be pickled, so none of them is said to be.
    """

    picklable = False
    constant_batch = False
    minimum_population = 5

    def __init__(self, box: Box, *, name: str, **settings: int) -> None:
        super().__init__(box, **settings)
        self.name = name
        self._starts = 0
        self._infills: Any = None

    def _start(self) -> FloatArray:
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        make = getattr(importlib.import_module(f"{_PYMOO}.{self.name.lower()}"), self.name)
        problem = Problem(
            n_var=self.box.dimension, n_obj=1, xl=self.box.lower.copy(), xu=self.box.upper.copy()
        )
        self._algorithm = make(pop_size=self.population)
        seed = int(np.random.SeedSequence([self.seed, self._starts]).generate_state(1)[0] >> 1)
        self._algorithm.setup(problem, termination=NoTermination(), seed=seed, verbose=False)
        self._starts += 1
        return self._move()

    def _move(self) -> FloatArray:
        self._infills = self._algorithm.ask()
        if self._infills is None or len(self._infills) == 0:  # it has no new point left
            return self._start()
        points = np.asarray(self._infills.get("X"), dtype=np.float64)
        return self.box.clip(points.reshape(len(self._infills), -1))

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        finite = np.minimum(costs, _WORST)[:, None]
        Evaluator().eval(StaticProblem(self._algorithm.problem, F=finite), self._infills)
        self._algorithm.tell(infills=self._infills)


class Nevergrad(PopulationOptimizer):
    """An optimiser of nevergrad, by its ``name`` in nevergrad's registry.

    nevergrad asks for one point at a time; a batch is as many as the population, which is also
    nevergrad's number of workers. Its "NGOpt" is left out: release 1.0.12 fails with numpy 2.4
    inside its surrogate model.
    """

    def __init__(self, box: Box, *, name: str, **settings: int) -> None:
        import nevergrad

        super().__init__(box, **settings)
        # The unit cube: nevergrad then draws first points over all of it, whatever the box.
        space = nevergrad.p.Array(shape=(box.dimension,), lower=0.0, upper=1.0)
        space.random_state = np.random.RandomState(self.seed % 2**32)
        self._optimizer = nevergrad.optimizers.registry[name](
            parametrization=space,
            budget=self.population * self.iterations,
            num_workers=self.population,
        )
        self._candidates: list[Any] = []

    def _start(self) -> FloatArray:
        self._candidates = [self._optimizer.ask() for _ in range(self.population)]
        unit = np.array([candidate.value for candidate in self._candidates], dtype=np.float64)
        return self.box.clip(self.box.lower + unit * self.box.span)

    _move = _start

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        for candidate, cost in zip(self._candidates, costs.tolist(), strict=True):
            # nevergrad replaces costs above 5e20, with a warning for each
            self._optimizer.tell(candidate, min(cost, 1e20))
        self._candidates = []


class _ClosedError(BaseException):
    """Raised inside the library's thread to end it; no library catches it by accident."""


class ThreadedOptimizer(PopulationOptimizer):
    """An optimiser whose library is driven from a thread, which starts with the first ``ask``.

    A subclass gives ``_search(evaluate)``, which calls ``evaluate`` with (m, d) points inside the
    box, for ever. That call hands its points to ``ask`` and sleeps until ``tell`` has brought their
    costs: only one of the two threads ever runs.
    """

    picklable = False

    def __init__(self, box: Box, **settings: int) -> None:
        super().__init__(box, **settings)
        self._asked: SimpleQueue[FloatArray | BaseException] = SimpleQueue()
        self._told: SimpleQueue[FloatArray | None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._closed = False

    def ask(self) -> FloatArray:
        """Give the points that the library waits for."""
        if self._closed:
            raise InputError("The optimiser is closed. Make a new one.")
        return super().ask()

    def close(self) -> None:
        """End the thread."""
        if self._thread is not None and not self._closed:
            self._told.put(None)
            self._thread.join(timeout=5.0)
        self._closed = True

    def __getstate__(self) -> object:
        raise InputError(
            f"{type(self).__name__} keeps its state in a running thread and cannot be pickled."
        )

    def _start(self) -> FloatArray:
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self._move()

    def _move(self) -> FloatArray:
        answer = self._asked.get()
        if isinstance(answer, BaseException):
            self._closed = True
            raise EmatwinError(
                f"{type(self).__name__} failed inside its library: {answer!r}."
            ) from answer
        return answer

    def _learn(self, points: FloatArray, costs: FloatArray) -> None:
        self._told.put(costs)

    @abstractmethod
    def _search(self, evaluate: Evaluate) -> None: ...

    def _run(self) -> None:
        try:
            self._search(self._evaluate)
            raise RuntimeError("the library ended its search")
        except _ClosedError:
            return
        except BaseException as error:
            self._asked.put(error)

    def _evaluate(self, points: FloatArray) -> FloatArray:
        self._asked.put(self.box.clip(np.array(points, dtype=np.float64)))
        costs = self._told.get()
        if costs is None:
            raise _ClosedError
        return costs


class ScipyDifferentialEvolution(ThreadedOptimizer):
    """``scipy.optimize.differential_evolution``, whole generations at a time.

    SciPy's own defaults (best/1/bin, F drawn from 0.5 to 1, CR 0.7) except: the population is the
    one asked for, drawn uniformly; its test of convergence and its final polishing are off, so that
    the budget is spent; a population that has shrunk to one cost starts afresh. SciPy draws the
    bounds' offenders anew.
    """

    minimum_population = 5

    def _search(self, evaluate: Evaluate) -> None:
        from scipy.optimize import differential_evolution

        rng = np.random.default_rng(self.seed)
        bounds = np.column_stack([self.box.lower, self.box.upper])
        while True:
            differential_evolution(
                lambda columns: evaluate(columns.T), bounds,
                init=self.box.sample(rng, self.population), maxiter=10**9, tol=0.0, polish=False,
                vectorized=True, updating="deferred", rng=rng,
            )  # fmt: skip


class _PygmoProblem:
    """A user-defined problem of pygmo; pygmo copies it, the copies share the channel."""

    def __init__(self, box: Box, evaluate: Evaluate) -> None:
        self._box = box
        self._evaluate = evaluate

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def fitness(self, x: FloatArray) -> list[float]:
        return self.batch_fitness(x).tolist()

    def batch_fitness(self, points: FloatArray) -> FloatArray:
        rows = np.asarray(points).reshape(-1, self._box.dimension)
        return np.minimum(self._evaluate(rows), _WORST)

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return self._box.lower.tolist(), self._box.upper.tolist()


class Pygmo(ThreadedOptimizer):
    """An algorithm of pygmo, named as in pygmo; ``batched`` if it takes whole generations.

    Most evaluate one point at a time, so a batch is one point, whose simulation takes 13 times as
    long as in a batch of fifty; the generational swarm takes whole generations (`pygmo.bfe`). Where
    an algorithm ends of itself (its tolerances are set to zero where it has any) it goes on from
    its population, and from a new one when it finds nothing left to do.
    """

    minimum_population = 7

    def __init__(
        self, box: Box, *, name: str, batched: bool, options: dict[str, Any], **settings: int
    ) -> None:
        super().__init__(box, **settings)
        self.name, self.batched, self.options = name, batched, options

    def _search(self, evaluate: Evaluate) -> None:
        import pygmo

        problem = pygmo.problem(_PygmoProblem(self.box, evaluate))
        make = getattr(pygmo, self.name)
        seed = self.seed % 2**31
        while True:
            together = pygmo.bfe(pygmo.member_bfe()) if self.batched else None
            population = pygmo.population(problem, self.population, b=together, seed=seed)
            generations = max(3, self.iterations - 1)
            chosen = make(gen=generations, seed=seed, **self.options)
            if together is not None:
                chosen.set_bfe(together)
            algorithm = pygmo.algorithm(chosen)
            spent = -1
            while population.problem.get_fevals() != spent:
                spent = population.problem.get_fevals()
                population = algorithm.evolve(population)
            seed = (seed + 1) % 2**31


def _of(
    factory: OptimizerFactory, name: str, title: str, source: str, departures: str, *aliases: str
) -> Algorithm:
    """An algorithm of the library that its name begins with, with the library's settings."""
    library = name.partition("-")[0]
    return Algorithm(
        name, title, source, library, lambda: factory, library, aliases, departures,
        "nothing here: the library's own settings",
    )  # fmt: skip


def _pygmo(name: str, title: str, **options: float) -> Algorithm:
    batched = name == "pso_gen"
    alone = "" if batched else (
        "; asks for one point at a time, so that its seconds say little of the method"
    )  # fmt: skip
    return _of(
        partial(Pygmo, name=name, batched=batched, options=options),
        f"pygmo-{name.replace('_', '-')}", f"{title} of pygmo", f"pygmo.{name}",
        f"goes on, or restarts, where it ends{alone}",
    )  # fmt: skip


_ENDLESS: Any = {"ftol": 0.0, "xtol": 0.0}

ALGORITHMS = (
    _of(
        CmaEs, "cma", "CMA-ES of the package cma",
        "Hansen and Ostermeier (2001), Evol. Comput. 9(2), 159-195; pycma",
        "first mean and step as this package draws them; restarts", "cma-es", "cmaes",
    ),
    _of(
        ScipyDifferentialEvolution, "scipy-de", "Differential evolution of SciPy",
        "scipy.optimize.differential_evolution", "no convergence test, no polishing; restarts",
    ),
    *(
        _of(
            partial(Pymoo, name=name), f"pymoo-{name.lower()}", f"{title} of pymoo",
            f"{_PYMOO}.{name.lower()}.{name}", "restarts where it has no new point left",
        )
        for name, title in (
            ("GA", "Genetic algorithm"), ("DE", "Differential evolution"), ("PSO", "Particle swarm")
        )
    ),
    _pygmo("sga", "Genetic algorithm"),
    _pygmo("de", "Differential evolution", **_ENDLESS),
    _pygmo("sade", "Self-adaptive differential evolution", **_ENDLESS),
    _pygmo("de1220", "Differential evolution, adaptive variant", **_ENDLESS),
    _pygmo("pso", "Particle swarm"),
    _pygmo("pso_gen", "Generational particle swarm"),
    _pygmo("gwo", "Grey wolf"),
    *(
        _of(
            partial(Nevergrad, name=name), f"nevergrad-{key}", f"{title} of nevergrad",
            f"nevergrad.optimizers.registry[{name!r}]", "none",
        )
        for key, name, title in (
            ("de", "TwoPointsDE", "Differential evolution"), ("pso", "PSO", "Particle swarm"),
            ("oneplusone", "OnePlusOne", "(1+1) evolution strategy"),
        )
    ),
)  # fmt: skip
