"""Processes of the local engine."""

import os

import pytest

from ematwin.benchmarking.engine import EngineError, LocalEngine


def test_workers_that_die_as_soon_as_they_start_are_started_again(tmp_path, monkeypatch):
    """Four deaths in a row, then one that lives."""
    left = _deadly(tmp_path, monkeypatch, deaths=4)
    engine = LocalEngine(1, patience=20.0)
    try:
        engine.start()
        assert not left.read_text()
    finally:
        engine.close()


def test_workers_that_go_on_dying_are_given_up_after_the_stated_time(tmp_path, monkeypatch):
    _deadly(tmp_path, monkeypatch, deaths=1000)
    engine = LocalEngine(1, patience=1.0)
    with pytest.raises(EngineError, match=r"die as soon as they start.*Finished runs are kept"):
        engine.start()


def _deadly(tmp_path, monkeypatch, deaths):
    """Processes of loky that die when they start, as many as there are letters in a file."""
    left = tmp_path / "left"
    left.write_text("x" * deaths)
    (tmp_path / "sitecustomize.py").write_text(
        "import os, pathlib, sys\n"
        f"left = pathlib.Path({str(left)!r})\n"
        "if any('popen_loky' in part for part in sys.orig_argv) and left.read_text():\n"
        "    left.write_text(left.read_text()[1:])\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    return left
