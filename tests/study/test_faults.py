"""A disturbed study, repeated, ends as one that was left alone. Each disturbance is a real one."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time

import psutil
from processes import RUNS, SMALL, finish, numbers, start, study, wait_for

from ematwin.benchmarking.execute import execute


def loky_workers(main):
    """Worker processes of a study."""
    found = []
    for child in psutil.Process(main.pid).children(recursive=True):
        try:
            if any("popen_loky" in part for part in child.cmdline()):
                found.append(child)
        except psutil.Error:
            pass
    return found


def test_main_process_interrupted_and_then_killed(tmp_path, undisturbed, unhurried):
    where = tmp_path / "study.db"
    main = start("--store", where, "--workers", 2, **unhurried)
    wait_for(where, 3, main)
    main.send_signal(signal.SIGINT)
    _, err = main.communicate(timeout=30)
    assert main.returncode == 130
    assert "Traceback" not in err
    kept = len(numbers(where))
    main = start("--store", where, "--workers", 2, **unhurried)
    wait_for(where, kept + 5, main)
    workers = loky_workers(main)
    main.kill()
    main.wait()
    _, alive = psutil.wait_procs(workers, timeout=20.0)
    assert not alive, "workers outlived their main process"
    done = len(numbers(where))
    assert kept + 5 <= done < RUNS
    answer = study("--store", where, "--workers", 1, **unhurried)
    assert answer["found"] == done
    assert numbers(where) == undisturbed


def test_killed_workers_and_a_file_locked_for_longer_than_sqlite_waits(
    tmp_path, undisturbed, unhurried
):
    where = tmp_path / "study.db"
    main = start("--store", where, "--workers", 2, **unhurried)
    for stored in (4, 12):
        wait_for(where, stored, main)
        workers = loky_workers(main)
        assert workers
        workers[0].kill()
    wait_for(where, 14, main)
    other = sqlite3.connect(where, timeout=30.0, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN EXCLUSIVE")
    release = threading.Timer(7.0, lambda: other.execute("ROLLBACK"))
    release.start()
    assert finish(main)["counts"] == {"done": RUNS}
    release.join()
    other.close()
    assert numbers(where) == undisturbed


def test_two_commands_share_postgres_one_is_killed_and_the_server_is_gone_for_a_while(
    postgres, postgres_url, undisturbed, unhurried
):
    both = [start("--store", postgres_url, "--workers", 1, **unhurried) for _ in range(2)]
    wait_for(postgres_url, 5, both[0])
    both[0].kill()
    both[0].wait()
    postgres.stop()
    time.sleep(4.0)
    assert both[1].poll() is None
    postgres.start()
    answer = finish(both[1])
    assert answer["counts"] == {"done": RUNS}
    assert answer["finished"] + answer["elsewhere"] + answer["found"] == RUNS
    assert numbers(postgres_url) == undisturbed


def test_full_disk(tmp_path, undisturbed):
    """On a small file system of memory, mounted for this process only, that is enlarged later."""
    disk, kept = tmp_path / "disk", tmp_path / "kept.db"
    disk.mkdir()
    where = disk / "study.db"
    command = f"{sys.executable} -m ematwin compare {' '.join(SMALL)} --store {where} --workers 1"
    script = f"""
        mount -t tmpfs -o size=60k ematwin {disk} || exit 90
        {command}; echo "first $?"
        mount -o remount,size=16m {disk}
        {command}; echo "second $?"
        cp {where} {kept}
    """
    space = ["unshare", "--mount"] if os.geteuid() == 0 else ["unshare", "-r", "--mount"]
    assert shutil.which("unshare")
    done = subprocess.run(
        [*space, "sh", "-c", script], capture_output=True, text=True, timeout=200, check=False
    )
    assert "first 2" in done.stdout, done.stdout + done.stderr
    assert "second 0" in done.stdout, done.stdout + done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 1
    assert "is full" in errors[0]
    assert "Traceback" not in done.stderr
    assert numbers(kept) == undisturbed


def test_runs_that_misbehave(tmp_path, saboteurs):
    where = tmp_path / "study.db"
    shape = ("--runs", 1, "--population", 8, "--iterations", 4, "--seed", 7)
    cases = tmp_path / "cases.toml"
    cases.write_text('[cases."Worn"]\nfriction = 0.3\nbacklash = 0.2\n')
    asked = ("--cases", cases, *shape)
    bad = ("--algorithms", "ga,raises,hangs,slow,nan,dies", "--time-limit", 1.5, "--patience", 2)
    bad = (*bad, "--workers", 2)
    answer = study(*asked, *bad, "--store", where, **saboteurs)
    assert answer["counts"] == {"done": 1, "failed": 2, "timeout": 2, "not finite": 1}
    ends = {one[0].algorithm: one[1] for one in numbers(where).values()}
    assert ends == {
        "ga": "done", "raises": "failed", "dies": "failed", "hangs": "timeout",
        "slow": "timeout", "nan": "not finite",
    }  # fmt: skip
    ((spec, _, faults, cost, *_, history),) = numbers(where, ["ga"]).values()
    alone = execute(spec)
    assert (alone.faults, repr(alone.cost), alone.history) == (faults, cost, history)

    again = study(*asked, *bad, "--store", where, **saboteurs)
    assert again["finished"] == 0, "failed runs are done again only when asked"
    repaired = study(
        *asked, *bad, "--retry-failed", "--store", where, SABOTEURS_REPAIRED="1", **saboteurs
    )
    assert repaired["finished"] == 5
    assert repaired["counts"] == {"done": 6}
