"""Speed and memory of the twin, as medians of repeated runs with their spread.

Each function measures one figure, some number of times. They time the work itself, compiled; what
starts processes says so. Aims are those that the project set itself; a missed one is printed as
such. Run by ``ematwin bench``, never by a test.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ematwin.benchmarking.execute import provenance
from ematwin.estimation.problem import Problem
from ematwin.models.bldc.faults import HEALTHY
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import simulate


@dataclass(frozen=True)
class Figure:
    """A measured figure: median, lowest and highest of the repeats, and the aim."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    aim: str
    holds: bool
    detail: str

    @classmethod
    def of(
        cls, name: str, values: list[float], unit: str, *, detail: str,
        least: float | None = None, most: float = np.inf,
    ) -> "Figure":  # fmt: skip
        """The figure of repeated values; ``least`` or ``most`` is its aim."""
        middle = statistics.median(values)
        aim = f"at most {most:g}" if least is None else f"at least {least:g}"
        holds = middle <= most if least is None else middle >= least
        return cls(name, middle, min(values), max(values), unit, aim, holds, detail)


def machine() -> dict[str, str | int]:
    """Processor and versions with which the figures were measured."""
    known = provenance("none")
    return {
        "cores": os.cpu_count() or 1,
        **{name: known[name] for name in ("processor", "python", "numba", "numpy")},
    }


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def ten_thousand_scores(repeats: int) -> Figure:
    """Seconds for 10,000 scorings of the default scenario."""
    problem = Problem.of(simulate("reference"), "servo48")
    k = np.random.default_rng(2).random((50, 8))

    def work() -> None:
        for _ in range(200):
            problem.costs(k)

    problem.costs(k)
    return Figure.of(
        "10,000 scorings of the default scenario",
        [_seconds(work) for _ in range(max(1, repeats // 2))],
        "s", most=3.0, detail="200 batches of 50, 0.5 s record at 20 kHz, all cores",
    )  # fmt: skip


_MEMORY_PROBE = """
import resource
import numpy as np
from ematwin import Problem, simulate
problem = Problem.of(simulate("reference"), "servo48")
k = np.random.default_rng(3).random((50, 8))
for _ in range(200):
    problem.costs(k)
try:  # of this process; ru_maxrss also counts what its parent held when it started this one
    with open("/proc/self/status") as status:
        kilobytes = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
except OSError:
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(kilobytes / 1024)
"""


def memory_of_scores(_repeats: int) -> Figure:
    """Peak resident memory of a process that makes 10,000 scorings; once, as it hardly varies."""
    answer = subprocess.run(
        [sys.executable, "-c", _MEMORY_PROBE], capture_output=True, text=True, check=True
    )
    return Figure.of(
        "peak resident memory of 10,000 scorings", [float(answer.stdout)], "MB", most=400.0,
        detail="fresh process, imports included; one run",
    )  # fmt: skip


def reference_against_real_time(repeats: int) -> Figure:
    """Simulated seconds of the reference model in one second."""

    def work() -> object:
        return simulate("reference", faults=HEALTHY)

    work()
    duration = Scenario.load_file().duration
    return Figure.of(
        "reference model: simulated over real time",
        [duration / _seconds(work) for _ in range(repeats)],
        "times", least=5.0, detail="one core, step 1 us, record of 20 kHz",
    )  # fmt: skip


MEASUREMENTS = (ten_thousand_scores, memory_of_scores, reference_against_real_time)
