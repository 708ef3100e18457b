"""A servo that does not exist, logged as from a bus; it shares no code with the twin.

Its friction, delay and gain differ from run to run, its rows come every 9 to 11 ms, its encoder
counts 1.5 mrad, and now and then a read is false. The motion is that of `naive.position_servo`.
"""

from pathlib import Path

import numpy as np

from ematwin.models.registry import load_actuator
from naive.position_servo import position

SAMPLES, INTERVAL = 300, 0.01
LOADS = ((0.5, 0.1, 0.036), (0.9, 0.1, 0.036), (0.5, 0.15, 0.05))  # kg, m, kg
TRUE = {
    "controller.gain": 2.75, "motor.stall_torque": 6.0, "friction.coulomb": 0.16,
    "friction.load_share": 0.22, "controller.delay": 0.027,
}  # fmt: skip
COUNT = 2.0 * np.pi / 4096.0


def goals(kind: int) -> np.ndarray:
    """Goals (S,) rad of one of three motions."""
    time = np.arange(SAMPLES) * INTERVAL
    if kind == 0:
        return 0.7 * np.sin(2.0 * np.pi * 0.6 * time) + 0.3 * np.sin(2.0 * np.pi * 1.7 * time)
    if kind == 1:
        return 0.6 * (1.0 - np.cos(2.0 * np.pi * time / 3.0))
    return np.where((time > 0.3) & (time < 1.3), 0.9, np.where(time > 2.0, -0.5, 0.0))


def run(number: int, **faults: float) -> dict[str, np.ndarray]:
    """Columns of a run; its load and motion go by its number."""
    rng = np.random.default_rng(number)
    servo = {place: value for place, value, *_ in load_actuator("sts3215").parameters()} | TRUE
    servo["friction.coulomb"] *= np.exp(0.1 * rng.standard_normal())
    servo["friction.load_share"] *= np.exp(0.05 * rng.standard_normal())
    servo["controller.delay"] *= np.exp(0.05 * rng.standard_normal())
    load = LOADS[number % 3]
    time = np.arange(SAMPLES) * INTERVAL
    goal = goals(number // 3 % 3)
    true = position(servo, faults, time, goal, load)
    read = time + np.r_[0.0, rng.uniform(-5e-4, 5e-4, SAMPLES - 1)]
    noisy = np.interp(read, time, true) + 0.001 * rng.standard_normal(SAMPLES)
    seen = COUNT * np.round(noisy / COUNT)
    seen[rng.integers(20, SAMPLES - 20)] = -3.14
    return {
        "run": np.full(SAMPLES, number), "time": read, "goal_position": goal,
        "position": seen,
        **{name: np.full(SAMPLES, x)
           for name, x in zip(("mass", "length", "arm_mass"), load, strict=True)},
    }  # fmt: skip


def write(path: Path, runs: list[dict[str, np.ndarray]]) -> Path:
    """A table of runs."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({k: np.concatenate([one[k] for one in runs]) for k in runs[0]}), path)
    return path
