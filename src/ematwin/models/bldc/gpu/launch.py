"""Launch the kernel: all candidates on all stretches of a recording at once.

A search with a large population gains; a descent, whose batches are small, does not.
"""

import importlib.util
import threading
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ematwin.errors import InputError, MissingExtraError
from ematwin.models.bldc.state import Constants
from ematwin.models.bldc.stretches import Stretches

_BLOCK = 32  # threads: one warp, so that a small batch is spread over as many cores as can be

CANDIDATES_PER_CORE = 128  # a launch takes as long as a core does for these (benchmarks/gpu.py)
_LAUNCHING = threading.Lock()  # one device; searches may ask from several threads

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

    def numbers(self) -> np.ndarray:
        """(N, 23) array for the kernel."""
        some = self.stretches
        power = np.zeros((len(some), 2)) if some.power is None else some.power.states
        rest = [
            some.samples, self.step, self.substeps, self.rectify, self.kept, self.kept_power,
        ]  # fmt: skip
        return np.column_stack(
            [some.states, some.taps, power, some.starts, np.tile(rest, (len(some), 1))]
        )


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
    from numba.core import config

    # numba-cuda warns of small launches, and a user can do nothing about them
    vars(config)["CUDA_LOW_OCCUPANCY_WARNINGS"] = 0
    if not cuda.is_available():
        raise InputError(
            "No CUDA device can be used here. Compute on the processor, or use a machine whose "
            "nvidia-smi lists a device."
        )
    return cuda


def pays(candidates: int, cores: int) -> bool:
    """Whether a launch is faster than so many cores of the processor."""
    return candidates >= CANDIDATES_PER_CORE * cores


def scores(work: Work) -> Scores:
    """Score candidates in one launch.

    Returns
    -------
    costs : (B,) array, sums over the stretches
    responses : (B, N kept) array, A
    power : (B, N kept) array, W; (B, 0) if it does not count

    Raises
    ------
    MissingExtraError, InputError
        As of `ready`.
    """
    cuda = ready()
    from ematwin.models.bldc.gpu.kernel import monitor_scores_by_thread

    some, size, parts = work.stretches, len(work.faults), len(work.stretches)
    # a column for each candidate on each stretch, those of a stretch side by side: threads that
    # are neighbours read and write neighbours
    total = size * parts
    constants = np.broadcast_to(work.constants, (size, len(Constants._fields)))
    kept = (work.kept, work.kept_power)
    shapes = [total, *((most, total) if most else (1, 1) for most in kept)]
    there = [cuda.device_array(shape) for shape in shapes]  # a device has no empty arrays
    with _LAUNCHING:
        monitor_scores_by_thread[-(-total // _BLOCK), _BLOCK](
            cuda.to_device(np.ascontiguousarray(np.tile(work.faults, (parts, 1)).T)),
            cuda.to_device(np.ascontiguousarray(np.tile(constants, (parts, 1)).T)),
            cuda.to_device(np.repeat(np.arange(parts), size)),
            cuda.to_device(np.stack([some.command, some.load, some.target, some.weights])),
            cuda.to_device(work.numbers()),
            *there,
        )
        costs, *traces = (one.copy_to_host() for one in there)
    rows = (
        trace[:most, : total if most else 0].T.reshape(parts, size, most)
        for trace, most in zip(traces, kept, strict=True)
    )
    response, watts = (one.transpose(1, 0, 2).reshape(size, parts * one.shape[2]) for one in rows)
    return costs.reshape(parts, size).sum(axis=0), response, watts
