"""Loops in single precision from the source of those in double."""

import copy
import math
import pickle

import numpy as np
import pytest

from ematwin.numerics.compile import loop, loop_in_single, step
from ematwin.numerics.dependencies import dependencies
from ematwin.numerics.tolerance import Tolerance

REAL = np.float64
LANES = 4
_SMALL = Tolerance(1e-9, single=1e-3)


@step
def circle(x):
    return 0.1 + math.pi * x * x


@step
def is_small(x):
    return 1.0 if abs(x) < _SMALL else 0.0


@loop
def areas(x, count):
    total = np.zeros(LANES, REAL)
    for _ in range(count):
        for n in range(LANES):
            total[n] += circle(x)
    return total


@loop
def smallness(x):
    return is_small(x), LANES


def test_literals_and_constants_are_float32_in_steps_too() -> None:
    single = loop_in_single(areas, interleave=2, LANES=8, REAL=np.float32)
    single.kept = False  # compiled anew: numba knows its code
    found = single(np.float32(0.7), 1000)
    assert found.dtype == np.float32
    assert found.shape == (8,)
    expected = np.float32(0.0)
    each = np.float32(0.1) + np.float32(math.pi) * np.float32(0.7) * np.float32(0.7)
    for _ in range(1000):
        expected += each
    np.testing.assert_allclose(found, expected, rtol=2e-5)
    exact = areas(0.7, 1000)
    assert exact.shape == (4,)
    assert 1e-7 < abs(found[0] / exact[0] - 1.0) < 1e-4  # it is not double that was rounded
    code = single.inspect_llvm(single.signatures[0])
    body = code[code.index("define") :]
    assert "fadd" in body or "fmul" in body
    assert not any(
        f" {what} " in line and "double" in line
        for line in body.splitlines()
        for what in ("fadd", "fmul")
    )


def test_a_tolerance_is_wider_in_single_precision() -> None:
    assert smallness(1e-6) == (0.0, 4)
    assert smallness(1e-10) == (1.0, 4)
    single = loop_in_single(smallness, interleave=0, LANES=5)
    assert single(np.float32(1e-6)) == (1.0, 5)
    assert single(np.float32(1e-2)) == (0.0, 5)


def pickled(value: Tolerance) -> object:
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])
def test_a_tolerance_keeps_its_counterpart(copied) -> None:
    made = copied(_SMALL)
    assert made == 1e-9
    assert made.single == 1e-3
    assert repr(made) == "Tolerance(1e-09, single=0.001)"


def test_what_is_kept_on_disk_is_told_apart_by_precision_and_constants() -> None:
    contents = {
        dependencies(each).content
        for each in (
            areas,
            loop_in_single(areas, interleave=0),
            loop_in_single(areas, interleave=0, LANES=8),
            loop_in_single(areas, interleave=0, LANES=8, REAL=np.float32),
        )
    }
    assert len(contents) == 4
    # neither drops what the other is compiled to
    assert dependencies(areas).sources == dependencies(loop_in_single(areas, interleave=0)).sources
