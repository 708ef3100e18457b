"""What a study costs beside its searches: overhead, the gain of a second worker, a large store.

    python benchmarks/study.py [--json] [--runs 20] [--repeat 3] [--size 100000]

Overhead is the share of the workers' time in which they do not search: start of the processes and
compiling are left out (a first, unmeasured study does them), store, engine and bookkeeping are in.
One worker and two take turns; the figures are medians over the turns, so that other work on the
machine weighs less. Resuming and reporting are processes of their own, so that their memory counts.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ematwin.benchmarking.engine import LocalEngine
from ematwin.benchmarking.plan import Plan, Run, RunSpec, pack
from ematwin.benchmarking.store import Store, open_store
from ematwin.benchmarking.study import Tally, run_study
from ematwin.benchmarking.subject import cases_of


def measure_workers(folder: Path, runs: int, repeat: int) -> dict[str, float]:
    """Overhead with one worker and two, and how much faster two are: medians over the turns."""
    plan = Plan({"Low F": cases_of("paper")["Low F"]}, ("de", "pso"), runs=max(1, runs // 2))
    turns: dict[str, list[float]] = {}
    for turn in range(repeat):
        seconds: dict[int, float] = {}
        for workers in (1, 2):
            engine = LocalEngine(workers)
            engine.start()  # before the clock: the start that the study makes changes nothing
            for _ in range(workers):  # recordings and kernels
                engine.submit(replace(plan.specs()[0], iterations=1, run=engine.busy))
            while engine.busy:
                engine.finished(1.0)
            where = folder / f"{turn}-{workers}.db"
            with Store(where) as store:
                tally: Tally = run_study(plan, store, engine)
            seconds[workers] = tally.seconds
            results = list(open_store(where).runs())
            searching = sum(result.seconds for result in results)
            for name, value in (
                ("overhead", 1.0 - searching / (workers * tally.seconds)),
                ("seconds_per_run", searching / tally.planned),
                ("cpu_seconds_per_run", sum(r.cpu_seconds for r in results) / tally.planned),
            ):
                turns.setdefault(f"{name}_{workers}", []).append(value)
        turns.setdefault("two_over_one", []).append(seconds[1] / seconds[2])
    figures = {name: float(np.median(values)) for name, values in turns.items()}
    # what it would be if each worker had a core to itself: without the waiting for one
    figures["two_over_one_by_cpu"] = (
        2.0 * (1.0 - figures["overhead_2"]) * figures["cpu_seconds_per_run_1"]
        / ((1.0 - figures["overhead_1"]) * figures["cpu_seconds_per_run_2"])
    )  # fmt: skip
    figures["two_over_one_least"] = min(turns["two_over_one"])
    figures["two_over_one_most"] = max(turns["two_over_one"])
    return figures


def synthetic(specs: list[RunSpec], seed: int) -> list[Run]:
    """Runs with plausible numbers that nobody searched."""
    rng = np.random.default_rng(seed)
    evaluations = range(50, 10_001, 50)
    stored = []
    for spec in specs:
        costs = np.sort(rng.exponential(1.0, 200))[::-1].tolist()  # each iteration an improvement
        run = Run(
            spec, "done", tuple(rng.random(8).tolist()), costs[-1], 0.1, 2.0, 2.0, 10_000, 1.0,
            1.0, pack(evaluations, costs), "budget", {"engine": "synthetic"},
        )  # fmt: skip
        stored.append(run)
    return stored


RESUME = """
import sys
sys.path.insert(0, sys.argv[3])
from study import large_plan
from ematwin.benchmarking.engine import LocalEngine
from ematwin.benchmarking.store import Store
from ematwin.benchmarking.study import run_study
with Store(sys.argv[1]) as store:
    tally = run_study(large_plan(int(sys.argv[2])), store, LocalEngine(1))
assert tally.finished == 0 and tally.found == tally.planned, tally
"""


def large_plan(size: int) -> Plan:
    """A plan of at least ``size`` runs."""
    algorithms = ("ga", "pso", "de", "gwo", "da", "woa", "random", "ga-binary", "pso-ring")
    return Plan(cases_of("multi", count=-(-size // (10 * len(algorithms)))), algorithms, runs=10)


def measure_store(folder: Path, size: int) -> dict[str, float]:
    """Seconds to open, resume and report a store of at least ``size`` runs, and what they take."""
    where = folder / "large.db"
    plan = large_plan(size)
    specs = plan.specs()
    with Store(where) as store:
        store.begin(plan.settings())
        for n in range(0, len(specs), 1000):
            store.save(synthetic(specs[n : n + 1000], n))
    figures = {"runs": float(len(specs)), "megabytes": where.stat().st_size / 1e6}
    here = str(Path(__file__).parent)
    commands = {
        "resume": ["-c", RESUME, str(where), str(size), here],
        "report": ["-m", "ematwin", "report", str(where), "--out", str(folder / "report")],
    }
    for name, command in commands.items():
        started = time.perf_counter()
        subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
        figures[f"{name}_seconds"] = time.perf_counter() - started
        # of all children so far: the second figure is the larger of the two
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
        figures[f"{name}_peak_gigabytes"] = peak
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--size", type=int, default=100_000)
    asked = parser.parse_args()
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        if asked.size:  # first: the workers of the other would count as children
            figures.update(measure_store(Path(folder), asked.size))
        if asked.runs:
            figures.update(measure_workers(Path(folder), asked.runs, asked.repeat))
    if asked.json:
        sys.stdout.write(json.dumps(figures, indent=2) + "\n")
        return
    for name, value in figures.items():
        sys.stdout.write(f"{name:<24} {value:.4g}\n")


if __name__ == "__main__":
    main()
