"""C++: `monitor.cpp`, compiled with g++ when first asked for, called through ctypes, one thread."""

import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.peers.task import Task

LANES = 32  # as in monitor.cpp
FLAGS = (
    "-O3", "-march=native", "-mprefer-vector-width=512", "-fopenmp-simd",
    # no errno, traps or signed zeros: selects and floor become vector instructions. Sums keep
    # their order, and NaN stays NaN (this is not -ffast-math).
    "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros",
    # these two make branches of the selects after rest, and then the loop is not vectorised:
    # seven times slower (g++ 12)
    "-fno-thread-jumps", "-fno-tree-pre",
)  # fmt: skip


@cache
def library() -> Any:
    """The compiled file, loaded."""
    source = Path(__file__).with_name("monitor.cpp")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "monitor.so"
        command = ["g++", *FLAGS, "-shared", "-fPIC", str(source), "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"g++ did not compile {source.name}: {done.stderr.strip()}")
        return ctypes.CDLL(str(target))


def costs(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) of fault vectors (B, 8)."""
    count = -(-len(k) // LANES) * LANES
    padded = np.concatenate([k, np.repeat(k[-1:], count - len(k), axis=0)])
    arrays = [
        np.ascontiguousarray(values, dtype=float)
        for values in (
            np.stack(task.magnitudes(padded)), task.plant, task.start, task.command, task.load,
            task.target, task.weights, task.filter,
        )
    ]  # fmt: skip
    m, plant, start, command, load, target, weights, low_pass = (
        array.ctypes.data_as(ctypes.c_void_p) for array in arrays
    )
    found = np.empty(count)
    library().costs(
        m, count, plant, start, command, load, target, weights, low_pass, task.target.size,
        ctypes.c_double(task.step), task.substeps, found.ctypes.data_as(ctypes.c_void_p),
    )  # fmt: skip
    return found[: len(k)]
