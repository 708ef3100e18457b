"""Answers in their order, on as many threads as there is work for."""

import os
import threading
import time

import pytest

from ematwin.numerics.side_by_side import cores, in_blocks, side_by_side


def test_answers_come_in_the_order_of_the_items():
    both = threading.Barrier(2, timeout=10.0)

    def squared(n):
        both.wait()  # two are at work at the same time
        return n * n

    assert side_by_side(squared, (3, 1, 2, 5), threads=2) == [9, 1, 4, 25]


def test_work_may_share_its_own_work():
    def summed(n):
        return sum(side_by_side(lambda m: n * m, range(50), threads=4))

    assert side_by_side(summed, range(100), threads=4) == [1225 * n for n in range(100)]


@pytest.mark.parametrize("threads", [1, 2])
def test_after_an_error_no_further_item_is_begun(threads):
    begun = []

    def fails(n):
        begun.append(n)
        time.sleep(0.01)
        raise KeyError(n)

    with pytest.raises(KeyError):
        side_by_side(fails, range(100), threads)
    assert len(begun) <= threads


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork processes")
def test_a_forked_process_has_threads_of_its_own():
    assert side_by_side(abs, (-1, -2), threads=2) == [1, 2]
    both = threading.Barrier(2, timeout=10.0)
    child = os.fork()
    if child == 0:
        found = side_by_side(lambda n: (both.wait(), n)[1], (3, 4), threads=2)
        os._exit(0 if found == [3, 4] else 1)
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="threads are bound on Linux only")
def test_cores_are_those_that_this_process_may_use():
    usable = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(usable)})
    try:
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, usable)
    assert cores() == len(usable)


@pytest.mark.parametrize("count", [0, 1, 5, 16, 33, 76])
def test_blocks_have_at_most_so_many_items_and_keep_their_order(count):
    sizes = []

    def doubled(block):
        sizes.append(len(block))
        return [2 * n for n in block]

    assert in_blocks(doubled, range(count), 16) == [2 * n for n in range(count)]
    assert sum(sizes) == count
    assert all(0 < size <= 16 for size in sizes)
    assert len(sizes) >= min(count, cores())  # no core is left idle
