"""Scores of candidates on a GPU: one thread for each candidate on each stretch, in one launch.

It can pay only where a launch holds thousands of them. The steps are those of the lanes, but a
device has its own sine, cosine and fused sums: costs agree to rounding, not to the last digit.
"""

import importlib.util
import threading
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ematwin.errors import InputError, MissingExtraError
from ematwin.models.bldc.cuda_signals import Signals
from ematwin.models.bldc.state import Constants
from ematwin.models.bldc.stretches import Stretches

BLOCK = 32  # threads: one warp, so that a small batch is spread over as many cores as can be


@dataclass(frozen=True)
class Work:
    """Candidates to be scored on some stretches of a recording.

    Attributes
    ----------
    stretches : N of them
    faults : (B, 8) array, fault vectors
    constants : (B, 35) array, or the `Constants` that all share
    step, substeps : step of the monitor model (s), and how many make a sampling interval
    rectify : whether magnitudes are compared
    kept : samples of a response over a stretch that are kept; 0 for none
    """

    stretches: Stretches
    faults: np.ndarray
    constants: np.ndarray | Constants
    step: float
    substeps: int
    rectify: bool
    kept: int


Scores = tuple[np.ndarray, np.ndarray, np.ndarray]  # as `BldcComparison.run` gives them


class Launcher:
    """Launches the kernel; works that threads bring during a launch go together in the next.

    So the generations of all searches that run beside one another share launches, with nobody
    waiting for a slower one.

    Attributes
    ----------
    launches : int, so far
    """

    def __init__(self) -> None:
        self.launches = 0
        self._launching = threading.Lock()
        self._queueing = threading.Lock()
        self._queue: list[tuple[Sequence[Work], Future[list[Scores]]]] = []
        self._signals = Signals()

    def scores(self, works: Sequence[Work]) -> list[Scores]:
        """Costs (B,), responses (B, N kept) and, if it counts, power (B, N kept), W, of each work.

        Responses and power are (0, 0) where none are kept.

        Raises
        ------
        MissingExtraError
            If numba-cuda is not installed.
        InputError
            If there is no device.
        """
        answer: Future[list[Scores]] = Future()
        with self._queueing:
            self._queue.append((works, answer))
        with self._launching:
            if not answer.done():  # else somebody took them along
                self._launch_all()
        return answer.result()

    def _launch_all(self) -> None:
        """Answer all that wait; those that keep responses apart, for they need much memory."""
        with self._queueing:
            waiting, self._queue = self._queue, []
        for keeps in (False, True):
            group = [one for one in waiting if any(work.kept for work in one[0]) == keeps]
            if not group:
                continue
            try:
                found = iter(self._launch([work for works, _ in group for work in works]))
                for works, answer in group:
                    answer.set_result([next(found) for _ in works])
            except BaseException as error:
                for _, answer in group:
                    if not answer.done():
                        answer.set_exception(error)

    def _launch(self, works: Sequence[Work]) -> list[Scores]:
        cuda = ready()
        from ematwin.models.bldc.cuda_kernel import monitor_scores_by_thread

        parts = [len(work.stretches) for work in works]
        sizes = [len(work.faults) for work in works]
        ends = np.cumsum(np.multiply(parts, sizes))
        total = int(ends[-1])
        signals, places = self._signals.placed([work.stretches for work in works], cuda.to_device)
        # a column for each candidate on each stretch, those of a stretch side by side: threads that
        # are neighbours read and write neighbours
        faults = np.concatenate(
            [np.tile(w.faults, (n, 1)) for w, n in zip(works, parts, strict=True)]
        ).T
        constants = np.concatenate(
            [
                np.tile(np.broadcast_to(work.constants, (size, len(Constants._fields))), (n, 1))
                for work, size, n in zip(works, sizes, parts, strict=True)
            ]
        ).T
        most = max(work.kept for work in works)
        with_power = most > 0 and any(work.stretches.power is not None for work in works)
        costs = np.empty(total)
        status = np.empty(total, dtype=np.int64)
        response = np.empty((most, total) if most else (1, 1))  # a device has no empty arrays
        watts = np.empty((most, total) if with_power else (1, 1))
        there = [cuda.device_array_like(array) for array in (costs, status, response, watts)]
        monitor_scores_by_thread[-(-total // BLOCK), BLOCK](
            cuda.to_device(np.ascontiguousarray(faults)),
            cuda.to_device(np.ascontiguousarray(constants)),
            cuda.to_device(np.repeat(np.arange(sum(parts)), np.repeat(sizes, parts))),
            signals,
            cuda.to_device(_numbers(works)),
            cuda.to_device(_counts(works, places)),
            *there,
        )
        self.launches += 1
        there[0].copy_to_host(costs)
        if most:
            there[2].copy_to_host(response)
        if with_power:
            there[3].copy_to_host(watts)
        found = []
        for work, end, part, size in zip(works, ends, parts, sizes, strict=True):
            own = slice(end - part * size, end)
            power = work.kept if work.stretches.power is not None else 0
            found.append((
                costs[own].reshape(part, size).sum(axis=0),
                _rows(response[: work.kept, own], part),
                _rows(watts[:power, own], part),
            ))  # fmt: skip
        return found


def _rows(columns: np.ndarray, parts: int) -> np.ndarray:
    """(B, N K) array of its own, from columns (K, N B); (0, 0) if none are kept."""
    kept = len(columns)
    if not kept:
        return np.empty((0, 0))
    size = columns.shape[1] // parts
    return columns.T.reshape(parts, size, kept).transpose(1, 0, 2).reshape(size, -1)


def _numbers(works: Sequence[Work]) -> np.ndarray:
    """(R, 17) array of the stretches of all works, as in `ematwin.models.bldc.monitor_thread`."""
    rows = []
    for work in works:
        some = work.stretches
        starts = np.zeros((len(some), 2)) if some.power is None else some.power.states
        step = np.full((len(some), 1), work.step)
        rows.append(np.concatenate([some.states, some.taps, starts, step], axis=1))
    return np.concatenate(rows)


def _counts(works: Sequence[Work], places: Sequence[int]) -> np.ndarray:
    """(R, 6) integer array of the same, columns as in `ematwin.models.bldc.monitor_thread`."""
    rows = []
    for work, first in zip(works, places, strict=True):
        power = work.kept > 0 and work.stretches.power is not None
        for start in work.stretches.starts.tolist():
            samples = work.stretches.samples
            rows.append([first + start, samples, work.substeps, work.rectify, work.kept, power])
    return np.array(rows, dtype=np.int64)


LAUNCHER = Launcher()  # one device, one launcher: all comparisons of a process share it


@cache
def ready() -> Any:
    """The module `numba.cuda` of numba-cuda, with a device, or its simulator.

    Raises
    ------
    MissingExtraError
        If numba-cuda is not installed. The `numba.cuda` inside numba is deprecated and not used.
    InputError
        If there is no device.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise MissingExtraError("numba-cuda", "gpu", "A GPU")
    from numba import cuda

    if not cuda.is_available():
        raise InputError(
            "No CUDA device can be used here. Compute on the processor, or use a machine whose "
            "nvidia-smi lists a device."
        )
    return cuda
