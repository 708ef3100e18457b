"""Loops over lanes are computed in vectors, on processors without AVX-512 too."""

import os
import platform
import re
from pathlib import Path

import numpy as np
import pytest

from commands import fresh
from ematwin.models.linear_axis.twin import AxisState, axis_constants, axis_traces
from ematwin.models.registry import load_actuator

CODE = """
import re
from test_lanes import axis_traces, ends

last = ends()
(code,) = axis_traces.loop.inspect_llvm().values()
widths = {int(width) for width in re.findall(r"fmul .*?<([0-9]+) x double>", code)}
print(*last, max(widths))
"""


def ends():
    """Where three candidates end."""
    constants, start = axis_constants(load_actuator("emps"), {}), AxisState(*[0.0] * 6)
    command = np.linspace(0.0, 0.01, 50)
    traces = axis_traces(command, None, constants, start, 1e-3, 2, count=3)
    return traces["position"][:, -1].tolist()


@pytest.mark.skipif(not re.match("x86|AMD64", platform.machine()), reason="of x86 alone")
def test_lanes_are_computed_in_vectors_and_answer_alike_on_another_processor(tmp_path):
    other = {
        "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma",
        "NUMBA_CACHE_DIR": str(tmp_path),  # compiled anew: only then numba knows its code
    }  # fmt: skip
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parents[1]), os.environ.get("PYTHONPATH", "")])
    done = fresh(CODE, **other, PYTHONPATH=path)
    *same, widest = map(float, done.out.split())
    assert widest == 4
    assert ends() == pytest.approx(same, rel=1e-9)
    assert same[0] == same[2] != 0.0
