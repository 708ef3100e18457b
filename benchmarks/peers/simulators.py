"""How long a candidate of the monitor model takes: ematwin's lanes beside other ways to run it.

All are given one `Task` and the same fault vectors. Before a peer is timed its costs of sixteen
random vectors must be ematwin's, but for one: steps that are the same to 1e-5, as the last digit
may send an impact the other way; free steps to 2 %, as a motor that all but stalls creeps where
friction is made smooth. A peer that disagrees is listed and not timed.
"""

import importlib
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from benchmarks.peers.measure import (
    Line,
    Part,
    in_turn,
    missing,
    number,
    program_version,
    progress,
    seconds,
    versions,
)
from benchmarks.peers.task import Task

from ematwin.models.bldc.comparison import BldcComparison

SEED = 2026
CHECKED = 16
BATCH = 256  # candidates of a repeat where a peer takes many at once
# Relative differences of a cost. Mostly 1e-13; up to 6e-7 where a motor all but stalls, as the last
# digit then decides in which step it breaks loose, and 1e-4 behind an impact that it sends the
# other way.
SAME_STEP = 1e-5
FREE_STEPS = 0.02

Costs = Callable[[Task, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Simulator:
    """A way to run the monitor model.

    Attributes
    ----------
    module, function : where in this folder
    batch : candidates of a repeat
    tolerance : relative difference of costs that counts as agreement
    absent : gives a sentence if it cannot be run here, else an empty text
    """

    name: str
    module: str
    batch: int
    tolerance: float = SAME_STEP
    function: str = "costs"
    absent: Callable[[], str] = str

    def load(self) -> Costs:
        """Its function of a task and fault vectors."""
        module = importlib.import_module(f"benchmarks.peers.{self.module}")
        found: Costs = getattr(module, self.function)
        return found


def no_jax() -> str:
    return missing("jax", "'jax[cpu]'", "JAX")


def no_compiler() -> str:
    if shutil.which("g++"):
        return ""
    return "C++ is left out: g++ is not installed (on Debian: apt-get install g++)."


SIMULATORS = (
    Simulator("C++, g++ -O3, 32 lanes", "cpp", BATCH, absent=no_compiler),
    Simulator("JAX, vmap and scan, all cores", "jax_scan", BATCH, absent=no_jax),
    Simulator("numba, one at a time", "numba_single", 16),
    Simulator("numpy over the batch", "numpy_batch", BATCH),
    Simulator("LSODA, free steps, odeint", "scipy_ivp", 2, FREE_STEPS, "lsoda_inside"),
    Simulator("LSODA, free steps, solve_ivp", "scipy_ivp", 2, FREE_STEPS, "lsoda"),
    Simulator("solve_ivp, fixed steps", "scipy_ivp", 2, SAME_STEP, "fixed"),
)


def disagreement(costs: Costs, task: Task, k: np.ndarray) -> np.ndarray:
    """Relative differences (B,) of a peer's costs from ematwin's, the largest last."""
    own = task.own_costs(k)
    return np.sort(np.abs(costs(task, k) - own) / own)


def run(*, quick: bool, repeats: int) -> Part:
    """Check and time all that can be run here."""
    task = Task.make(0.05 if quick else None)
    many = 64 if quick else BATCH
    rng = np.random.default_rng(SEED)
    checked, timed = rng.random((CHECKED, 8)), rng.random((many, 8))
    spread = BldcComparison(task.comparison.recording, task.actuator, rectify=True)
    steps = (task.target.size - 1) * task.substeps
    remarks, lines = [], []

    def line(name: str, pairs: list[tuple[float, float]], batch: int, off: str, own: bool) -> Line:
        values = tuple(1e3 * peer / batch for peer, _ in pairs)
        ratios = tuple((peer / batch) / (mine / many) for peer, mine in pairs)
        per_step = 1e6 * float(np.median(values)) / steps
        return Line(name, values, ratios, (number(per_step), off), own)

    def one_thread() -> object:
        return task.own_costs(timed)

    progress("simulators: ematwin")
    task.own_costs(timed), task.own_costs(timed, spread)
    alone = [(s, s) for s in (seconds(one_thread) for _ in range(repeats))]
    lines.append(line("ematwin, one thread", alone, many, "", True))
    together = in_turn(lambda: task.own_costs(timed, spread), one_thread, repeats, 60.0)
    lines.append(line(f"ematwin, {os.cpu_count()} cores", together, many, "", True))

    for one in SIMULATORS:
        progress(f"simulators: {one.name}")
        if sentence := one.absent():
            remarks.append(sentence)
            continue
        costs = one.load()
        differences = disagreement(costs, task, checked)
        off = differences[-2]  # of all but one
        said = f"{off:.1e} (one: {differences[-1]:.1e})"
        if not off <= one.tolerance:
            remarks.append(
                f"{one.name} is not timed: its costs differ from ematwin's by up to {off:.1e}; "
                f"{one.tolerance:.0e} is allowed."
            )
            lines.append(Line(one.name, (), (), ("", said)))
            continue
        batch = min(one.batch, many)
        chosen = timed[:batch]
        if batch == many:
            costs(task, chosen)  # a compiler may compile for each size
        pairs = in_turn(lambda c=costs, k=chosen: c(task, k), one_thread, repeats, 40.0)
        lines.append(line(one.name, pairs, batch, said, False))

    return Part(
        "Simulating a candidate",
        f"Milliseconds to simulate and score one candidate: {task.simulated:g} s of the monitor "
        f"model in steps of {1e6 * task.step:.3g} us, {task.target.size} samples, default "
        f"scenario. Batches of {many} where a peer takes batches, else one after another. Ratios "
        "are to ematwin on one thread, measured beside each. Costs agree with ematwin's before "
        "anything is timed; the last column says how well.",
        "ms a candidate",
        "times ematwin",
        ("ns a step", "costs differ by"),
        tuple(lines),
        tuple(remarks),
        versions("numpy", "numba", "scipy", "jax") | program_version("g++"),
    )
