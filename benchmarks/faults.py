"""Disturb studies with real parts, many times over: each must end as one that was left alone.

    python benchmarks/faults.py                   # all, hours
    python benchmarks/faults.py --count 0.1 --only kill_main,kill_worker
    python benchmarks/faults.py --table           # what was run so far

Ids and all numbers of the disturbed study are compared with those of an undisturbed one. Each trial
is kept in ``--out`` as it ends; the same command goes on where it was stopped. The full disk is a
small file system in memory, mounted for the trial alone (`unshare --mount`; needs root or user
namespaces). The clock is that of one process: `time.time` is shifted from outside, through a file
that a ``sitecustomize`` reads, in the middle of its study.
"""

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "study"))

import processes
import psutil
from processes import finish, numbers, wait_for

Numbers = dict[str, tuple[Any, ...]]
ONCE = ("--runs", "1")  # half of the study of the tests
RUNS = processes.RUNS // 2
CUSTOM = """
import os, time
_real, _path = time.time, os.environ.get("FAULTS_CLOCK")
if _path:
    def _shifted():
        try:
            with open(_path) as file:
                return _real() + float(file.read() or 0.0)
        except OSError:
            return _real()
    time.time = _shifted
if "FAULTS_LEASE" in os.environ:
    import ematwin.benchmarking.store as _store
    _store.LEASE = float(os.environ["FAULTS_LEASE"])
    # where claims are shorter, so is the wait for a locked file
    _store.Store.__init__.__kwdefaults__["patience"] = 5.0 * _store.LEASE
"""


def start(*arguments: object, **environment: str) -> "subprocess.Popen[str]":
    """Start the small study that is disturbed."""
    return processes.start(*ONCE, *arguments, **environment)


def study(*arguments: object, **environment: str) -> dict[str, Any]:
    """Run it to its end."""
    return finish(start(*arguments, **environment))


class Bench:
    """What trials share: a folder, chance, the undisturbed numbers, servers that are started once.

    Parameters
    ----------
    folder : for stores
    undisturbed : ids and numbers of the study that was left alone
    lease : s for which claims hold, None for the usual half minute
    """

    def __init__(self, folder: Path, undisturbed: Numbers, lease: float | None = None) -> None:
        self.folder = folder
        self.undisturbed = undisturbed
        self.chance = random.Random()
        self._custom = folder / "site"
        self._custom.mkdir(exist_ok=True)
        (self._custom / "sitecustomize.py").write_text(CUSTOM)
        self._lease = lease
        self._postgres: Any = None

    def store(self, name: str = "study.db") -> Path:
        """Path of a new store."""
        path = self.folder / name
        for one in self.folder.glob(f"{name}*"):
            one.unlink()
        return path

    def database(self) -> str:
        """URL of a new database of a running PostgreSQL."""
        from servers import Postgres

        if self._postgres is None:
            place = self.folder / "postgres"
            place.mkdir()
            self.folder.chmod(0o755)
            self._postgres = Postgres(place)
            self._postgres.start()
        return self._postgres.database(f"trial_{self.chance.getrandbits(48):x}")

    @property
    def postgres(self) -> Any:
        """The server, once there is a database."""
        return self._postgres

    @contextlib.contextmanager
    def cluster(self) -> Iterator[Any]:
        """A scheduler with two workers."""
        from servers import Cluster

        made = Cluster(self.folder)
        try:
            made.wait()
            yield made
        finally:
            made.stop()

    def environment(self, clock: Path | None = None) -> dict[str, str]:
        """Of a process whose clock, and whose lease, are ours."""
        path = os.pathsep.join([str(self._custom), os.environ.get("PYTHONPATH", "")])
        found = {"PYTHONPATH": path}
        if clock is not None:
            found["FAULTS_CLOCK"] = str(clock)
        if self._lease is not None:
            found["FAULTS_LEASE"] = str(self._lease)
        return found

    def under_way(
        self, where: str | Path, *arguments: object, least: int = 0, most: int = RUNS - 6,
        **environment: str,
    ) -> tuple["subprocess.Popen[str]", int]:  # fmt: skip
        """A study that has begun, and how many runs it has stored."""
        main = start("--store", where, *arguments, **environment)
        stored = self.chance.randrange(least, most)
        wait_for(where, stored, main)
        return main, stored

    def check(self, where: str | Path, *mains: "subprocess.Popen[str]") -> None:
        """Commands end well; ids and numbers are those of the undisturbed study."""
        for main in mains:
            assert finish(main)["counts"] == {"done": RUNS}
        assert numbers(where) == self.undisturbed, f"{where} differs from the undisturbed study"

    def close(self) -> None:
        """Stop what was started."""
        if self._postgres is not None:
            self._postgres.stop()


def workers_of(main: "subprocess.Popen[str]") -> list[psutil.Process]:
    """Worker processes of a study."""
    found = []
    for child in psutil.Process(main.pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if any("popen_loky" in part for part in child.cmdline()):
                found.append(child)
    return found


def kill_main(bench: Bench) -> str:
    """kill -9 of the command, at any moment; the command is repeated."""
    where = bench.store()
    main = start("--store", where, "--workers", 2)
    stored = bench.chance.randrange(RUNS - 6)
    if stored:
        wait_for(where, stored, main)
    else:
        time.sleep(bench.chance.uniform(0.0, 3.0))
    main.kill()
    main.communicate()
    study("--store", where, "--workers", 2)
    bench.check(where)
    return f"after {stored} runs"


def kill_worker(bench: Bench) -> str:
    """kill -9 of one to four worker processes, one right after the other."""
    where = bench.store()
    main, stored = bench.under_way(where, "--workers", bench.chance.choice([1, 2]))
    kills, done = bench.chance.randint(1, 4), 0
    while done < kills and main.poll() is None:
        with contextlib.suppress(psutil.Error):
            alive = workers_of(main)
            if alive:
                bench.chance.choice(alive).kill()
                done += 1
        time.sleep(0.02)
    bench.check(where, main)
    return f"{done} kills from {stored} runs on"


def kill_dask_worker(bench: Bench) -> str:
    """kill -9 of a Dask worker under its nanny, or of both."""
    where = bench.store()
    with bench.cluster() as cluster:
        main, stored = bench.under_way(where, "--scheduler", cluster.address)
        family = cluster.workers[0].children(recursive=True)
        both = bench.chance.random() < 0.5
        for one in family if not both else [cluster.workers[0], *family]:
            with contextlib.suppress(psutil.Error):
                one.kill()
        bench.check(where, main)
    return f"after {stored} runs, {'with' if both else 'without'} its nanny"


def kill_dask_scheduler(bench: Bench) -> str:
    """kill -9 of the Dask scheduler; a new one and new workers come at the same address."""
    where = bench.store()
    with bench.cluster() as cluster:
        main, stored = bench.under_way(where, "--scheduler", cluster.address)
        cluster.scheduler.kill()
        cluster.restart()
        bench.check(where, main)
    return f"after {stored} runs"


def postgres_stopped(bench: Bench) -> str:
    """PostgreSQL is stopped for ten seconds."""
    where = bench.database()
    main, stored = bench.under_way(where, "--workers", 2)
    bench.postgres.stop()
    time.sleep(10.0)
    bench.postgres.start()
    bench.check(where, main)
    return f"after {stored} runs"


def full_disk(bench: Bench) -> str:
    """The disk of the store is full after runs were stored; it is enlarged, the command repeated.

    A file system of its own in memory, mounted for this trial.
    """
    disk, kept = bench.folder / "disk", bench.store("kept.db")
    disk.mkdir(exist_ok=True)
    where = disk / "study.db"
    stored = bench.chance.randrange(1, RUNS - 6)
    small = " ".join((*processes.SMALL, *ONCE))
    command = f"{sys.executable} -m ematwin compare {small} --store {where} --workers 2"
    script = f"""
        mount -t tmpfs -o size=4m ematwin {disk} || exit 90
        {command} & main=$!
        {sys.executable} {Path(__file__).resolve()} --wait {where} {stored}
        dd if=/dev/zero of={disk}/filler bs=4k 2>{disk}/said
        wait $main; echo "first $?"; cp {where} {kept}.full; rm {disk}/filler
        {command}; echo "second $?"; cp {where} {kept}
    """
    space = ["unshare", "--mount"] if os.geteuid() == 0 else ["unshare", "-r", "--mount"]
    done = subprocess.run(
        [*space, "sh", "-c", script], capture_output=True, text=True, timeout=1800, check=False
    )
    assert "first 2" in done.stdout, done.stdout + done.stderr
    assert "second 0" in done.stdout, done.stdout + done.stderr
    assert "is full" in done.stderr, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    assert stored <= len(numbers(f"{kept}.full")) < RUNS
    bench.check(kept)
    return f"after {stored} runs"


def waited(where: Path, count: int) -> int:
    """Wait until a study has stored so many runs, without a look at their content."""
    while True:
        with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(where)) as one:
            if one.execute("SELECT count(*) FROM ematwin_runs").fetchone()[0] >= count:
                return 0
        time.sleep(0.02)


def stopped_beyond_lease(bench: Bench) -> str:
    """SIGSTOP of a command until another has taken over all of its claims, then SIGCONT.

    One that is stopped within a commit keeps SQLite's lock: then the other waits for two minutes,
    ends with a sentence, and is repeated once the first goes on.
    """
    where = bench.store()
    environment = bench.environment()
    main, stored = bench.under_way(where, "--workers", 1, least=1, **environment)
    main.send_signal(signal.SIGSTOP)
    second = start("--store", where, "--workers", 1, **environment)
    try:
        second.wait()
    finally:
        main.send_signal(signal.SIGCONT)
    if second.returncode == 2:
        assert "database is locked" in finish(second, code=2)["error"]
        second = start("--store", where, "--workers", 1, **environment)
    other = finish(second)
    assert other["counts"] == {"done": RUNS}
    bench.check(where, main)
    return f"after {stored} runs; the other waited and took {other['seconds']:.0f} s"


def two_mains(bench: Bench, where: str | Path) -> str:
    """Two commands at once on one store."""
    both = [start("--store", where, "--workers", 1) for _ in range(2)]
    answers = [finish(one) for one in both]
    assert all(answer["counts"] == {"done": RUNS} for answer in answers)
    assert sum(answer["finished"] for answer in answers) == RUNS
    bench.check(where)
    return " and ".join(f"{answer['finished']}" for answer in answers) + " runs"


def two_on_sqlite(bench: Bench) -> str:
    """Two commands at once on one SQLite file."""
    return two_mains(bench, bench.store())


def two_on_postgres(bench: Bench) -> str:
    """Two commands at once on one PostgreSQL database."""
    return two_mains(bench, bench.database())


def clock_set_back(bench: Bench) -> str:
    """The clock of one of two commands is set back by an hour, under way."""
    where, clock = bench.store(), bench.folder / "clock"
    clock.write_text("0")
    environment = bench.environment(clock)
    main, stored = bench.under_way(where, "--workers", 1, least=1, most=RUNS // 2, **environment)
    clock.write_text("-3600")
    other = start("--store", where, "--workers", 1, **bench.environment())
    bench.check(where, main, other)
    return f"after {stored} runs"


def claims_of_tomorrow(bench: Bench) -> str:
    """Claims of a lost machine whose clock was a day ahead are not waited for until then."""
    where = bench.store()
    study("--store", where, "--workers", 1, "--algorithms", "ga")
    left = [id for id, one in bench.undisturbed.items() if one[0].algorithm == "pso"]
    claimed = bench.chance.sample(left, 3)
    with contextlib.closing(sqlite3.connect(where)) as opened, opened:
        opened.executemany(
            "INSERT INTO ematwin_claims VALUES (?, 'elsewhere 1 x', ?)",
            [(id, time.time() + 86400.0) for id in claimed],
        )
    answer = study("--store", where, "--workers", 2, **bench.environment())
    bench.check(where)
    return f"waited {answer['seconds']:.0f} s"


TRIALS: dict[Callable[[Bench], str], int] = {
    kill_main: 50,
    kill_worker: 50,
    kill_dask_worker: 10,
    kill_dask_scheduler: 10,
    postgres_stopped: 10,
    full_disk: 10,
    stopped_beyond_lease: 10,
    two_on_sqlite: 10,
    two_on_postgres: 10,
    clock_set_back: 10,
    claims_of_tomorrow: 10,
}


def plan(scale: float, only: list[str]) -> list[tuple[str, int]]:
    """Names and numbers of the trials, in turns, so that all kinds get on alike."""
    counts = {one.__name__: max(1, round(n * scale)) for one, n in TRIALS.items()}
    chosen = {name: n for name, n in counts.items() if not only or name in only}
    turns = [(k / n, name, k) for name, n in chosen.items() for k in range(n)]
    return [(name, k) for _, name, k in sorted(turns, key=lambda turn: turn[0])]


def read_results(path: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Trials that were kept; the last of each counts."""
    lines = path.read_text().splitlines() if path.exists() else []
    return {(one["trial"], one["n"]): one for one in map(json.loads, lines)}


def table(results: dict[tuple[str, int], dict[str, Any]]) -> str:
    """What was run, as Markdown."""
    rows = ["| disturbance | trials | as undisturbed | median, s |", "|---|--:|--:|--:|"]
    for one in TRIALS:
        found = [result for (name, _), result in results.items() if name == one.__name__]
        if found:
            seconds = sorted(result["seconds"] for result in found)[len(found) // 2]
            good = sum(result["ok"] for result in found)
            said = (one.__doc__ or "").split("\n")[0].rstrip(".")
            rows.append(f"| {said} | {len(found)} | {good} | {seconds:.0f} |")
    return "\n".join(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--count", type=float, default=1.0, help="scale of the counts")
    parser.add_argument("--only", default="", help="names of trials, with commas")
    parser.add_argument("--out", type=Path, default=Path("faults.jsonl"))
    parser.add_argument("--lease", type=float, help="s, in place of the usual half minute")
    parser.add_argument("--until", type=float, default=0.0, help="stop after so many seconds")
    parser.add_argument("--table", action="store_true", help="print what was run, and end")
    parser.add_argument("--wait", nargs=2, help=argparse.SUPPRESS)  # of the trial `full_disk`
    chosen = parser.parse_args()
    if chosen.wait:
        return waited(Path(chosen.wait[0]), int(chosen.wait[1]))
    known = read_results(chosen.out)
    if chosen.table:
        print(table(known))
        return 0
    only = [name for name in chosen.only.split(",") if name]
    byname = {one.__name__: one for one in TRIALS}
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="ematwin-faults-") as name:
        folder = Path(name)
        study("--store", folder / "alone.db", "--workers", 1)
        bench = Bench(folder, numbers(folder / "alone.db"), chosen.lease)
        try:
            for trial, n in plan(chosen.count, only):
                if (trial, n) in known and known[trial, n]["ok"]:
                    continue
                if chosen.until and time.monotonic() - began > chosen.until:
                    break
                bench.chance.seed(f"{trial} {n}")
                started = time.monotonic()
                try:
                    said, good = byname[trial](bench), True
                except Exception:
                    said, good = traceback.format_exc()[-2000:], False
                seconds = round(time.monotonic() - started, 2)
                result = {"trial": trial, "n": n, "ok": good, "seconds": seconds, "said": said}
                known[trial, n] = result
                with chosen.out.open("a") as file:
                    file.write(json.dumps(result) + "\n")
                print(f"{trial} {n}: {'ok' if good else 'FAILED'}, {seconds} s, {said}", flush=True)
        finally:
            bench.close()
            shutil.rmtree(folder / "disk", ignore_errors=True)
    print(table(known))
    return 0 if all(result["ok"] for result in known.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
