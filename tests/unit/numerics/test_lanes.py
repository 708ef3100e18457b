"""Loops over lanes are computed in vectors, on processors with and without AVX-512."""

import os
import platform
import re
import subprocess
import sys

import pytest

CODE = """
import re
import numpy as np
from numba.core.caching import NullCache
from ematwin.models.linear_axis import batch
from ematwin.models.linear_axis.constants import constants_table
from ematwin.models.registry import load_actuator
from ematwin.numerics.lanes import lane_loop

traces = lane_loop(batch.axis_traces.py_func)
traces._cache = NullCache()  # compiled anew: only then numba knows its code
constants = constants_table(load_actuator("emps"), {}, 3)
command = np.linspace(0.0, 0.01, 50)
voltage, position = np.empty((2, 3, 50))
traces(command, 0.0 * command, True, np.zeros((3, 3)), constants, 1e-3, 2, voltage, position)
(code,) = traces.inspect_llvm().values()
widths = {int(width) for width in re.findall(r"fmul .*?<([0-9]+) x double>", code)}
print(*position[:, -1], *widths)
"""


def run(**changed: str) -> tuple[list[float], int]:
    """Where three candidates end, and how many numbers the widest vectors hold."""
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        env={**os.environ, **changed}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    *ends, widest = done.stdout.split(maxsplit=3)
    return [float(end) for end in ends], max(map(int, widest.split()))


@pytest.mark.skipif(not re.match("x86|AMD64", platform.machine()), reason="of x86 alone")
def test_lanes_are_computed_in_vectors_with_and_without_avx_512() -> None:
    ends, widest = run()
    same, half = run(NUMBA_CPU_NAME="haswell", NUMBA_CPU_FEATURES="+avx2,+fma")
    assert half == 4
    assert widest >= 4
    assert ends == pytest.approx(same, rel=1e-9)
    assert same[0] == same[2] != 0.0
