"""Processes of the local engine."""

import os
import time

from ematwin.study.engines.local import LocalEngine

_kept: list[bytes] = []


def grow(size: int) -> int:
    """Keep memory as the compiler does, and tell which process did."""
    _kept.append(b"x" * size)
    time.sleep(1.1)  # loky looks at the memory once a second
    return os.getpid()


def test_a_worker_whose_memory_grew_by_compiling_is_not_replaced() -> None:
    engine = LocalEngine(1)
    engine.start()
    try:
        # the first call is what loky measures from
        processes = {engine._pool.submit(grow, size).result() for size in (0, 500_000_000, 0, 0)}
    finally:
        engine.close()
    assert len(processes) == 1
