"""Processes of the local engine."""

import os
from pathlib import Path

import pytest

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
