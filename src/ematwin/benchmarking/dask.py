"""A Dask cluster: a scheduler given by its address, or one that is started on this machine.

A scheduler starts a run again elsewhere when its worker dies, three times. The workers must have
one thread each, because a run is one thread and the watchdog ends the whole process. If the
scheduler or all of its workers are gone, the engine waits, then submits the runs in flight again.
"""

import logging
import textwrap
import time
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

from ematwin.benchmarking.engine import PATIENCE, Engine, EngineError
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.plan import Run, RunSpec
from ematwin.errors import MissingExtraError

_CONNECT, _LOOK = 10.0, 2.0  # s to connect, and between two looks at the workers


class DaskEngine(Engine):
    """Workers of a scheduler, tcp://host:8786; None starts one here, with ``workers``."""

    name = "dask"

    def __init__(
        self,
        scheduler: str | None,
        workers: int,
        time_limit: float | None = None,
        patience: float = PATIENCE,
    ) -> None:
        super().__init__(time_limit, patience)
        try:
            import distributed
        except ImportError:
            raise MissingExtraError("distributed", "dask", "The engine dask") from None
        self._distributed = distributed
        self._address = scheduler
        self._workers = workers
        self._cluster: Any = None
        self.client: Any = None  # of `distributed`, once started, also for work other than runs
        self._looked = 0.0
        self._answered = 0.0  # when there were workers last

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
        self._answered = time.monotonic()
        try:
            self._connect()
        except (OSError, ValueError, TypeError) as error:
            self.close()
            why = textwrap.shorten(str(error) or type(error).__name__, 120, placeholder="...")
            raise EngineError(
                f"The scheduler at {self._address} does not answer ({why}). Start it "
                "with: dask scheduler, and check the address."
            ) from None
        while not self._look():
            if time.monotonic() - self._answered > self._patience:
                self.close()
                raise EngineError(
                    f"The scheduler at {self._address} has no workers. Start some with: "
                    f"dask worker {self._address} --nthreads 1"
                )
            time.sleep(0.2)

    def finished(self, timeout: float) -> list[Run]:  # noqa: D102
        if self.client is not None and self.client.status not in {"running", "newly-created"}:
            self._disconnect()
        if time.monotonic() - self._looked >= _LOOK:
            self._look()
        if self._looked - self._answered > self._patience:
            what = "was lost" if self.client is None else "has lost all of its workers"
            raise EngineError(
                f"The scheduler at {self._address} {what}, for {self._patience:g} s now. Finished "
                "runs are kept; start it and its workers, and give the same command again."
            )
        return super().finished(timeout)

    def _end(self) -> None:
        self._disconnect()
        if self._cluster is not None:
            with suppress(Exception):
                self._cluster.close(timeout=5)
        self._cluster = None

    def _carry(self, spec: RunSpec) -> Run:
        while not self._closed.is_set():
            client, began = self.client, time.monotonic()
            run = execute, spec, self._limit, self.name
            with suppress(Exception):  # where the scheduler is lost
                # impure: another client of this scheduler may have asked for the same run
                task = client.submit(*run, pure=False, key=None, retries=0)
                while client is self.client:
                    try:
                        return task.result(timeout=_LOOK)
                    except TimeoutError:
                        continue
                    except self._distributed.KilledWorker:
                        return self._given_up(spec, self._overdue(began))
                    except (OSError, CancelledError):
                        break
                    except Exception as error:
                        return Run(spec, "failed", stopped=f"{type(error).__name__}: {error}")
            self._closed.wait(0.2)  # s, until `finished` has connected again
        raise EngineError("The engine was closed.")

    def _connect(self) -> None:
        self.client = self._distributed.Client(
            self._cluster or self._address, timeout=_CONNECT, set_as_default=False
        )

    def _disconnect(self) -> None:
        """Disconnect from the scheduler; runs in flight wait for another."""
        client, self.client, self._slots = self.client, None, 0
        if client is not None:
            with suppress(Exception):
                client.close(timeout=5)

    def _look(self) -> int:
        """Count the workers, connected again where the scheduler was lost; as many runs go out."""
        self._looked = time.monotonic()
        try:
            if self.client is None:
                self._connect()
            threads = self.client.nthreads()
        except Exception:
            self._disconnect()
            return 0
        wide = [address for address, n in threads.items() if n != 1]
        if wide:
            self.close()
            raise EngineError(
                f"The worker {wide[0]} has {threads[wide[0]]} threads, but a run is one thread. "
                "Start the workers with: dask worker ... --nthreads 1"
            )
        self._slots = len(threads)
        if self._slots:
            self._answered = self._looked
        return self._slots
