"""Plain numpy: all candidates of a batch abreast in arrays, one Python loop over the steps."""

import numpy as np
from benchmarks.peers.array_step import advance
from benchmarks.peers.task import Magnitudes, Task, scored


def costs(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) of fault vectors (B, 8)."""
    return scored(currents(task, k), task)


def currents(task: Task, k: np.ndarray, precision: type = np.float64) -> np.ndarray:
    """Mean currents (B, S - 1), A, of the sampling intervals; all numbers in one precision."""
    m = Magnitudes(*(values.astype(precision) for values in task.magnitudes(k)))
    state = tuple(np.full(len(k), value, precision) for value in task.start)
    found = np.empty((len(k), task.target.size - 1))
    for sample in range(1, task.target.size):
        d_command = (task.command[sample] - task.command[sample - 1]) / task.substeps
        d_load = (task.load[sample] - task.load[sample - 1]) / task.substeps
        charge = np.zeros(len(k), precision)
        for j in range(task.substeps):
            # Python's own numbers leave arrays in their precision
            state = advance(
                np, state, float(task.command[sample - 1] + (j + 0.5) * d_command),
                float(task.load[sample - 1] + (j + 0.5) * d_load), m, task.plant, task.step,
            )  # fmt: skip
            charge += state[0]
        found[:, sample - 1] = charge / task.substeps
    return found
