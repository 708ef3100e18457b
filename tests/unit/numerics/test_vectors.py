"""Lanes are as many as two vectors of the processor hold, and are computed in vectors."""

import os
import platform
import re
import subprocess
import sys

import pytest

CODE = """
import re
import numpy as np
from ematwin.models.linear_axis import batch
from ematwin.models.linear_axis.constants import constants_table
from ematwin.models.registry import load_actuator

batch.axis_traces.kept = False  # compiled anew: numba knows its code
constants = constants_table(load_actuator("emps"), {}, 3)
command = np.linspace(0.0, 0.01, 50)
voltage, position = np.empty((2, 3, 50))
batch.axis_traces(
    command, 0.0 * command, True, np.zeros((3, 3)), constants, 1e-3, 2, voltage, position
)
(code,) = batch.axis_traces.inspect_llvm().values()
widths = {int(width) for width in re.findall(r"fmul .*?<([0-9]+) x double>", code)}
print(batch.LANES, *sorted(widths), *position[:, -1])
"""


def run(**changed: str) -> tuple[int, list[int], list[float]]:
    """How many lanes there are, how wide their vectors, and where the candidates end."""
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        env={**os.environ, **changed}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    lanes, *rest = done.stdout.split()
    return int(lanes), [int(width) for width in rest[:-3]], [float(x) for x in rest[-3:]]


@pytest.mark.skipif(not re.match("x86|AMD64", platform.machine()), reason="of x86 alone")
def test_without_avx_512_lanes_are_half_as_many_and_computed_in_vectors_as_well() -> None:
    lanes, widths, ends = run()
    half, halved, same = run(NUMBA_CPU_NAME="haswell", NUMBA_CPU_FEATURES="+avx2,+fma")
    assert half == 8
    assert max(halved) == 4
    assert lanes == 2 * max(widths)
    assert ends == pytest.approx(same, rel=1e-9)
    assert same[0] == same[2] != 0.0
