"""What a study costs beside its searches: overhead, the gain of a second worker, a large store.

    python benchmarks/study.py [--json] [--runs 20] [--size 100000]

Overhead is the share of the workers' time in which they do not search: start of the processes and
compiling are left out (a first, unmeasured study does them), store, engine and bookkeeping are in.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ematwin.study.cases import cases_of, multi_cases
from ematwin.study.compare import Tally, compare
from ematwin.study.engines.local import LocalEngine
from ematwin.study.plan import Plan
from ematwin.study.run import RunResult, RunSpec, StoredRun
from ematwin.study.store import Store, open_store


class WarmEngine(LocalEngine):
    """Starts before the clock does."""

    def start(self, attempts: int = 3) -> None:
        if self._pool is None:
            super().start(attempts)


def measure_workers(folder: Path, runs: int) -> dict[str, float]:
    """Overhead with one worker, and how much faster two are."""
    plan = Plan({"Low F": cases_of("paper")["Low F"]}, ("de", "pso"), runs=max(1, runs // 2))
    seconds: dict[int, float] = {}
    figures: dict[str, float] = {}
    for workers in (1, 2):
        engine = WarmEngine(workers)
        engine.start()
        for _ in range(workers):  # records and kernels
            engine.submit(replace(plan.specs()[0], iterations=1, run=len(engine._flights)))
        while engine.busy:
            engine.finished(1.0)
        where = folder / f"{workers}.db"
        with Store(where) as store:
            tally: Tally = compare(plan, store, engine)
        seconds[workers] = tally.seconds
        searching = sum(one.result.seconds for one in open_store(where).runs())
        figures[f"overhead_{workers}"] = 1.0 - searching / (workers * tally.seconds)
        figures[f"seconds_per_run_{workers}"] = searching / tally.planned
    figures["two_over_one"] = seconds[1] / seconds[2]
    return figures


def synthetic(specs: list[RunSpec], seed: int) -> list[StoredRun]:
    """Runs with plausible numbers that nobody searched."""
    rng = np.random.default_rng(seed)
    evaluations = range(50, 10_001, 50)
    stored = []
    for spec in specs:
        costs = np.minimum.accumulate(rng.exponential(1.0, 200)).tolist()
        result = RunResult(
            spec.id, "done", tuple(rng.random(8).tolist()), costs[-1], 0.1, 2.0, 2.0, 10_000, 1.0,
            1.0, tuple(zip(evaluations, costs, strict=True)), "budget", {"engine": "synthetic"},
        )  # fmt: skip
        stored.append(StoredRun(spec, result))
    return stored


def measure_store(folder: Path, size: int) -> dict[str, float]:
    """Seconds to plan, open, resume and read a store of ``size`` runs, and its size on the disk."""
    where = folder / "large.db"
    algorithms = ("ga", "pso", "de", "gwo", "da", "woa", "random", "ga-binary", "pso-ring")
    cases = multi_cases(-(-size // (10 * len(algorithms))), 1)
    started = time.perf_counter()
    plan = Plan(cases, algorithms, runs=10)
    specs = plan.specs()[:size]
    ids = {spec.id for spec in specs}
    figures = {"plan_seconds": time.perf_counter() - started}
    with Store(where) as store:
        store.begin(plan.settings())
        for n in range(0, size, 1000):
            store.save(synthetic(specs[n : n + 1000], n))
    figures["megabytes"] = where.stat().st_size / 1e6
    started = time.perf_counter()
    with open_store(where) as store:
        missing = ids - store.statuses().keys()
        figures["resume_seconds"] = time.perf_counter() - started
        started = time.perf_counter()
        kept = list(store.runs())
        figures["read_seconds"] = time.perf_counter() - started
        started = time.perf_counter()
        pairs = sum(len(one.result.history) for one in kept)
        figures["unpack_seconds"] = time.perf_counter() - started
    if missing or len(kept) != size or pairs != 200 * size:
        raise SystemExit("the store lost runs")
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--size", type=int, default=100_000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        figures = measure_workers(Path(folder), asked.runs) if asked.runs else {}
        if asked.size:
            figures.update(measure_store(Path(folder), asked.size))
    figures["peak_gigabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    if asked.json:
        sys.stdout.write(json.dumps(figures, indent=2) + "\n")
        return
    for name, value in figures.items():
        sys.stdout.write(f"{name:<22} {value:.4g}\n")


if __name__ == "__main__":
    main()
