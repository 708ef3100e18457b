"""The promise of an engine, and processes on this machine by loky (joblib).

loky gives up a whole pool when one of its processes dies. With a pool for each process a death is
blamed on the run that it did, and its neighbours go on. A busy machine kills processes that have
done nothing wrong, so what dies is tried again, with pauses.
"""

import os
import signal
import threading
import time
from abc import ABC, abstractmethod
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from typing import Any

from ematwin.benchmarking.execute import execute, hard_limit, warm_up
from ematwin.benchmarking.plan import Run, RunSpec
from ematwin.errors import EmatwinError
from ematwin.models.base import Model
from ematwin.models.registry import register_model, registered_models
from ematwin.optimizers.base import Algorithm
from ematwin.optimizers.registry import register, registered

PATIENCE = 60.0  # s for which workers that are gone are waited for: a busy machine needs as long
# one run, one core: no library may share it out again
_ENVIRONMENT = {
    f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA", "BLIS")
} | {"VECLIB_MAXIMUM_THREADS": "1"}


class EngineError(EmatwinError):
    """An engine cannot be reached, or was lost in the middle of a study."""


class Engine(ABC):
    """Carries runs to processes that do them, each run on one thread, for ``time_limit`` s or None.

    An engine is given as many runs as it has `free` places, so that a run begins when it is
    submitted. A process that dies takes no run with it: the run is done again, unless it is the
    run that kills. Workers that are gone are waited for, ``patience`` s.
    """

    name: str

    def __init__(self, time_limit: float | None = None, patience: float = PATIENCE) -> None:
        self._limit = time_limit
        self._patience = patience

    @abstractmethod
    def start(self) -> None:
        """Make ready, or raise `EngineError`."""

    @property
    @abstractmethod
    def free(self) -> int:
        """Runs that could begin now."""

    @property
    @abstractmethod
    def busy(self) -> int:
        """Runs that were submitted and have not come back."""

    @abstractmethod
    def submit(self, spec: RunSpec) -> None:
        """Begin a run."""

    @abstractmethod
    def finished(self, timeout: float) -> list[Run]:
        """Give results that have come back; wait up to ``timeout`` s for the first."""

    @abstractmethod
    def close(self) -> None:
        """End all processes that the engine started, at once."""

    def _given_up(self, spec: RunSpec, overdue: bool) -> Run:
        """The result of a run whose process died each time, or was ended by the watchdog."""
        status, said = "failed", "its process died each time that it was tried"
        if overdue:
            status = "timeout"
            said = f"ran past its time limit of {self._limit:g} s and did not answer; process ended"
        return Run(spec, status, stopped=said, provenance={"engine": self.name})


class LocalEngine(Engine):
    """Worker processes on this machine."""

    name = "local"

    def __init__(
        self, workers: int, time_limit: float | None = None, patience: float = PATIENCE
    ) -> None:
        super().__init__(time_limit, patience)
        self._workers = [_Worker() for _ in range(workers)]

    def start(self) -> None:  # noqa: D102
        while not all(worker.ready for worker in self._workers):
            self.finished(0.1)

    @property
    def free(self) -> int:  # noqa: D102
        return sum(worker.ready and worker.spec is None for worker in self._workers)

    @property
    def busy(self) -> int:  # noqa: D102
        return sum(worker.spec is not None for worker in self._workers)

    def submit(self, spec: RunSpec) -> None:  # noqa: D102
        worker = next(one for one in self._workers if one.ready and one.spec is None)
        worker.spec = spec
        worker.submit(execute, worker.spec, self._limit, self.name)

    def close(self) -> None:  # noqa: D102
        for worker in self._workers:
            worker.end()

    def finished(self, timeout: float) -> list[Run]:  # noqa: D102
        for worker in self._workers:
            worker.start_if_due()
        tasks = {one.future: one for one in self._workers if one.future is not None}
        if not tasks:
            time.sleep(timeout)
        ended = wait(tasks, timeout, FIRST_COMPLETED).done
        return [result for task in ended for result in self._land(tasks[task], task)]

    def _land(self, worker: "_Worker", future: "Future[Any]") -> list[Run]:
        """Take in that a process has started, has done a run, or has died."""
        worker.future = None
        error = future.exception()
        if isinstance(error, BrokenExecutor):
            return self._recover(worker, error)
        if not worker.ready:
            worker.ready = True
            if worker.spec is not None:  # its process had died
                worker.submit(execute, worker.spec, self._limit, self.name)
            return []
        spec = worker.spec
        assert spec is not None
        worker.spec, worker.deaths = None, 0
        if error is not None:  # the result could not be carried back
            return [Run(spec, "failed", stopped=f"{type(error).__name__}: {error}")]
        return [future.result()]

    def _recover(self, worker: "_Worker", error: BaseException) -> list[Run]:
        """Try again with a new process, or give up the run, or the engine."""
        spec, seconds, started = worker.spec, time.monotonic() - worker.submitted, worker.ready
        # loky names the signal that ended a process; the watchdog exits without one
        by_watchdog = started and self._limit is not None and "SIG" not in str(error)
        overdue = by_watchdog and seconds >= hard_limit(self._limit or 0.0)
        worker.died()
        # three deaths in a row
        in_vain = worker.deaths >= 3 and time.monotonic() - worker.since >= self._patience
        if spec is not None and (overdue or (started and in_vain)):
            worker.spec, worker.deaths, worker.due = None, 0, 0.0
            return [self._given_up(spec, overdue)]
        if in_vain:
            raise EngineError(
                f"The worker processes die as soon as they start ({type(error).__name__}), "
                f"{worker.deaths} times in {self._patience:g} s. Finished runs are kept; see "
                "whether there is enough memory, and give the same command again."
            )
        return []


class _Worker:
    """A process that is started again when it dies; times are of the monotonic clock, s."""

    def __init__(self) -> None:
        self._pool: Any = None
        self.spec: RunSpec | None = None  # the run that it does
        self.ready = False  # its process has started
        self.future: Future[Any] | None = None  # of its current task
        self.submitted = 0.0  # when that began
        self.deaths = 0  # in a row
        self.since = self.due = 0.0  # when it died first, and when it may be started again

    def start_if_due(self) -> None:
        """Start the process if there is none and the pause is over."""
        if self._pool is not None or time.monotonic() < self.due:
            return
        from joblib.externals.loky import ProcessPoolExecutor

        self._pool = ProcessPoolExecutor(
            max_workers=1,
            timeout=None,
            initializer=_prepare_worker,
            initargs=(os.getpid(), registered(), registered_models()),
            env=_ENVIRONMENT,
        )
        self.submit(warm_up)  # a run's clock starts when it is submitted: somebody must be there

    def submit(self, function: Any, *arguments: Any) -> None:
        """Let the process do something."""
        self.submitted = time.monotonic()
        try:
            self.future = self._pool.submit(function, *arguments)
        except (RuntimeError, OSError) as error:  # it died while it was idle
            self.future = Future()
            self.future.set_exception(BrokenExecutor(str(error)))

    def died(self) -> None:
        """Note a death, and when the next process may start: each pause is twice the last."""
        now = time.monotonic()
        self.since = self.since if self.deaths else now
        self.due = now + min(0.5 * 2.0**self.deaths, 10.0)  # s
        self.deaths += 1
        self.end()

    def end(self) -> None:
        """End the process."""
        pool, self._pool, self.future, self.ready = self._pool, None, None, False
        if pool is not None:
            # loky's own thread may stumble over the processes that are killed under it
            hook, threading.excepthook = threading.excepthook, lambda _: None
            try:
                pool.shutdown(wait=True, kill_workers=True)
            finally:
                threading.excepthook = hook


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
    # loky replaces a process that grew by 300 MB since its first call, for a memory leak. The
    # compiler takes more than that, once: the process would lose its records and kernels
    process_executor._MAX_MEMORY_LEAK_SIZE = 2_000_000_000

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    if os.name == "posix":
        threading.Thread(target=watch, name="ematwin-parent", daemon=True).start()
