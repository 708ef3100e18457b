"""Plain numpy: all candidates of a batch abreast in arrays, one Python loop over the steps."""

import numpy as np
from benchmarks.peers.array_step import advance
from benchmarks.peers.task import Task, scored


def costs(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) of fault vectors (B, 8)."""
    return scored(currents(task, k), task)


def currents(task: Task, k: np.ndarray) -> np.ndarray:
    """Mean currents (B, S - 1), A, of the sampling intervals."""
    m = task.magnitudes(k)
    state = tuple(np.full(len(k), value) for value in task.start)
    found = np.empty((len(k), task.target.size - 1))
    for sample in range(1, task.target.size):
        d_command = (task.command[sample] - task.command[sample - 1]) / task.substeps
        d_load = (task.load[sample] - task.load[sample - 1]) / task.substeps
        charge = np.zeros(len(k))
        for j in range(task.substeps):
            state = advance(
                np, state, task.command[sample - 1] + (j + 0.5) * d_command,
                task.load[sample - 1] + (j + 0.5) * d_load, m, task.plant, task.step,
            )  # fmt: skip
            charge += state[0]
        found[:, sample - 1] = charge / task.substeps
    return found
