"""A Dask cluster: a scheduler given by its address, or one that is started on this machine.

A scheduler starts a run again elsewhere when its worker dies. The workers must have one thread
each, because a run is one thread and the watchdog ends the whole process. A scheduler that is gone,
or all of whose workers are, is waited for a while, and then gets what was in flight again.
"""

import logging
import queue
import time
from contextlib import suppress
from typing import Any

from ematwin.comparison.study.engines.base import PATIENCE, Engine, EngineError, Trials, gave_up
from ematwin.comparison.study.execute import execute, hard_limit
from ematwin.comparison.study.run import RunResult, RunSpec
from ematwin.errors import MissingExtraError

_CONNECT = 10.0  # s
_LOOK = 2.0  # s between two looks at the workers


class DaskEngine(Engine):
    """Workers of a Dask scheduler.

    Parameters
    ----------
    scheduler : address such as tcp://host:8786, or None to start one with ``workers`` here
    workers : int
    time_limit : float, s, of a run, or None
    patience : float, s, for which a scheduler or workers that are gone are waited for
    backend : what simulates the candidates (`execute`)

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    """

    name = "dask"

    def __init__(
        self,
        scheduler: str | None,
        workers: int,
        time_limit: float | None = None,
        patience: float = PATIENCE,
        backend: str = "cpu",
    ) -> None:
        try:
            import distributed
        except ImportError:
            raise MissingExtraError("distributed", "dask", "The engine dask") from None
        self._distributed = distributed
        self._address = scheduler
        self._workers = workers
        self._limit = time_limit
        self._patience = patience
        self._backend = backend
        self._cluster: Any = None
        self._client: Any = None
        self._slots = 0
        self._looked = 0.0
        self._alone_since: float | None = None
        self._reconnections = Trials()
        self._flights: dict[str, tuple[RunSpec, Any, float]] = {}
        self._again: dict[str, RunSpec] = {}  # were in flight when the scheduler was lost
        self._deaths: dict[str, Trials] = {}
        self._events: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()

    def start(self) -> None:  # noqa: D102
        # what they would log about lost connections is said once, as a sentence
        for name in list(logging.root.manager.loggerDict):
            if name.split(".")[0] in {"distributed", "tornado", "asyncio"}:
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        if self._address is None:
            self._cluster = self._distributed.LocalCluster(
                n_workers=self._workers,
                threads_per_worker=1,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
        try:
            self._connect()
        except (OSError, ValueError, TypeError) as error:
            self.close()
            raise EngineError(
                f"The scheduler at {self._address} does not answer ({_short(error)}). Start it "
                "with: dask scheduler, and check the address."
            ) from None
        end = time.monotonic() + self._patience
        while not self._look():
            if time.monotonic() > end:
                self.close()
                raise EngineError(
                    f"The scheduler at {self._address} has no workers. Start some with: "
                    f"dask worker {self._address} --nthreads 1"
                )
            time.sleep(0.2)

    def _connect(self) -> None:
        self._client = self._distributed.Client(
            self._cluster or self._address, timeout=_CONNECT, set_as_default=False
        )

    @property
    def busy(self) -> int:  # noqa: D102
        return len(self._flights) + len(self._again)

    @property
    def free(self) -> int:  # noqa: D102
        return max(0, self._slots - self.busy)

    def submit(self, spec: RunSpec) -> None:  # noqa: D102
        id = spec.id
        try:
            # impure: another client of this scheduler may have asked for the same run
            run = execute, spec, self._limit, self.name, self._backend
            future = self._client.submit(*run, pure=False, key=None, retries=0)
        except Exception as error:
            self._again[id] = spec
            self._lose(error)
            return
        self._flights[id] = (spec, future, time.monotonic())
        future.add_done_callback(lambda done: self._events.put((id, done)))

    def finished(self, timeout: float) -> list[RunResult]:  # noqa: D102
        results: list[RunResult] = []
        self._resume()
        try:
            while True:
                id, future = self._events.get(timeout=0.0 if results else timeout)
                if id in self._flights and self._flights[id][1] is future:
                    results += self._land(id)
        except queue.Empty:
            pass
        if not results:
            self._watch_cluster()
        return results

    def close(self) -> None:  # noqa: D102
        self._disconnect(cancel=True)
        if self._cluster is not None:
            self._closed(self._cluster)
        self._cluster = None
        self._flights.clear()
        self._again.clear()

    def _disconnect(self, cancel: bool = False) -> None:
        client, self._client = self._client, None
        if client is not None:
            if cancel and self._flights:
                with suppress(Exception):
                    client.cancel([flight[1] for flight in self._flights.values()], force=True)
            self._closed(client)

    def _closed(self, one: Any) -> None:
        try:
            one.close(timeout=5)
        except Exception:
            logging.getLogger("ematwin").debug("closing the cluster", exc_info=True)

    def _land(self, id: str) -> list[RunResult]:
        spec, future, since = self._flights[id]
        if future.status in {"cancelled", "lost"}:
            self._lose(None)
            return []
        try:
            result: RunResult = future.result(timeout=_CONNECT)
        except self._distributed.KilledWorker:
            overdue = self._limit is not None and time.monotonic() - since >= (
                hard_limit(self._limit)
            )
            trials = self._deaths.setdefault(id, Trials())
            trials.failed()
            if not (overdue or trials.over(self._patience)):
                del self._flights[id]
                self._again[id] = spec
                return []
            result = gave_up(spec, self.name, self._limit, overdue, trials.failures)
        except (OSError, TimeoutError) as error:
            self._lose(error)
            return []
        except Exception as error:
            result = RunResult(id, "failed", stopped=f"{type(error).__name__}: {error}")
        del self._flights[id]
        return [result]

    def _watch_cluster(self) -> None:
        if self._client is None:
            return
        if self._client.status not in {"running", "newly-created"}:
            self._lose(None)
            return
        if time.monotonic() - self._looked > _LOOK:
            self._look()
        if self._slots:
            self._alone_since = None
        elif self._alone_since is None:
            self._alone_since = time.monotonic()
        elif time.monotonic() - self._alone_since > self._patience:
            raise EngineError(
                f"All workers of the scheduler at {self._address} are gone for {self._patience:g} "
                "s. Finished runs are kept; start workers and give the same command again."
            )

    def _look(self) -> int:
        """Count the workers; runs go to as many at once."""
        try:
            threads = self._client.nthreads()
        except Exception as error:
            self._lose(error)
            return 0
        self._looked = time.monotonic()
        wide = [address for address, n in threads.items() if n != 1]
        if wide:
            self.close()
            raise EngineError(
                f"The worker {wide[0]} has {threads[wide[0]]} threads, but a run is one thread. "
                "Start the workers with: dask worker ... --nthreads 1"
            )
        self._slots = len(threads)
        return self._slots

    def _lose(self, error: BaseException | None) -> None:
        """The scheduler is gone: keep what was in flight, until it is back or waited for in vain.

        Raises
        ------
        EngineError
            If it has been gone for too long.
        """
        self._again.update({id: flight[0] for id, flight in self._flights.items()})
        self._flights.clear()
        self._slots = 0
        self._disconnect()
        self._reconnections.failed()
        if self._reconnections.over(self._patience):
            cause = f" ({_short(error)})" if error is not None else ""
            raise EngineError(
                f"The scheduler at {self._address} was lost{cause} and did not come back in "
                f"{self._patience:g} s. Finished runs are kept; start it and its workers, and give "
                "the same command again."
            )

    def _resume(self) -> None:
        """Connect again if it is time to, and send what was in flight once there are workers."""
        if self._client is None and self._reconnections.is_due:
            try:
                self._connect()
            except (OSError, ValueError, TypeError) as error:
                self._lose(error)
                return
            if not self._look():
                self._alone_since = time.monotonic()
        if self._client is None:
            return
        if self._slots:
            self._reconnections = Trials()
        for id, spec in list(self._again.items()):
            waiting = self._deaths.get(id)
            if len(self._flights) < self._slots and (waiting is None or waiting.is_due):
                del self._again[id]
                self.submit(spec)


def _short(error: BaseException) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else text[:117] + "..."
