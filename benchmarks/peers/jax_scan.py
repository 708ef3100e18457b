"""JAX on the CPU in double precision: a candidate is a `scan` over samples, the batch a `vmap`.

Compiled by XLA, which may use all cores. The steps of a sampling interval are an inner loop:
unrolled they took three times as long, because XLA then computes parts of a step several times.
"""

from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.peers.array_step import advance
from benchmarks.peers.task import Magnitudes, Task
from jax import lax

jax.config.update("jax_platforms", "cpu")
jax.config.update("jax_enable_x64", True)


@lru_cache(maxsize=1)
def compiled(plant: Any, dt: float, substeps: int) -> Any:
    """The batch as one compiled function; magnitudes (B, 8) go in, costs (B,) come out."""

    def one(m_row: Any, start: Any, f: Any, inputs: Any) -> Any:
        m = Magnitudes(*m_row)

        def sample(carry: Any, x: Any) -> Any:
            state, z1, z2, total = carry
            command, d_command, load, d_load, target, weight = x

            def step(j: Any, now: Any) -> Any:
                middle = j + 0.5
                command_now, load_now = command + middle * d_command, load + middle * d_load
                state = advance(jnp, now[0], command_now, load_now, m, plant, dt)
                return state, now[1] + state[0]

            state, charge = lax.fori_loop(0, substeps, step, (state, jnp.zeros(())))
            value = jnp.abs(charge / substeps)
            b, a1, a2 = f[0], f[1], f[2]
            y = b * value + z1
            z1, z2 = 2.0 * b * value - a1 * y + z2, b * value - a2 * y
            return (state, z1, z2, total + weight * (target - y) ** 2), None

        first = (tuple(start[n] for n in range(7)), f[3], f[4], jnp.zeros(()))
        return lax.scan(sample, first, inputs)[0][-1]

    return jax.jit(jax.vmap(one, in_axes=(0, None, None, None)))


def costs(task: Task, k: np.ndarray) -> np.ndarray:
    """Costs (B,) of fault vectors (B, 8)."""
    inputs = (
        task.command[:-1], np.diff(task.command) / task.substeps,
        task.load[:-1], np.diff(task.load) / task.substeps,
        task.target[1:], task.weights[1:],
    )  # fmt: skip
    run = compiled(task.plant, task.step, task.substeps)
    rows = np.column_stack(task.magnitudes(k))
    return np.asarray(run(rows, np.array(task.start), np.array(task.filter), inputs))
