"""Studies on a Dask scheduler and two workers, each a process of its own."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from distributed import Client
from processes import RUNS, finish, free_port, numbers, start, study, wait_for

Numbers = dict[str, tuple[Any, ...]]


class Cluster:
    """A scheduler and two workers, started with the commands of docs/cluster.md."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = self._scheduler()
        self.workers = [self.worker() for _ in range(2)]

    def _dask(self, *arguments: object) -> psutil.Popen:
        return psutil.Popen(
            [sys.executable, "-m", "dask", *map(str, arguments)],
            cwd=self._folder,
            env={**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "60s"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def _scheduler(self) -> psutil.Popen:
        return self._dask("scheduler", "--host", "127.0.0.1", "--port", self.port, "--no-dashboard")

    def worker(self, threads: int = 1) -> psutil.Popen:
        """Start a worker."""
        return self._dask("worker", self.address, "--nthreads", threads, "--no-dashboard")

    def wait(self, workers: int = 2) -> None:
        """Wait until all have found each other."""
        with Client(self.address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)

    def restart(self) -> None:
        """Start all anew, at the same address."""
        self.stop()
        self.scheduler = self._scheduler()
        self.workers = [self.worker() for _ in range(2)]
        self.wait()

    def stop(self) -> None:
        """End all processes."""
        for one in (*self.workers, self.scheduler):
            with contextlib.suppress(psutil.NoSuchProcess):
                family = [*one.children(recursive=True), one]
                for member in family:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        member.kill()
            one.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler with two workers."""
    made = Cluster(tmp_path)
    try:
        made.wait()
        yield made
    finally:
        made.stop()


def test_the_same_numbers_and_a_killed_worker(
    tmp_path: Path, cluster: Cluster, undisturbed: Numbers
) -> None:
    where = tmp_path / "study.db"
    main = start("--store", where, "--scheduler", cluster.address)
    wait_for(where, 5, main)
    process = next(  # the worker itself, under its nanny
        child
        for child in cluster.workers[0].children(recursive=True)
        if "spawn_main" in " ".join(child.cmdline())
    )
    process.kill()
    assert finish(main)["counts"] == {"done": RUNS}
    assert numbers(where) == undisturbed


def test_killed_scheduler(tmp_path: Path, cluster: Cluster, undisturbed: Numbers) -> None:
    where = tmp_path / "study.db"
    main = start("--store", where, "--scheduler", cluster.address)
    wait_for(where, 5, main)
    killed = time.monotonic()
    cluster.scheduler.kill()
    answer = finish(main, code=2)
    assert "was lost" in answer["error"]
    assert "Finished runs are kept" in answer["error"]
    assert time.monotonic() - killed < 60.0
    done = len(numbers(where))
    assert 5 <= done < RUNS
    cluster.restart()
    answer = study("--store", where, "--scheduler", cluster.address)
    assert answer["found"] == done
    assert numbers(where) == undisturbed


def test_a_run_that_never_returns(tmp_path: Path, saboteurs: dict[str, str]) -> None:
    """On a cluster of this machine, which the command starts and ends itself."""
    where = tmp_path / "study.db"
    cases = tmp_path / "cases.toml"
    cases.write_text('[cases."Worn"]\nfriction = 0.3\n')
    answer = study(
        "--cases", cases, "--runs", 1, "--algorithms", "ga,hangs", "--time-limit", 1,
        "--engine", "dask", "--workers", 2, "--store", where, **saboteurs,
    )  # fmt: skip
    assert answer["counts"] == {"done": 1, "timeout": 1}


def test_workers_with_several_threads_are_refused(tmp_path: Path, cluster: Cluster) -> None:
    cluster.workers.append(cluster.worker(threads=2))
    cluster.wait(3)
    answer = study("--store", tmp_path / "study.db", "--scheduler", cluster.address, code=2)
    assert "--nthreads 1" in answer["error"]
    assert not (tmp_path / "study.db").exists()
