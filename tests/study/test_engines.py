"""Processes of the local engine."""

import os
from pathlib import Path

import pytest

from ematwin.comparison.study.engines.base import EngineError
from ematwin.comparison.study.engines.local import LocalEngine
from ematwin.testing.store_contract import small_plan


def test_a_worker_whose_memory_grew_by_compiling_is_not_replaced(
    saboteurs: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes = tmp_path / "processes"
    monkeypatch.syspath_prepend(saboteurs["PYTHONPATH"].split(os.pathsep)[0])
    monkeypatch.setenv("SABOTEURS_NOTES", str(notes))
    plan = small_plan(algorithms=("grows",), runs=4, population=8, iterations=1)
    engine = LocalEngine(1)
    engine.start()
    try:
        for spec in plan.specs():
            engine.submit(spec)
            results = []
            while engine.busy:
                results += engine.finished(1.0)
            assert [result.status for result in results] == ["done"], results
    finally:
        engine.close()
    processes = notes.read_text().split()
    assert len(processes) == 4
    assert len(set(processes)) == 1


def test_workers_that_die_as_soon_as_they_start_are_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four deaths in a row, then one that lives."""
    left = _deadly(tmp_path, monkeypatch, deaths=4)
    engine = LocalEngine(1, patience=20.0)
    try:
        engine.start()
        assert not left.read_text()
    finally:
        engine.close()


def test_workers_that_go_on_dying_are_given_up_after_the_stated_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _deadly(tmp_path, monkeypatch, deaths=1000)
    engine = LocalEngine(1, patience=1.0)
    with pytest.raises(EngineError, match=r"die as soon as they start.*Finished runs are kept"):
        engine.start()


def _deadly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, deaths: int) -> Path:
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
