"""What a fleet needs: recordings of many calibrated actuators through `identify` on a Dask cluster.

    python benchmarks/fleet_throughput.py FOLDER --actuators 20 --recordings 2000 --workers 2

FOLDER receives the calibrated actuators, the recordings (Parquet, 0.5 s at 20 kHz with 2 % white
noise and 12 bits, none to three faults) and the estimates (SQLite). What is there is not made
again: an interrupted run goes on where it was. docs/speed.md, "A fleet".

Printed are processor seconds of a recording by phase, the share of the workers' time that the
cluster itself takes, memory of a worker, bytes on disk, and how many tasks that do nothing the
scheduler passes on in a second; then what so many actuators with so many recordings a day need
(``--fleet``, ``--daily``). The steps of a worker run on one thread.
"""

import argparse
import json
import resource
import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from distributed import Client, LocalCluster, as_completed
from joblib import Parallel, delayed
from rich.progress import Progress, track

import ematwin

NO_OPS = 2000
DAY = 86_400.0
TABLE = (
    "CREATE TABLE IF NOT EXISTS estimate (recording TEXT PRIMARY KEY, actuator TEXT NOT NULL,"
    " grade TEXT NOT NULL, estimate TEXT NOT NULL)"
)


class Judged(NamedTuple):
    """One recording and its price: processor seconds, seconds, and memory of the worker (MB)."""

    recording: str
    actuator: str
    grade: str
    estimate: str
    reading: float
    identifying: float
    seconds: float
    memory: float


def made(folder: Path, actuators: int, recordings: int) -> list[tuple[Path, Path]]:
    """Recordings and calibrated actuators, as files; only what is missing is made."""
    of = [n % actuators for n in range(recordings)]
    twins = [folder / f"actuator{n:04d}.toml" for n in range(actuators)]
    files = [folder / f"{n:06d}.parquet" for n in range(recordings)]
    calibrate = [delayed(_calibrate)(n, path) for n, path in enumerate(twins) if not path.exists()]
    record = [delayed(_record)(of[n], n, path) for n, path in enumerate(files) if not path.exists()]
    for title, tasks in (("calibrating", calibrate), ("recording", record)):
        for _ in track(Parallel(2, return_as="generator")(tasks), title, len(tasks)):
            pass
    return [(file, twins[n]) for n, file in zip(of, files, strict=True)]


def _calibrate(seed: int, path: Path) -> None:
    import unknown_actuator as bench

    true = bench.actuator_off(seed)
    healthy = [bench.recorded(true, {}, 10 + n, {}) for n in range(bench.HEALTHY_RECORDINGS)]
    ematwin.calibrate(healthy, bench.SHEET, name=path.stem).save(path)


def _record(seed: int, number: int, path: Path) -> None:
    import unknown_actuator as bench

    faults = bench.injected_faults(np.random.default_rng([7, number]))
    ematwin.write(bench.recorded(bench.actuator_off(seed), faults, 1000 + number, {}), path)


def judge(recording: str, twin: str) -> Judged:
    """Identify one recording, on one thread."""
    start, began = time.perf_counter(), time.process_time()
    found = ematwin.read(recording)
    read = time.process_time()
    answer = ematwin.identify(found, twin, threads=1)
    done = time.process_time()
    return Judged(
        Path(recording).name, Path(twin).stem, answer.verdict.grade,
        json.dumps(answer.estimate.as_dict()), read - began, done - read,
        time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    )  # fmt: skip


def nothing(number: int) -> int:
    """A task that costs nothing but its way."""
    return number


def run(
    client: Client, pairs: list[tuple[Path, Path]], store: sqlite3.Connection
) -> Iterator[Judged]:
    """Judge what the store does not hold yet; each estimate is kept as it comes."""
    done = {name for (name,) in store.execute("SELECT recording FROM estimate")}
    left = [(str(file), str(twin)) for file, twin in pairs if file.name not in done]
    if not left:
        return
    futures = client.map(judge, *zip(*left, strict=True), pure=False)
    for _, one in as_completed(futures, with_results=True):
        judged = Judged(*one)
        with store:
            store.execute("INSERT INTO estimate VALUES (?, ?, ?, ?)", judged[:4])
        yield judged


def no_op_rate(client: Client) -> float:
    """Tasks a second that the scheduler passes on where they do nothing."""
    client.gather(client.map(nothing, range(100), pure=False))
    start = time.perf_counter()
    client.gather(client.map(nothing, range(NO_OPS), pure=False))
    return NO_OPS / (time.perf_counter() - start)


def main() -> None:
    """Make what is missing, judge it, print what it took and what a fleet needs."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--actuators", type=int, default=20)
    parser.add_argument("--recordings", type=int, default=2000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fleet", type=int, default=10_000, help="actuators of the fleet")
    parser.add_argument("--daily", type=int, default=50, help="recordings of each a day")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    pairs = made(given.folder, given.actuators, given.recordings)
    store = sqlite3.connect(given.folder / "estimates.db")
    store.execute(TABLE)
    with (
        LocalCluster(n_workers=given.workers, threads_per_worker=1, dashboard_address=None) as own,
        Client(own) as client,
        Progress() as progress,
    ):
        client.gather([client.submit(judge, *map(str, pairs[0]), workers=[one], pure=False)
                       for one in client.scheduler_info()["workers"]])  # fmt: skip
        rate = no_op_rate(client)
        task = progress.add_task("identifying", total=len(pairs))
        start, found = time.perf_counter(), []
        for one in run(client, pairs, store):
            found.append(one)
            progress.update(task, completed=len(found))
        seconds = time.perf_counter() - start
    if not found:
        print(f"All {len(pairs)} are in {given.folder / 'estimates.db'}; nothing to measure.")
        return
    reading, identifying, busy = (
        np.array([getattr(one, name) for one in found])
        for name in ("reading", "identifying", "seconds")
    )
    cpu = float((reading + identifying).mean())
    recording = float(np.mean([file.stat().st_size for file, _ in pairs]))
    estimate = (given.folder / "estimates.db").stat().st_size / len(pairs)
    memory = max(one.memory for one in found)
    idle = 1.0 - float(busy.sum()) / (given.workers * seconds)
    daily = given.fleet * given.daily
    print(f"{len(found)} recordings on {given.workers} workers in {seconds:.0f} s")
    print(f"processor seconds of each, median / P90: reading {_two(reading)}, identifying "
          f"{_two(identifying)}")  # fmt: skip
    print(f"workers without work {100 * idle:.1f} % of the time; {rate:.0f} empty tasks a second")
    print(f"memory of a worker {memory:.0f} MB; recording {recording / 1e3:.0f} kB, estimate "
          f"{estimate / 1e3:.1f} kB on disk")  # fmt: skip
    grades = {
        g: sum(one.grade == g for one in found) for g in ("fault", "changed", "healthy", "none")
    }
    print(f"verdicts: {grades}")
    print(f"\n{given.fleet} actuators, {given.daily} recordings a day: {daily} a day, "
          f"{daily / DAY:.1f} a second")  # fmt: skip
    print(f"  {daily * cpu / DAY:.1f} cores, {daily * cpu / DAY * memory / 1e3:.0f} GB of memory")
    print(f"  a day: {daily * recording / 1e9:.0f} GB of recordings, "
          f"{daily * estimate / 1e9:.1f} GB of estimates")  # fmt: skip
    print(f"  one scheduler of {rate:.0f} tasks a second is enough for {rate * cpu:.0f} workers")


def _two(values: np.ndarray) -> str:
    return f"{np.median(values):.3f} / {np.quantile(values, 0.9):.3f}"


if __name__ == "__main__":
    main()
