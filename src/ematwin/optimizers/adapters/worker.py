"""Ask/tell for libraries that only know how to call an objective.

The library runs in a separate thread and calls ``evaluate``; that call hands its points to
``ask`` and sleeps until ``tell`` has brought their costs. Only one of the two threads ever runs.
"""

import threading
from abc import abstractmethod
from collections.abc import Callable
from queue import SimpleQueue

import numpy as np

from ematwin.errors import EmatwinError, InputError
from ematwin.optimizers.base import Box, FloatArray, PopulationOptimizer

Evaluate = Callable[[FloatArray], FloatArray]


class _ClosedError(BaseException):
    """Raised inside the library's thread to end it; no library catches it by accident."""


class ThreadedOptimizer(PopulationOptimizer):
    """An optimiser whose library is driven from a thread.

    A subclass gives ``_search(evaluate)``, which calls ``evaluate`` with (m, d) points inside the
    box, for ever. The thread starts with the first ``ask``.
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

        def columns(points: FloatArray) -> FloatArray:
            return evaluate(points.T)

        while True:
            differential_evolution(
                columns,
                np.column_stack([self.box.lower, self.box.upper]),
                init=self.box.sample(rng, self.population),
                maxiter=10**9,
                tol=0.0,
                polish=False,
                vectorized=True,
                updating="deferred",
                rng=rng,
            )
