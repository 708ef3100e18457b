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
from ematwin.models.linear_axis.step import AxisState, axis_traces
from ematwin.models.linear_axis.twin import axis_constants
from ematwin.models.registry import load_actuator

axis_traces.loop._cache = NullCache()  # compiled anew: only then numba knows its code
constants, start = axis_constants(load_actuator("emps")), AxisState(*[0.0] * 6)
command = np.linspace(0.0, 0.01, 50)
position = axis_traces(command, None, constants, start, 1e-3, 2, count=3)["position"]
(code,) = axis_traces.loop.inspect_llvm().values()
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
