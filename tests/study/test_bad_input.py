"""What cannot be used is refused in one sentence, with exit code 2, and touches nothing."""

import os
import sys
from functools import partial

import pytest
from processes import free_port
from synthetic import small_plan, some_run, stored

from ematwin.benchmarking.store import open_store
from refusals import untouched


@pytest.fixture
def refused(tmp_path):
    """``ematwin compare`` refuses some arguments with a sentence that says this."""
    return partial(untouched, tmp_path, "compare")


@pytest.fixture
def begun(tmp_path):
    """The store of a study with one run."""
    plan = small_plan()
    return stored(tmp_path / "study.db", [some_run(plan.specs()[0])], plan.settings())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--cases", "papers"), "no cases 'papers'"),
        (("--cases", "missing.toml"), "Cannot read the cases file missing.toml"),
        (("--count", "5"), "--count belongs to --cases multi"),
        (("--cases", "multi", "--count", "0"), "at least 1, received 0"),
        (("--algorithms", "ga,psoo"), "no algorithm 'psoo'. Did you mean pso"),
        (("--algorithms", ","), "at least one case and one algorithm"),
        (("--runs", "0"), "--runs must be a whole number of at least 1, received 0"),
        (("--population", "-5"), "--population must be a whole number of at least 1"),
        (("--seed", "-1"), "whole number of at least 0, received -1"),
        (("--box", "round"), "no box 'round'; choose plain or remapped"),
        (("--engine", "spark"), "no engine 'spark'; choose local or dask"),
        (("--engine", "local", "--scheduler", "tcp://a:1"), "--scheduler belongs to"),
        (("--scheduler", "tcp://a:1", "--workers", "2"), "has its own workers"),
        (("--time-limit", "0"), "--time-limit must be a positive number"),
        (("--store", "mysql://root@host/db"), "received mysql://"),
        (("--store", "."), "is a folder"),
        (("--store", "missing/study.db"), "folder missing is missing or read-only"),
        (("--workers", "0"), "--workers"),
        (("--noise", "pink=1"), "Noise knows"),
        (("--actuator", "rm1606"), "no actuator 'rm1606'. Did you mean rm1605"),
        (("--actuator", "rm1605", "--cases", "paper"), "--cases paper is for the kind bldc"),
        (("--actuator", "rm1605", "--scenario", "step"), "no scenario 'step'"),
        (
            ("--algorithms", "multistart", "--population", "5", "--iterations", "5"),
            "at least 64, received 25",
        ),
    ],
)
def test_impossible_arguments(refused, arguments, sentence):
    refused(*arguments, said=sentence)


def test_a_scheduler_that_does_not_answer(refused):
    refused("--scheduler", f"tcp://127.0.0.1:{free_port()}", said="does not answer")
    refused("--scheduler", "nonsense://here", said="does not answer")


def test_a_postgres_that_does_not_answer(refused):
    url = f"postgresql://me:secret@127.0.0.1:{free_port()}/db"
    refused("--store", url, said=r"^(?!.*secret).*cannot be used")


def test_a_file_of_another_kind(refused, tmp_path):
    notes = tmp_path / "notes.txt"
    notes.write_text("bought milk")
    refused("--store", notes, said="another kind of file")


def test_a_different_study(refused, begun):
    refused("--store", begun, "--population", 40, said="its population is 50, received 40")
    refused("--store", begun, "--box", "remapped", said="its box is plain, received remapped")
    refused("--store", begun, "--noise", "white=0.02", said="its noise is None")


def test_a_read_only_folder(refused, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    refused("--store", tmp_path / "study.db", said="missing or read-only")


@pytest.mark.parametrize(
    ("module", "arguments", "command"),
    [
        ("distributed", ("--engine", "dask"), 'pip install "ematwin[dask]"'),
        ("psycopg", ("--store", "postgresql://a/b"), 'pip install "ematwin[postgres]"'),
    ],
)
def test_extras_that_are_not_installed(refused, monkeypatch, module, arguments, command):
    monkeypatch.setitem(sys.modules, module, None)
    refused(*arguments, said=command)


def test_reading_what_is_not_there(tmp_path):
    with pytest.raises(OSError, match="There is no study in"):
        open_store(tmp_path / "study.db")
    assert not (tmp_path / "study.db").exists()
