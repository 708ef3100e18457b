"""The store of a study over both databases; damage; stores of earlier versions."""

import ctypes
import math
import random
import shutil
import signal
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import text
from synthetic import small_plan, some_run, stored

from ematwin.benchmarking.database import Database
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.plan import Plan, Run
from ematwin.benchmarking.store import LEASE, Store, metadata, open_store
from ematwin.benchmarking.subject import cases_of
from ematwin.errors import EmatwinError, FileError
from refusals import refused

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(params=["sqlite", "postgres"])
def where(request, tmp_path):
    """Path or URL of nothing yet."""
    if request.param == "sqlite":
        return tmp_path / "study.db"
    return request.getfixturevalue("postgres_url")


@pytest.fixture
def specs():
    return small_plan().specs()


@pytest.fixture
def store(where):
    with Store(where) as store:
        store.begin(small_plan().settings())
        yield store


def test_a_run_comes_back_as_it_was(store, specs):
    one = some_run(specs[0])
    store.save([one, Run(specs[1], "failed", stopped="why \0 'so'")])
    back, failed = sorted(store.runs(), key=lambda run: run.status)
    assert back == one
    del back.spec.__dict__["id"]
    assert back.spec.id == one.spec.id
    assert math.isnan(failed.cost)
    assert math.isnan(failed.err)
    assert failed.history == b""


def test_a_done_run_is_never_overwritten_and_a_failed_one_gives_way_to_it(store, specs):
    one = some_run(specs[0])
    for run in (some_run(specs[0], "failed"), one, replace(one, cost=2.0)):
        store.save([run])
    assert [(run.status, run.cost) for run in store.runs()] == [("done", one.cost)]


def test_a_run_is_claimed_by_one_only(store, where, specs):
    ids = [spec.id for spec in specs]
    with Store(where) as other:
        assert store.claim(ids[:4]) == set(ids[:4])
        assert other.claim(ids) == set(ids[4:])
        store.release()
        assert other.claim(ids[:2]) == set(ids[:2])


def test_what_is_finished_cannot_be_claimed(store, specs):
    store.save([some_run(specs[0]), some_run(specs[1], "timeout")])
    ids = [spec.id for spec in specs]
    assert store.claim(ids) == set(ids[2:])
    assert store.claim(ids, retry=True) == set(ids[1:])


@pytest.mark.parametrize("by", [2.0, -86400.0], ids=["ours is late", "theirs was a day ahead"])
def test_a_claim_that_is_not_renewed_lapses(store, where, specs, by, monkeypatch):
    """One of tomorrow is not waited for, either: the clock that made it was wrong."""
    ids = [spec.id for spec in specs]
    with Store(where) as other:
        other.claim(ids)
        assert not store.claim(ids)
        later = time.time() + (by * LEASE if by > 0.0 else by)
        monkeypatch.setattr("ematwin.benchmarking.store.time.time", lambda: later)
        assert store.claim(ids) == set(ids)


def test_another_study_is_refused(store, where):
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


def test_more_runs_and_algorithms_are_the_same_study(store, where):
    with Store(where) as again:
        again.begin(small_plan(runs=9, algorithms=("ga", "de")).settings())


@pytest.mark.parametrize("schema", ["99", "1", "2"])
def test_another_schema_is_refused(store, where, schema):
    """A store of a newer ematwin is not touched, nor is one without checksums."""
    _execute(where, f"UPDATE ematwin_study SET value = '{schema}' WHERE key = 'schema'")
    with pytest.raises(FileError, match=f"has schema {schema}"):
        open_store(where)


@pytest.mark.parametrize(
    "change",
    ["status = 'failed'", "body = replace(body, '350', '351')", "id = 'other'"],
)
def test_a_changed_run_is_named(store, where, specs, change):
    store.save([some_run(spec) for spec in specs])
    _execute(where, f"UPDATE ematwin_runs SET {change} WHERE id = '{specs[2].id}'")
    with pytest.raises(FileError, match=rf"damaged: run ({specs[2].id}|other) differs"):
        list(store.runs())


def test_changed_settings_are_noticed(store, where, specs):
    store.save([some_run(specs[0])])
    store.close()
    _execute(where, "UPDATE ematwin_study SET value = replace(value, '200', '300')")
    with pytest.raises(FileError, match="settings differs"):
        open_store(where)


def test_other_tables_are_left_alone(store, where):
    names = [table.name for table in metadata.sorted_tables]
    for name in names:
        _execute(where, f"DROP TABLE {name}")
    _execute(where, "CREATE TABLE customers (id INTEGER)")
    with pytest.raises(FileError, match=r"not a study store.*customers"):
        Store(where)
    _execute(where, "DROP TABLE customers")


def test_runs_can_be_saved_while_others_are_read(store, where, specs):
    store.save([some_run(spec) for spec in specs[:3]])
    with Store(where) as reader:
        reading = reader.runs()
        next(reading)
        store.save([some_run(specs[3])])
        assert len(list(reading)) >= 2


def _execute(where, statement):
    """Change the database behind the store's back."""
    database = Database(where)
    try:
        database.write(lambda connection: connection.execute(text(statement)))
    finally:
        database.close()


def content(path):
    with open_store(path, patience=0.0) as store:
        return store.settings(), store.statuses(), list(store.runs())


def test_an_interrupted_transaction_locks_nobody_out(tmp_path):
    """Ctrl-C within a statement that returns rows: the next transaction need not wait."""
    where = tmp_path / "some.db"
    database = Database(where, patience=0.0)
    database.write(lambda connection: connection.exec_driver_sql("CREATE TABLE t (x INTEGER)"))

    def interrupted(connection):
        driver = connection.connection.driver_connection
        # a signal that Python sees once the driver is back, as it is with the user's
        strike = partial(ctypes.CDLL(None)["raise"], int(signal.SIGINT))
        driver.create_function("interrupt", 0, strike)
        connection.exec_driver_sql("INSERT INTO t VALUES (1) RETURNING interrupt()")

    with pytest.raises(KeyboardInterrupt) as kept:  # and its frames with it
        database.write(interrupted)
    database.write(lambda connection: connection.exec_driver_sql("INSERT INTO t VALUES (2)"))
    found = database.read(lambda connection: connection.exec_driver_sql("SELECT x FROM t").all())
    assert [x for (x,) in found] == [2]
    assert kept.tb is not None
    database.close()


def test_no_flipped_bit_goes_unseen(tmp_path):
    """Such a store is read as it was, where the bit was in free space, or refused."""
    runs = [some_run(spec) for spec in small_plan(runs=20).specs()]
    path = stored(tmp_path / "study.db", runs)
    whole, before = path.read_bytes(), content(path)
    chance, said = random.Random(1), []
    for _ in range(60):
        changed = bytearray(whole)
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
        path.write_bytes(changed)
        try:
            assert content(path) == before
        except EmatwinError as error:
            said.append(str(error))
        assert path.read_bytes() == changed
    assert len(said) > 20
    assert [one for one in said if "\n" in one] == []
    assert all("is damaged" in one or "another kind of file" in one for one in said)


def test_check_tells_whether_a_store_is_whole(tmp_path, ematwin):
    path = stored(tmp_path / "study.db", [some_run(spec) for spec in small_plan().specs()])
    assert "6 runs, all as they were written" in ematwin("store", "check", path).out
    whole = path.read_bytes()
    place = whole.rindex(b"budget") + 2
    path.write_bytes(whole[:place] + b"x" + whole[place + 1 :])
    refused(ematwin("store", "check", path), "is damaged: run .*Put a copy in its place")


@pytest.mark.parametrize(("version", "schema"), [("0.1", 1), ("0.2", 2)])
def test_stores_of_earlier_versions_are_refused_in_a_sentence(version, schema, tmp_path, ematwin):
    path = Path(shutil.copy(DATA / version / "study.db", tmp_path / "study.db"))
    whole = path.read_bytes()
    said = f"has schema {schema}, and this ematwin knows schema 3"
    refused(ematwin("report", path), said)
    refused(ematwin("compare", "--runs", 1, "--store", path), said)
    assert path.read_bytes() == whole


# ematwin compare --algorithms multistart,random --runs 1 --population 10 --iterations 30
#     --scenario step, by 0.2: ids, and what the two found on Low B
FOUND_BY_0_2 = {
    "10b38f14c0b42ee1a5f6e673": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5),  # multistart
    "373773c389e162fb92cb5677": (  # random
        0.1348, 0.1308, 0.0861, 0.2781, 0.2216, 0.1721, 0.5765, 0.8268,
    ),
}  # fmt: skip


def test_runs_of_0_2_come_out_alike_when_done_again():
    plan = Plan(
        cases_of("paper"), ("multistart", "random"), runs=1, population=10, iterations=30,
        scenario="step",
    )  # fmt: skip
    for spec in plan.specs()[4:6]:
        result = execute(spec)
        assert result.spec.id in FOUND_BY_0_2
        assert result.faults == pytest.approx(FOUND_BY_0_2[result.spec.id], abs=1e-3)
