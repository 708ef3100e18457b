"""Answers in their order, on as many threads as there is work for."""

import os
import threading

import pytest

from ematwin.numerics.side_by_side import cores, side_by_side


def test_answers_come_in_the_order_of_the_items() -> None:
    both = threading.Barrier(2, timeout=10.0)

    def squared(n: int) -> int:
        both.wait()  # two are at work at the same time
        return n * n

    assert side_by_side(squared, (3, 1, 2, 5), threads=2) == [9, 1, 4, 25]


@pytest.mark.parametrize(("items", "threads"), [((1, 2), 1), ((1,), 4), ((1,), None), ((), 3)])
def test_what_needs_no_second_thread_stays_in_this_one(items, threads) -> None:
    def here(item: int) -> int:
        return threading.get_ident()

    assert side_by_side(here, items, threads) == [threading.get_ident()] * len(items)


def test_an_error_reaches_the_caller() -> None:
    for threads in (1, 2):
        with pytest.raises(ZeroDivisionError):
            side_by_side(lambda n: 1 // n, (1, 0), threads)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="threads are bound on Linux only")
def test_cores_are_those_that_this_process_may_use() -> None:
    usable = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(usable)})
    try:
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, usable)
    assert cores() == len(usable)
