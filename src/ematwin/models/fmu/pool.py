"""Workers that run an FMU, each in a separate process, for many candidates side by side.

A worker that crashes or hangs is ended and replaced; its run costs an error of one sentence.
"""

import atexit
import os
import pickle
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.models.fmu.archive import Archive
from ematwin.numerics.side_by_side import cores, side_by_side

_PROGRAM = Path(__file__).with_name("worker.py")


class Worker:
    """A process with one instance of an FMU; started where it is needed."""

    def __init__(self, setup: dict[str, Any], name: str) -> None:
        self._setup, self._name = setup, name
        self._process: subprocess.Popen[bytes] | None = None

    def run(
        self, drive: dict[str, Any], settings: np.ndarray, limit: float
    ) -> tuple[np.ndarray, str]:
        """Outputs (S, K) of one candidate, and the FMU's message where it failed."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-P", str(_PROGRAM)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            self._ask(self._setup, 60.0)  # s: licences and large libraries take their time
        return self._ask((drive, settings), limit)

    def _ask(self, task: Any, limit: float) -> Any:
        process: Any = self._process
        late = threading.Event()

        def end() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(limit, end)
        timer.daemon = True
        timer.start()
        try:
            pickle.dump(task, process.stdin)
            process.stdin.flush()
            answer = pickle.load(process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            code = self.end(wait=1.0)
            reason = f"crashed (signal {-code})" if code < 0 else (
                f"ended its process (status {code})"
            )  # fmt: skip
            if late.is_set():
                reason = f"did not answer within {limit:g} s"
            raise EmatwinError(f"{self._name} {reason}") from None
        except BaseException:  # an interrupt leaves an answer in the pipe
            self.end()
            raise
        finally:
            timer.cancel()
        if isinstance(answer, str):
            self.end()
            raise EmatwinError(f"{self._name} failed: {answer}")
        return answer

    def end(self, wait: float = 0.0) -> int:
        """End the process, at once or after ``wait`` s; its exit status."""
        process: Any = self._process
        self._process = None
        if process is None:
            return 0
        with suppress(subprocess.TimeoutExpired):
            process.wait(wait)
        process.kill()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()
        return int(process.wait())


class Pool:
    """As many workers as there are cores, for one FMU."""

    def __init__(self, archive: Archive) -> None:
        from fmpy import extract

        self._folder = tempfile.mkdtemp(prefix="ematwin-fmu-")
        self.archive, self.said = archive, ""  # last message of the FMU where a run failed
        setup = {
            "folder": str(extract(str(archive.path), self._folder)), "is_2": archive.is_2,
            "guid": archive.guid, "identifier": archive.identifier,
            "interpolates": archive.interpolates,
        }  # fmt: skip
        self._workers = [Worker(setup, archive.path.name) for _ in range(cores())]
        self._free: queue.LifoQueue[Worker] = queue.LifoQueue()
        for one in self._workers:
            self._free.put(one)
        self._process = os.getpid()
        atexit.register(self.end)

    def run(self, drive: dict[str, Any], settings: np.ndarray, limit: float) -> np.ndarray:
        """Outputs (B, S, K) of candidates (B, P); NaN from the sample on at which one failed.

        `EmatwinError` if the FMU cannot be loaded, crashes, or takes more than ``limit`` s for one.
        """

        def one(n: int) -> np.ndarray:
            worker = self._free.get()
            try:
                rows, said = worker.run(drive, settings[n], limit)
            except EmatwinError as error:
                values = zip(drive["names"], settings[n], strict=True)
                with_ = ", ".join(f"{name} = {value:.6g}" for name, value in values)
                raise EmatwinError(
                    f"{error} with {with_}. Repair the FMU, narrow the ranges in its file, or "
                    "raise time_limit there."
                ) from None
            finally:
                self._free.put(worker)
            self.said = said or self.said
            return rows

        return np.stack(side_by_side(one, range(len(settings)), len(self._workers)))

    def end(self) -> None:
        """End all workers."""
        if os.getpid() != self._process:  # a fork ends with what its parent still uses
            return
        for one in self._workers:
            one.end()
        shutil.rmtree(self._folder, ignore_errors=True)


_pools: dict[tuple[Path, int], Pool] = {}  # by FMU and process: a fork has its own
_making = threading.Lock()


def pool_of(archive: Archive) -> Pool:
    """The workers of an FMU in this process; workers of an FMU replaced on disk are ended."""
    with _making:
        key = archive.path, os.getpid()
        found = _pools.get(key)
        if found is None or found.archive.digest != archive.digest:
            if found is not None:
                found.end()
            found = _pools[key] = Pool(archive)
        return found
