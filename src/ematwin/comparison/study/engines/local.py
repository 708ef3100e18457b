"""Processes on this machine, by loky (joblib).

When one process dies, loky gives up all of its pool. The runs that were in flight are then done
again, one at a time: so a run that kills its process is found out without blaming its neighbours.
A busy machine kills processes that have done nothing, so what dies is tried again for a minute,
with pauses in which other runs go on.
"""

import os
import queue
import signal
import threading
import time
from collections import deque
from concurrent.futures import BrokenExecutor, Future
from dataclasses import dataclass, field
from typing import Any

from ematwin.comparison.study.engines.base import PATIENCE, Engine, EngineError, Trials, gave_up
from ematwin.comparison.study.execute import execute, hard_limit, warm_up
from ematwin.comparison.study.run import RunResult, RunSpec
from ematwin.models.base import Model
from ematwin.models.registry import register_model, registered_models
from ematwin.optimizers.catalogue import Algorithm
from ematwin.optimizers.registry import register, registered

# one run, one core: no library may share it out again
_ENVIRONMENT = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS", "BLIS_NUM_THREADS",
    )
}  # fmt: skip

# loky replaces a process that grew by 300 MB since its first call, and warns of a memory leak. The
# compiler takes more than that, once: the process would lose its records and kernels for nothing.
_LEAK = 2_000_000_000


@dataclass
class _Flight:
    spec: RunSpec
    since: float = 0.0
    trials: Trials = field(default_factory=Trials)  # that ended in a death, it flying alone


class LocalEngine(Engine):
    """Worker processes on this machine.

    Parameters
    ----------
    workers : int
    time_limit : float, s, of a run, or None
    patience : float, s, for which processes that die are started again
    backend : what simulates the candidates (`execute`)
    """

    name = "local"

    def __init__(
        self,
        workers: int,
        time_limit: float | None = None,
        patience: float = PATIENCE,
        backend: str = "cpu",
    ) -> None:
        self._workers = workers
        self._limit = time_limit
        self._patience = patience
        self._backend = backend
        self._starts = Trials()
        self._pool: Any = None
        self._generation = 0
        self._events: queue.SimpleQueue[tuple[int, str, Future[RunResult]]] = queue.SimpleQueue()
        self._flights: dict[str, _Flight] = {}
        self._suspects: deque[_Flight] = deque()

    def start(self) -> None:  # noqa: D102
        while not self._started():
            time.sleep(0.1)

    def _started(self) -> bool:
        """Whether there are processes; starts them if it is time to try."""
        if self._pool is not None:
            return True
        if not self._starts.is_due:
            return False
        from joblib.externals.loky import ProcessPoolExecutor

        self._pool = ProcessPoolExecutor(
            max_workers=self._workers,
            timeout=None,
            initializer=_prepare_worker,
            initargs=(os.getpid(), registered(), registered_models()),
            env=_ENVIRONMENT,
        )
        try:
            # a run's clock starts when it is submitted: somebody must be there to take it
            self._pool.submit(warm_up).result()
        except (BrokenExecutor, RuntimeError, OSError) as error:
            self._end_pool()
            self._starts.failed()
            if not self._starts.over(self._patience):
                return False
            raise EngineError(
                f"The worker processes die as soon as they start ({type(error).__name__}), "
                f"{self._starts.failures} times in {self._patience:g} s. Finished runs are kept; "
                "see whether there is enough memory, and give the same command again."
            ) from None
        self._starts = Trials()
        return True

    @property
    def busy(self) -> int:  # noqa: D102
        return len(self._flights) + len(self._suspects)

    @property
    def free(self) -> int:  # noqa: D102
        alone = any(flight.trials.failures for flight in self._flights.values())
        waited_for = any(flight.trials.is_due for flight in self._suspects)
        if self._pool is None or alone or waited_for:
            return 0
        return self._workers - len(self._flights)

    def submit(self, spec: RunSpec) -> None:  # noqa: D102
        self._launch(_Flight(spec))

    def finished(self, timeout: float) -> list[RunResult]:  # noqa: D102
        results: list[RunResult] = []
        if self._started():
            self._next_suspect()
        try:
            while True:
                event = self._events.get(timeout=0.0 if results else timeout)
                results += self._land(*event)
        except queue.Empty:
            return results

    def close(self) -> None:  # noqa: D102
        self._flights.clear()
        self._suspects.clear()
        self._end_pool()

    def _launch(self, flight: _Flight) -> None:
        flight.since = time.monotonic()
        id, generation = flight.spec.id, self._generation
        self._flights[id] = flight
        try:
            future = self._pool.submit(execute, flight.spec, self._limit, self.name, self._backend)
        except (BrokenExecutor, RuntimeError) as error:  # an idle process had died
            future = Future()
            future.set_exception(
                error if isinstance(error, BrokenExecutor) else BrokenExecutor(str(error))
            )
        future.add_done_callback(lambda done: self._events.put((generation, id, done)))

    def _land(self, generation: int, id: str, future: "Future[RunResult]") -> list[RunResult]:
        if generation != self._generation or id not in self._flights:
            return []
        if future.cancelled() or isinstance(future.exception(), BrokenExecutor):
            cause = "" if future.cancelled() else str(future.exception())
            # loky names the signals that ended processes; the watchdog exits without one
            return self._recover(by_signal="SIG" in cause)
        self._flights.pop(id)
        error = future.exception()
        if error is not None:  # the result could not be carried back
            result = RunResult(id, "failed", stopped=f"{type(error).__name__}: {error}")
        else:
            result = future.result()
        self._next_suspect()
        return [result]

    def _recover(self, by_signal: bool) -> list[RunResult]:
        """A process died: find out which run was to blame, if any."""
        flights = list(self._flights.values())
        self._flights.clear()
        self._generation += 1
        self._end_pool()
        if len(flights) > 1:
            self._suspects.extend(flights)
            return []
        flight = flights[0]
        flight.trials.failed()
        overdue = (
            self._limit is not None
            and not by_signal
            and time.monotonic() - flight.since >= hard_limit(self._limit)
        )
        if overdue or flight.trials.over(self._patience):
            deaths = flight.trials.failures
            return [gave_up(flight.spec, self.name, self._limit, overdue, deaths)]
        self._suspects.append(flight)
        return []

    def _next_suspect(self) -> None:
        if self._flights:
            return
        due = next((flight for flight in self._suspects if flight.trials.is_due), None)
        if due is not None:
            self._suspects.remove(due)
            self._launch(due)

    def _end_pool(self) -> None:
        if self._pool is not None:
            # loky's own thread may stumble over the processes that are killed under it
            hook, threading.excepthook = threading.excepthook, lambda _: None
            try:
                self._pool.shutdown(wait=True, kill_workers=True)
            finally:
                threading.excepthook = hook
                self._pool = None


def _prepare_worker(
    parent: int, algorithms: tuple[Algorithm, ...], models: tuple[Model, ...]
) -> None:
    """Leave Ctrl-C to the main process, end with it even if it is killed, and compile in peace.

    ``algorithms`` and ``models`` are those that the main process has registered.
    """
    from joblib.externals.loky import process_executor

    for one in algorithms:
        register(one.name, one.load(), title=one.title, source=one.source)
    for model in models:
        register_model(model)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    process_executor._MAX_MEMORY_LEAK_SIZE = _LEAK

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    if os.name == "posix":
        threading.Thread(target=watch, name="ematwin-parent", daemon=True).start()
