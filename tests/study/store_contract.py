"""Contract of the store of a study, over each of its databases."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import text

from ematwin.benchmarking.database import Database
from ematwin.benchmarking.plan import Plan
from ematwin.benchmarking.run import RunResult, RunSpec, StoredRun, pack
from ematwin.benchmarking.store import LEASE, Store, metadata, open_store
from ematwin.errors import FileError


def small_plan(**changes: object) -> Plan:
    """A plan with one case, two algorithms and three runs."""
    values = {
        "cases": {"Low F": (0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5)},
        "algorithms": ("ga", "pso"),
        "runs": 3,
        **changes,
    }
    return Plan(**values)  # type: ignore[arg-type]


def some_run(spec: RunSpec, status: str = "done") -> StoredRun:
    """A run that was not done, with numbers that are awkward to keep."""
    history = pack([10, *range(50, 400, 50)], [math.inf, *(1.0 / 3.0 / n for n in range(1, 8))])
    result = RunResult(
        spec.id, status, tuple(0.1 * n for n in range(8)), math.pi * 1e-300, 0.1, 1e17 / 3.0, 0.3,
        350, 1.25, 1.125, history, "budget", {"ematwin": "0", "engine": "none"},
    )  # fmt: skip
    return StoredRun(spec, result)


class StoreContract(ABC):
    """Subclass it, and give a fixture ``where`` with a path or URL of nothing yet."""

    @abstractmethod
    def where(self) -> str | Path:
        """Path or URL, as a fixture."""

    @pytest.fixture
    def specs(self) -> list[RunSpec]:
        """Six runs."""
        return small_plan().specs()

    @pytest.fixture
    def store(self, where: str | Path) -> Iterator[Store]:
        """A store with a study and no runs."""
        with Store(where) as store:
            store.begin(small_plan().settings())
            yield store

    def test_a_run_comes_back_as_it_was(self, store: Store, specs: list[RunSpec]) -> None:
        """Inputs, numbers and history are kept to the last bit."""
        one = some_run(specs[0])
        store.save([one])
        (back,) = store.runs()
        assert back == one
        del back.spec.__dict__["id"]
        assert back.spec.id == one.spec.id

    def test_nan_comes_back_as_nan(self, store: Store, specs: list[RunSpec]) -> None:
        """Of a run that failed there are no numbers."""
        store.save([StoredRun(specs[0], RunResult(specs[0].id, "failed", stopped="why \0 'so'"))])
        (back,) = store.runs()
        assert math.isnan(back.result.cost)
        assert math.isnan(back.result.err)
        assert back.result.history == b""

    def test_a_done_run_is_never_overwritten(self, store: Store, specs: list[RunSpec]) -> None:
        """The first result of a run stays."""
        one = some_run(specs[0])
        assert store.save([one]) == 1
        other = StoredRun(one.spec, replace(one.result, cost=2.0))
        assert store.save([other]) == 0
        assert [run.result.cost for run in store.runs()] == [one.result.cost]

    def test_a_failed_run_gives_way_to_a_done_one(self, store: Store, specs: list[RunSpec]) -> None:
        """Doing it again can mend it."""
        store.save([some_run(specs[0], "failed")])
        assert store.save([some_run(specs[0])]) == 1
        assert store.statuses() == {specs[0].id: "done"}

    def test_a_run_is_claimed_by_one_only(
        self, store: Store, where: str | Path, specs: list[RunSpec]
    ) -> None:
        """Two processes never do the same run."""
        ids = [spec.id for spec in specs]
        with Store(where, owner="elsewhere 1 x") as other:
            assert store.claim(ids[:4]) == set(ids[:4])
            assert other.claim(ids) == set(ids[4:])
            store.release()
            assert other.claim(ids[:2]) == set(ids[:2])

    def test_what_is_finished_cannot_be_claimed(self, store: Store, specs: list[RunSpec]) -> None:
        """Unless it failed and is to be done again."""
        store.save([some_run(specs[0]), some_run(specs[1], "timeout")])
        ids = [spec.id for spec in specs]
        assert store.claim(ids) == set(ids[2:])
        assert store.claim(ids, retry=True) == set(ids[1:])

    @pytest.mark.parametrize("by", [2.0, -86400.0], ids=["ours is late", "theirs was a day ahead"])
    def test_a_claim_that_is_not_renewed_lapses(
        self, store: Store, where: str | Path, specs: list[RunSpec], by: float,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:  # fmt: skip
        """One of tomorrow is not waited for, either: the clock that made it was wrong."""
        ids = [spec.id for spec in specs]
        with Store(where, owner="elsewhere 1 x") as other:
            other.claim(ids)
            assert not store.claim(ids)
            later = time.time() + (by * LEASE if by > 0.0 else by)
            monkeypatch.setattr("ematwin.benchmarking.store.time.time", lambda: later)
            assert store.claim(ids) == set(ids)

    def test_another_study_is_refused(self, store: Store, where: str | Path) -> None:
        """What changes the numbers of all runs makes another study."""
        for changed in (
            small_plan(population=40),
            small_plan(iterations=3),
            small_plan(seed=8),
            small_plan(box="remapped"),
        ):
            with (
                Store(where) as again,
                pytest.raises(FileError, match=r"another study.*Give another --store"),
            ):
                again.begin(changed.settings())

    def test_more_runs_and_algorithms_are_the_same_study(
        self, store: Store, where: str | Path
    ) -> None:
        """A study may grow."""
        with Store(where) as again:
            again.begin(small_plan(runs=9, algorithms=("ga", "de")).settings())

    @pytest.mark.parametrize("schema", ["99", "1", "2"])
    def test_another_schema_is_refused(self, store: Store, where: str | Path, schema: str) -> None:
        """A store of a newer ematwin is not touched, nor is one without checksums."""
        _execute(where, f"UPDATE ematwin_study SET value = '{schema}' WHERE key = 'schema'")
        with pytest.raises(FileError, match=f"has schema {schema}"):
            open_store(where)

    @pytest.mark.parametrize(
        "change",
        ["status = 'failed'", "body = replace(body, '350', '351')", "id = 'other'"],
    )
    def test_a_changed_run_is_named(
        self, store: Store, where: str | Path, specs: list[RunSpec], change: str
    ) -> None:
        """Whatever was changed, the store is refused."""
        store.save([some_run(spec) for spec in specs])
        _execute(where, f"UPDATE ematwin_runs SET {change} WHERE id = '{specs[2].id}'")
        with pytest.raises(FileError, match=rf"damaged: run ({specs[2].id}|other) differs"):
            list(store.runs())

    def test_changed_settings_are_noticed(
        self, store: Store, where: str | Path, specs: list[RunSpec]
    ) -> None:
        """They hold for every run."""
        store.save([some_run(specs[0])])
        store.close()
        _execute(where, "UPDATE ematwin_study SET value = replace(value, '200', '300')")
        with pytest.raises(FileError, match="settings differs"):
            open_store(where)

    def test_other_tables_are_left_alone(self, store: Store, where: str | Path) -> None:
        """A database of something else is refused."""
        names = [table.name for table in metadata.sorted_tables]
        for name in names:
            _execute(where, f"DROP TABLE {name}")
        _execute(where, "CREATE TABLE customers (id INTEGER)")
        with pytest.raises(FileError, match=r"not a study store.*customers"):
            Store(where)
        _execute(where, "DROP TABLE customers")

    def test_runs_can_be_saved_while_others_are_read(
        self, store: Store, where: str | Path, specs: list[RunSpec]
    ) -> None:
        """A report does not stop a study."""
        store.save([some_run(spec) for spec in specs[:3]])
        with Store(where) as reader:
            reading = reader.runs()
            next(reading)
            store.save([some_run(specs[3])])
            assert len(list(reading)) >= 2


def _execute(where: str | Path, statement: str) -> None:
    """Change the database behind the store's back."""
    database = Database(where)
    try:
        database.write(lambda connection: connection.execute(text(statement)))
    finally:
        database.close()
