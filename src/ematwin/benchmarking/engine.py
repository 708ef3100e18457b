"""The promise of an engine, and processes on this machine by loky (joblib).

loky gives up a whole pool when one of its processes dies. With a pool for each process a death is
blamed on the run that it did, and its neighbours go on. A busy machine kills processes that have
done nothing wrong, so what dies is tried again, with pauses.
"""

import math
import os
import signal
import threading
import time
from abc import ABC, abstractmethod
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ThreadPoolExecutor, wait
from typing import Any

from ematwin.benchmarking.execute import execute, hard_limit
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
_STARTING = threading.Lock()  # loky starts processes of one thread
_ENDING = threading.Lock()


class EngineError(EmatwinError):
    """An engine cannot be reached, or was lost in the middle of a study."""


class Engine(ABC):
    """Carries runs to processes that do them, each run on one thread, for ``time_limit`` s or None.

    A thread here waits for each process. An engine is given as many runs as it has `free` places,
    so that a run begins when it is submitted. A process that dies takes no run with it: the run is
    done again, unless it is the run that kills. Workers that are gone are waited for, ``patience``
    s. `EngineError` where they do not come back.
    """

    name: str

    def __init__(self, time_limit: float | None = None, patience: float = PATIENCE) -> None:
        self._limit = time_limit
        self._patience = patience
        self._slots = 0  # processes
        self._threads = ThreadPoolExecutor(10_000)  # made when they are needed
        self._flights: set[Future[Run]] = set()
        self._closed = threading.Event()

    @abstractmethod
    def start(self) -> None:
        """Make ready."""

    @property
    def free(self) -> int:
        """Runs that could begin now."""
        return max(0, self._slots - self.busy)

    @property
    def busy(self) -> int:
        """Runs that were submitted and have not come back."""
        return len(self._flights)

    def submit(self, spec: RunSpec) -> None:
        """Begin a run."""
        self._flights.add(self._threads.submit(self._carry, spec))

    def finished(self, timeout: float) -> list[Run]:
        """Give results that have come back; wait up to ``timeout`` s for the first."""
        if not self._flights:
            time.sleep(timeout)
        ended = wait(self._flights, timeout, FIRST_COMPLETED).done
        self._flights -= ended
        return [one.result() for one in ended]

    def close(self) -> None:
        """End all processes that the engine started, at once."""
        self._closed.set()
        for _ in range(2):  # one may have been started meanwhile
            self._end()
            self._threads.shutdown()

    @abstractmethod
    def _carry(self, spec: RunSpec) -> Run:
        """Do a run."""

    @abstractmethod
    def _end(self) -> None:
        """End all processes."""

    def _given_up(self, spec: RunSpec, overdue: bool) -> Run:
        """The result of a run whose process died each time, or was ended by the watchdog."""
        status, said = "failed", "its process died each time that it was tried"
        if overdue:
            status = "timeout"
            said = f"ran past its time limit of {self._limit:g} s and did not answer; process ended"
        return Run(spec, status, stopped=said, provenance={"engine": self.name})

    def _overdue(self, began: float) -> bool:
        """Whether the watchdog may have ended a run that began then, monotonic s."""
        return self._limit is not None and time.monotonic() - began >= hard_limit(self._limit)


class LocalEngine(Engine):
    """Worker processes on this machine."""

    name = "local"

    def __init__(
        self, workers: int, time_limit: float | None = None, patience: float = PATIENCE
    ) -> None:
        super().__init__(time_limit, patience)
        self._slots = workers
        self._processes = [_Process() for _ in range(workers)]
        self._idle = [*self._processes]

    def start(self) -> None:  # noqa: D102
        list(self._threads.map(self._try, self._processes))

    def _end(self) -> None:
        for process in self._processes:
            process.end()

    def _carry(self, spec: RunSpec) -> Run:
        process = self._idle.pop()
        try:
            return self._try(process, spec)
        finally:
            self._idle.append(process)

    def _try(self, process: "_Process", spec: RunSpec | None = None) -> Any:
        """Start a process if need be and do a run in it; again, after a pause, where it dies."""
        deaths, first = 0, 0.0
        while not self._closed.is_set():
            began = math.inf  # of the run
            try:
                process.start()
                if spec is None:
                    return None
                began = time.monotonic()
                return process.submitted(execute, spec, self._limit, self.name).result()
            except BrokenExecutor as error:
                now = time.monotonic()
                # loky names the signal that ended a process; the watchdog exits without one
                overdue = self._overdue(began) and "SIG" not in str(error)
                process.end()
                first = first if deaths else now
                deaths += 1
                in_vain = deaths >= 3 and now - first >= self._patience
                if spec is not None and (overdue or (in_vain and began < now)):
                    return self._given_up(spec, overdue)
                if in_vain:
                    raise EngineError(
                        f"The worker processes die as soon as they start ({type(error).__name__}), "
                        f"{deaths} times in {self._patience:g} s. Finished runs are kept; see "
                        "whether there is enough memory, and give the same command again."
                    ) from None
                self._closed.wait(min(0.25 * 2.0**deaths, 10.0))  # s
            except Exception as error:  # the result could not be carried back
                if spec is None:
                    raise
                return Run(spec, "failed", stopped=f"{type(error).__name__}: {error}")
        raise EngineError("The engine was closed.")


class _Process:
    """A process that does one thing at a time."""

    def __init__(self) -> None:
        self._pool: Any = None

    def start(self) -> None:
        """Start the process if there is none; what dies raises `BrokenExecutor`."""
        if self._pool is None:
            with _STARTING:
                from joblib.externals.loky import ProcessPoolExecutor

                self._pool = ProcessPoolExecutor(
                    max_workers=1, timeout=None, env=_ENVIRONMENT, initializer=_prepare_worker,
                    initargs=(os.getpid(), registered(), registered_models()),
                )  # fmt: skip
                # a run's clock starts when it is asked for: somebody must be there
                ready = self.submitted(os.getpid)
            ready.result()

    def submitted(self, function: Any, *arguments: Any) -> Any:
        """Let the process do something; gives the future of its answer."""
        try:
            return self._pool.submit(function, *arguments)
        except (RuntimeError, OSError) as error:  # it died while it was idle
            raise BrokenExecutor(str(error)) from None

    def end(self) -> None:
        """End the process."""
        pool, self._pool = self._pool, None
        if pool is not None:
            with _ENDING:
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
