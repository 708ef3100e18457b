"""numba, one candidate at a time: the scalar step compiled, with branches, scored as it goes."""

import numpy as np
from benchmarks.peers.scalar_step import advance
from benchmarks.peers.task import Task
from numba import njit


@njit(error_model="numpy", nogil=True)
def cost(m, c, start, command, load, target, weights, f, dt, substeps):
    """Cost of one candidate."""
    i, w_m, x_m, w_o, x_o, gained, i_from = start
    z1, z2, total = f.z1, f.z2, 0.0
    for sample in range(1, target.size):
        d_command = (command[sample] - command[sample - 1]) / substeps
        d_load = (load[sample] - load[sample - 1]) / substeps
        charge = 0.0
        for j in range(substeps):
            i, w_m, x_m, w_o, x_o, gained, i_from = advance(
                i, w_m, x_m, w_o, x_o, gained, i_from,
                command[sample - 1] + (j + 0.5) * d_command,
                load[sample - 1] + (j + 0.5) * d_load, m, c, dt,
            )  # fmt: skip
            charge += i
        x = abs(charge / substeps)
        y = f.b * x + z1
        z1 = 2.0 * f.b * x - f.a1 * y + z2
        z2 = f.b * x - f.a2 * y
        total += weights[sample] * (target[sample] - y) ** 2
    return total


def costs(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) of fault vectors (B, 8)."""
    return np.array(
        [
            cost(
                m, task.plant, task.start, task.command, task.load, task.target, task.weights,
                task.filter, task.step, task.substeps,
            )
            for m in task.each(k)
        ]
    )  # fmt: skip
