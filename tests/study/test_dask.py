"""Studies on a Dask scheduler and two workers, each a process of its own."""

import time

import pytest
from distributed import LocalCluster
from processes import RUNS, SMALL, finish, numbers, start, study, wait_for
from servers import Cluster


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """A scheduler with two workers."""
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        made.wait()
        yield made
    finally:
        made.stop()


@pytest.fixture
def cluster(started):
    """They run."""
    if started.scheduler.poll() is not None:
        started.restart()
    return started


def test_the_same_numbers_and_a_killed_worker(tmp_path, cluster, undisturbed):
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


def test_killed_scheduler_that_comes_back(tmp_path, cluster, undisturbed):
    where = tmp_path / "study.db"
    main = start("--store", where, "--scheduler", cluster.address)
    wait_for(where, 5, main)
    cluster.scheduler.kill()
    cluster.restart()
    assert finish(main)["counts"] == {"done": RUNS}
    assert numbers(where) == undisturbed


def test_workers_with_several_threads_are_refused(ematwin, tmp_path):
    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp://",
        dashboard_address=None,
    ) as cluster:  # fmt: skip
        address = cluster.scheduler_address
        answer = ematwin("compare", *SMALL, "--store", "study.db", "--scheduler", address)
    assert answer.code == 2
    assert answer.err.startswith("Error: ")
    assert "--nthreads 1" in answer.err
    assert not (tmp_path / "study.db").exists()


def test_killed_scheduler(tmp_path, cluster, undisturbed):
    where = tmp_path / "study.db"
    main = start("--store", where, "--scheduler", cluster.address, "--patience", 4)
    wait_for(where, 5, main)
    killed = time.monotonic()
    cluster.scheduler.kill()
    answer = finish(main, code=2)
    assert "was lost" in answer["error"]
    assert "Finished runs are kept" in answer["error"]
    assert time.monotonic() - killed < 60.0
    done = len(numbers(where))
    assert 5 <= done < RUNS
    answer = study("--store", where, "--workers", 1)
    assert answer["found"] == done
    assert numbers(where) == undisturbed


def test_a_run_that_never_returns(tmp_path, saboteurs):
    """On a cluster of this machine, which the command starts and ends itself."""
    where = tmp_path / "study.db"
    cases = tmp_path / "cases.toml"
    cases.write_text('[cases."Worn"]\nfriction = 0.3\n')
    answer = study(
        "--cases", cases, "--runs", 1, "--algorithms", "ga,hangs", "--time-limit", 1,
        "--engine", "dask", "--workers", 2, "--store", where, **saboteurs,
    )  # fmt: skip
    assert answer["counts"] == {"done": 1, "timeout": 1}
