"""Launches of the kernel: candidates and stretches from any threads of a process, in one.

It can pay only where a launch holds thousands of candidates.
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
from ematwin.models.bldc.state import Constants
from ematwin.models.bldc.stretches import Stretches

_BLOCK = 32  # threads: one warp, so that a small batch is spread over as many cores as can be

Scores = tuple[np.ndarray, np.ndarray, np.ndarray]  # as `BldcComparison.run` gives them


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

    @property
    def kept_power(self) -> int:
        """Samples of the power that are kept."""
        return self.kept if self.stretches.power is not None else 0

    def numbers(self, before: int) -> np.ndarray:
        """(N, 23) array for the kernel, with so many samples of other works ahead."""
        some = self.stretches
        power = np.zeros((len(some), 2)) if some.power is None else some.power.states
        rest = [
            some.samples, self.step, self.substeps, self.rectify, self.kept, self.kept_power,
        ]  # fmt: skip
        return np.column_stack(
            [some.states, some.taps, power, before + some.starts, np.tile(rest, (len(some), 1))]
        )


class Launcher:
    """Launches the kernel; works that threads bring during a launch go together in the next.

    Attributes
    ----------
    launches : int, so far
    """

    def __init__(self) -> None:
        self.launches = 0
        self._launching = threading.Lock()
        self._queueing = threading.Lock()
        self._queue: list[tuple[Work, Future[Scores]]] = []

    def scores(self, work: Work) -> Scores:
        """Costs (B,), responses (B, N kept) and, if it counts, power (B, N kept), W.

        Responses and power are (0, 0) where none are kept.

        Raises
        ------
        MissingExtraError, InputError
            As of `ready`.
        """
        answer: Future[Scores] = Future()
        with self._queueing:
            self._queue.append((work, answer))
        with self._launching:
            if not answer.done():  # else another thread took it along
                self._launch_all()
        return answer.result()

    def _launch_all(self) -> None:
        with self._queueing:
            waiting, self._queue = self._queue, []
        try:
            found = launched([work for work, _ in waiting])
            self.launches += 1
            for (_, answer), scores in zip(waiting, found, strict=True):
                answer.set_result(scores)
        except BaseException as error:
            for _, answer in waiting:
                answer.set_exception(error)


LAUNCHER = Launcher()
"""One device, one launcher: all comparisons of a process share it."""


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


def launched(works: Sequence[Work]) -> list[Scores]:
    """The scores of works, from one launch."""
    cuda = ready()
    from ematwin.models.bldc.gpu.kernel import monitor_scores_by_thread

    parts = [len(work.stretches) for work in works]
    sizes = [len(work.faults) for work in works]
    numbers, signals, before = [], [], 0
    for work in works:
        some = work.stretches
        numbers.append(work.numbers(before))
        signals.append(np.stack([some.command, some.load, some.target, some.weights]))
        before += some.command.size
    # a column for each candidate on each stretch, those of a stretch side by side: threads that
    # are neighbours read and write neighbours
    faults = [np.tile(work.faults, (n, 1)) for work, n in zip(works, parts, strict=True)]
    constants = [
        np.tile(np.broadcast_to(work.constants, (size, len(Constants._fields))), (n, 1))
        for work, size, n in zip(works, sizes, parts, strict=True)
    ]
    ends = np.cumsum(np.multiply(parts, sizes))
    total, most = int(ends[-1]), max(work.kept for work in works)
    most_power = max(work.kept_power for work in works)
    shapes = [
        total,
        (most, total) if most else (1, 1),
        (most_power, total) if most_power else (1, 1),
    ]
    there = [cuda.device_array(shape) for shape in shapes]  # a device has no empty arrays
    monitor_scores_by_thread[-(-total // _BLOCK), _BLOCK](
        cuda.to_device(np.ascontiguousarray(np.concatenate(faults).T)),
        cuda.to_device(np.ascontiguousarray(np.concatenate(constants).T)),
        cuda.to_device(np.repeat(np.arange(sum(parts)), np.repeat(sizes, parts))),
        cuda.to_device(np.concatenate(signals, axis=1)),
        cuda.to_device(np.concatenate(numbers)),
        *there,
    )  # fmt: skip
    costs, response, watts = (one.copy_to_host() for one in there)
    found = []
    for work, end, n, size in zip(works, ends, parts, sizes, strict=True):
        own = slice(end - n * size, end)
        found.append((
            costs[own].reshape(n, size).sum(axis=0),
            _rows(response[: work.kept, own], n),
            _rows(watts[: work.kept_power, own], n),
        ))  # fmt: skip
    return found


def _rows(columns: np.ndarray, parts: int) -> np.ndarray:
    """(B, N K) array of its own, from columns (K, N B); (0, 0) if none are kept."""
    kept = len(columns)
    if not kept:
        return np.empty((0, 0))
    size = columns.shape[1] // parts
    return columns.T.reshape(parts, size, kept).transpose(1, 0, 2).reshape(size, -1)
