"""Searches side by side in threads of this process, their candidates on one GPU.

Each search is a thread that mostly waits for its costs. The candidates of all that wait go to the
device in one launch, so that it gets whole generations of many searches at once. A run that does
not return cannot be ended here: a time limit counts between batches only.
"""

import queue
import threading

from ematwin.benchmarking.engines.base import Engine
from ematwin.benchmarking.execute import execute, warm_up
from ematwin.benchmarking.run import RunResult, RunSpec

SEARCHES = 64  # side by side, unless told otherwise


class CudaEngine(Engine):
    """Threads that share a GPU.

    Parameters
    ----------
    searches : int, side by side
    time_limit : float, s, of a run, or None; the time it waits for others counts
    """

    name = "cuda"

    def __init__(self, searches: int = SEARCHES, time_limit: float | None = None) -> None:
        self._searches = searches
        self._limit = time_limit
        self._results: queue.SimpleQueue[RunResult] = queue.SimpleQueue()
        self._flights: set[str] = set()

    def start(self) -> None:  # noqa: D102
        warm_up()

    @property
    def busy(self) -> int:  # noqa: D102
        return len(self._flights)

    @property
    def free(self) -> int:  # noqa: D102
        return self._searches - len(self._flights)

    def submit(self, spec: RunSpec) -> None:  # noqa: D102
        self._flights.add(spec.id)
        # a daemon: it must not keep the process from ending after Ctrl-C
        threading.Thread(target=self._do, args=(spec,), name=spec.id, daemon=True).start()

    def finished(self, timeout: float) -> list[RunResult]:  # noqa: D102
        results: list[RunResult] = []
        try:
            while True:
                result = self._results.get(timeout=0.0 if results else timeout)
                if result.id in self._flights:
                    self._flights.discard(result.id)
                    results.append(result)
        except queue.Empty:
            return results

    def close(self) -> None:  # noqa: D102
        self._flights.clear()

    def _do(self, spec: RunSpec) -> None:
        try:
            result = execute(spec, self._limit, self.name, backend="cuda")
        except BaseException as error:  # a search may end its thread; the study shall go on
            result = RunResult(spec.id, "failed", stopped=f"{type(error).__name__}: {error}")
        self._results.put(result)
