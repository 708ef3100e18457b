"""Independent pieces of work on threads: compiled loops release the GIL."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

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

    What needs no second thread stays in the caller's: another one keeps memory of its own, 30 MB on
    a long recording.
    """
    given = list(items)
    most = min(threads or cores(), len(given))
    if most <= 1:
        return [work(one) for one in given]
    with ThreadPoolExecutor(most) as pool:
        return list(pool.map(work, given))
