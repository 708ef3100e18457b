"""Independent pieces of work on threads: compiled loops release the GIL.

Who asks takes pieces like any helper. A thread that only waits would leave its core to be found by
the scheduler, which takes longer than two blocks of a kernel: 4.5 in place of 3 ms.
"""

import math
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def cores() -> int:
    """How many cores this process may use: a scheduler may leave it a few of many."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def side_by_side(
    work: Callable[[Item], Answer], items: Iterable[Item], threads: int | None = None
) -> list[Answer]:
    """The answers to items, in their order; ``threads`` None takes one for each core.

    The caller's is one of them. After an error, or an interrupt, no further item is begun.
    """
    given = list(items)
    most = min(threads or cores(), len(given))
    if most <= 1:
        return [work(one) for one in given]
    answers: list[Any] = [None] * len(given)
    rest = iter(range(len(given)))

    def drain() -> None:
        try:
            for n in rest:
                answers[n] = work(given[n])
        finally:
            for _ in rest:
                pass

    # a forked process has none of its parent's threads
    helpers = [_helpers(os.getpid()).submit(drain) for _ in range(most - 1)]
    try:
        drain()
    finally:
        begun = [one for one in helpers if not one.cancel()]
    for one in begun:
        one.result()
    return answers


def in_blocks(
    work: Callable[[Sequence[Item]], Iterable[Answer]], items: Iterable[Item], most: int
) -> list[Answer]:
    """The same, where at most so many items, such as lanes, are one piece of work."""
    given, threads = list(items), cores()
    pieces = min(len(given), threads * math.ceil(len(given) / (threads * most)))
    ends = [len(given) * n // pieces for n in range(pieces + 1)] if given else []
    found = side_by_side(work, [given[a:b] for a, b in pairwise(ends)])
    return [one for each in found for one in each]


def by_candidate(values: Any, count: int) -> np.ndarray:
    """(B, N) array of a tuple of N numbers or (B,) arrays, for B = ``count`` candidates."""
    rows = np.empty((count, len(values)))
    for n, value in enumerate(values):
        rows[:, n] = value
    return rows


@cache
def _helpers(process: int) -> ThreadPoolExecutor:
    # at most: as many run as were ever wanted at the same time
    return ThreadPoolExecutor(64, thread_name_prefix="ematwin")
