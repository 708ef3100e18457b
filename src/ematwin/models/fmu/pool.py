"""Workers that run an FMU, each in a separate process, for many candidates side by side.

A worker that crashes or hangs is ended and replaced; its run costs an error of one sentence.
"""

import os
import pickle
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.numerics.side_by_side import cores, side_by_side

_PROGRAM = Path(__file__).with_name("worker.py")


class Pool:
    """As many workers as there are cores, for one FMU; each is started where it is needed."""

    def __init__(self, path: Path) -> None:
        from fmpy import extract

        self.said, self._name = "", path.name  # last message of the FMU where a run failed
        self._folder = extract(str(path), tempfile.mkdtemp(prefix="ematwin-fmu-"))
        self._running: set[subprocess.Popen[bytes]] = set()
        self._free: queue.LifoQueue[Any] = queue.LifoQueue()
        for _ in range(cores()):
            self._free.put(None)
        weakref.finalize(self, _end, self._running, self._folder, os.getpid())

    def run(self, tasks: list[dict[str, Any]], names: list[str], limit: float) -> list[np.ndarray]:
        """Outputs (S, K) for arguments of `worker.follow`; NaN from where an FMU failed.

        `EmatwinError` if the FMU cannot be loaded, crashes, or takes more than ``limit`` s for one;
        it has the ``names`` of the settings.
        """
        return side_by_side(lambda task: self._answer(task, names, limit), tasks, cores())

    def _answer(self, task: dict[str, Any], names: list[str], limit: float) -> np.ndarray:
        worker = self._free.get()
        try:
            if worker is None:
                worker = subprocess.Popen(
                    [sys.executable, "-P", str(_PROGRAM), self._folder],
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                )  # fmt: skip
                self._running.add(worker)
                _told(worker, None, 60.0)  # s: licences and large libraries take their time
            rows, said = _told(worker, task, limit)
        except BaseException as error:  # an interrupt leaves an answer in the pipe
            _end({worker})
            self._running.discard(worker)
            worker = None
            if not isinstance(error, EmatwinError):
                raise
            values = zip(names, task["values"], strict=True)
            with_ = ", ".join(f"{name} = {value:.6g}" for name, value in values)
            raise EmatwinError(
                f"{self._name} {error} with {with_}. Repair the FMU, narrow the ranges in its "
                "file, or raise time_limit there."
            ) from None
        finally:
            self._free.put(worker)
        self.said = said or self.said
        return np.asarray(rows)


def _told(worker: Any, task: Any, limit: float) -> Any:
    """The answer of a worker to a task; once it is ready where there is none."""
    begun, timer = time.monotonic(), threading.Timer(limit, worker.kill)
    timer.daemon = True
    timer.start()
    try:
        if task is not None:
            pickle.dump(task, worker.stdin)
            worker.stdin.flush()
        answer = pickle.load(worker.stdout)
    except (EOFError, OSError, pickle.UnpicklingError):
        code = worker.wait()
        if time.monotonic() - begun >= limit:
            raise EmatwinError(f"did not answer within {limit:g} s") from None
        how = f"crashed (signal {-code})" if code < 0 else f"ended its process (status {code})"
        raise EmatwinError(how) from None
    finally:
        timer.cancel()
    if isinstance(answer, str):
        raise EmatwinError(f"failed: {answer}")
    return answer


def _end(workers: set[Any], folder: str = "", process: int = 0) -> None:
    """End some workers, and remove their folder; not those of a parent from which this forked."""
    if process and os.getpid() != process:
        return
    for worker in workers:
        with suppress(OSError), worker:
            worker.kill()
    if folder:
        shutil.rmtree(folder, ignore_errors=True)


@lru_cache(maxsize=8)
def pool_of(path: Path, digest: str, process: int) -> Pool:
    """The workers of an FMU in this process; those of an FMU replaced on disk end in time."""
    return Pool(path)
