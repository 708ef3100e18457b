"""Studies as processes, an empty database for each, and algorithms that misbehave."""

import os

import pytest
from processes import RUNS, numbers, study

from own_model import installed
from shared import made_once


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """The small study, done by one process in peace."""

    def done(where):
        assert study("--store", where, "--workers", 1)["counts"] == {"done": RUNS}

    return numbers(made_once(tmp_path_factory, "undisturbed.db", done))


@pytest.fixture
def postgres_url(postgres, request):
    """An empty database for one test."""
    return postgres.database(f"test_{abs(hash(request.node.nodeid))}")


UNHURRIED = """
import time
from ematwin.benchmarking import execute, store

store.LEASE = 5.0
_prepared = execute._prepared

def _slowly(spec):
    time.sleep(0.1)
    return _prepared(spec)

execute._prepared = _slowly
"""


@pytest.fixture
def unhurried(tmp_path):
    """Environment in which a study lasts long enough to be disturbed, without more to compute.

    A claim lapses after five seconds, not half a minute.
    """
    folder = tmp_path / "unhurried"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(UNHURRIED)
    return {"PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}


SABOTEURS = """
import os, signal, time
import numpy as np
from ematwin.optimizers.differential_evolution import DifferentialEvolution

def _sound():
    return os.environ.get("SABOTEURS_REPAIRED") == "1"

class Raises(DifferentialEvolution):
    def ask(self):
        if not _sound():
            raise RuntimeError("broken on purpose")
        return super().ask()

class Hangs(DifferentialEvolution):
    def ask(self):
        while not _sound():
            time.sleep(3600.0)
        return super().ask()

class Slow(DifferentialEvolution):
    def ask(self):
        if not _sound():
            time.sleep(1.0)
        return super().ask()

class Dies(DifferentialEvolution):
    def ask(self):
        if not _sound():
            os.kill(os.getpid(), signal.SIGKILL)
        return super().ask()

class Nan(DifferentialEvolution):
    def ask(self):
        self.asked = super().ask()
        return self.asked if _sound() else np.full_like(self.asked, np.nan)

    def tell(self, points, costs):
        super().tell(self.asked[:len(costs)], costs)
"""


@pytest.fixture
def saboteurs(tmp_path):
    """Environment in which five algorithms are installed that misbehave."""
    folder = tmp_path / "site"
    names = ("Raises", "Hangs", "Slow", "Dies", "Nan")
    points = "\n".join(f"{name.lower()} = saboteurs:{name}" for name in names)
    installed(folder, "saboteurs", optimizers=points)
    (folder / "saboteurs.py").write_text(SABOTEURS)
    return {"PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}
