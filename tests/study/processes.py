"""Studies as processes: start them, wait for them, compare what they stored."""

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from ematwin.benchmarking.store import open_store

SMALL = (
    "--cases", "paper", "--algorithms", "ga,pso", "--runs", "2", "--population", "8",
    "--iterations", "4", "--seed", "7", "--scenario", str(Path(__file__).with_name("half.toml")),
)  # fmt: skip
RUNS = 40  # of the study above


def free_port():
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start(*arguments, **environment):
    """Start ``ematwin compare`` with a small study."""
    return subprocess.Popen(
        [sys.executable, "-m", "ematwin", "compare", *SMALL, *map(str, arguments), "--json"],
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process, code=0):
    """What a study answered; fails unless it ended with ``code``."""
    out, err = process.communicate(timeout=1800)  # a busy machine needs long
    assert process.returncode == code, f"{out}\n{err}"
    if code:
        sentence = [line for line in err.splitlines() if line.startswith("Error: ")]
        assert len(sentence) == 1, err
        assert "Traceback" not in err
        return {"error": sentence[0]}
    answer: dict[str, Any] = json.loads(out)
    return answer


def study(*arguments, code=0, **environment):
    """Run a small study to its end."""
    return finish(start(*arguments, **environment), code)


def numbers(where, algorithms=()):
    """Ids of the finished runs and all numbers that must not depend on how they were done."""
    with open_store(where) as store:
        return {
            one.spec.id: (
                one.spec, one.status, one.faults, repr(one.cost),
                repr(one.err), one.evaluations, one.history,
            )
            for one in store.runs()
            if not algorithms or one.spec.algorithm in algorithms
        }  # fmt: skip


def wait_for(where, count, process):
    """Wait until a study has stored so many runs."""
    end = time.monotonic() + 600.0
    while time.monotonic() < end:
        if process.poll() is not None:
            raise AssertionError(f"it ended before it could be disturbed: {process.stderr.read()}")
        try:
            with open_store(where) as store:
                if len(store.statuses()) >= count:
                    return
        except OSError:  # not begun yet
            pass
        time.sleep(0.05)
    raise AssertionError("the study did not get on")
