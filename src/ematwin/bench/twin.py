"""Speed and memory of the twin, as medians of repeated runs with their spread.

Each function measures one figure, some number of times. They time the work itself, compiled; what
starts processes says so. Aims are those that the project set itself; a missed one is printed as
such.
"""

import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ematwin.estimation.problem import Problem
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.faults import HEALTHY
from ematwin.models.bldc.parameters import BldcActuator
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


def machine() -> dict[str, str | int]:
    """What the figures were measured on."""
    import numba

    names = [
        line.split(":", 1)[1].strip()
        for line in _cpuinfo().splitlines()
        if line.startswith("model name")
    ]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": os.cpu_count() or 1,
        "python": platform.python_version(),
        "numba": numba.__version__,
        "numpy": np.__version__,
    }


def _cpuinfo() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return file.read()
    except OSError:
        return ""


def _seconds(work: Callable[[], object], repeats: int) -> list[float]:
    """Times of repeated work, compiled and warm."""
    work()
    return [_once(work) for _ in range(repeats)]


def _once(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _figure(
    name: str, values: list[float], unit: str, aim: float, *, at_least: bool, detail: str
) -> Figure:
    middle = statistics.median(values)
    return Figure(
        name, middle, min(values), max(values), unit,
        f"{'at least' if at_least else 'at most'} {aim:g}",
        middle >= aim if at_least else middle <= aim,
        detail,
    )  # fmt: skip


def lanes_against_scalar(repeats: int) -> Figure:
    """Speed-up of the monitor model in lanes, a candidate."""
    from ematwin.models.bldc import batch
    from ematwin.numerics.lanes import LANES

    actuator = BldcActuator.load()
    record = simulate("monitor")
    problem = Problem.of(record, actuator, threads=1)
    comparison = problem.comparisons[0]
    assert isinstance(comparison, BldcComparison)
    rng = np.random.default_rng(1)
    k = rng.random((8 * LANES, 8))
    steps = (len(record) - 1) * comparison.substeps
    grid = np.linspace(0.0, record.time[-1], steps + 1)
    command, load = Scenario.load_file().histories(grid)
    ratio = actuator.transmission.ratio
    constants = kernel_constants(actuator)

    def one_at_a_time() -> None:
        for vector in k[:16]:
            batch.monitor_trace(
                vector, command * ratio, load / ratio, np.zeros(7), constants, comparison.step, 1,
                comparison.substeps, None,
            )  # fmt: skip

    ratios = []
    problem.costs(k)
    one_at_a_time()
    for _ in range(repeats):  # in turn, so that a change of the machine's speed meets both
        scalar = _once(one_at_a_time) / 16
        lanes = _once(lambda: problem.costs(k)) / len(k)
        ratios.append(scalar / lanes)
    return _figure(
        "monitor model: scalar over lanes, a candidate", ratios, "times", 8.0, at_least=True,
        detail="one core; scalar keeps a trace, lanes filter and score",
    )  # fmt: skip


def ten_thousand_scores(repeats: int) -> Figure:
    """Seconds for 10,000 scorings of the default scenario."""

    problem = Problem.of(simulate("reference"), "servo48")
    k = np.random.default_rng(2).random((50, 8))

    def work() -> None:
        for _ in range(200):
            problem.costs(k)

    problem.costs(k)
    return _figure(
        "10,000 scorings of the default scenario",
        [_once(work) for _ in range(max(1, repeats // 2))],
        "s", 3.0, at_least=False, detail="200 batches of 50, 0.5 s record at 20 kHz, all cores",
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
    return _figure(
        "peak resident memory of 10,000 scorings", [float(answer.stdout)], "MB", 400.0,
        at_least=False, detail="fresh process, imports included; one run",
    )  # fmt: skip


def reference_against_real_time(repeats: int) -> Figure:
    """Simulated seconds of the reference model in one second."""
    times = _seconds(lambda: simulate("reference", faults=HEALTHY), repeats)
    duration = Scenario.load_file().duration
    return _figure(
        "reference model: simulated over real time", [duration / t for t in times], "times", 5.0,
        at_least=True, detail="one core, step 1 us, record of 20 kHz",
    )  # fmt: skip


def help_page(repeats: int) -> Figure:
    """Seconds for ``ematwin --help``."""

    def work() -> None:
        subprocess.run(
            [sys.executable, "-c", "from ematwin.cli import main; main()", "--help"],
            capture_output=True,
            check=True,
        )

    return _figure(
        "ematwin --help", _seconds(work, repeats), "s", 0.5, at_least=False, detail="a process each"
    )


MEASUREMENTS = (
    lanes_against_scalar,
    ten_thousand_scores,
    memory_of_scores,
    reference_against_real_time,
    help_page,
)
