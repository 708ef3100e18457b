"""A fleet on many machines: a real PostgreSQL holds it, the workers of a Dask cluster judge."""

import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import pytest
from distributed import LocalCluster

import ematwin
from ematwin import Fleet
from ematwin.errors import FileError, InputError
from ematwin.fleet.serve import FleetServer
from ematwin.fleet.simulated import SimulatedFleet
from ematwin.fleet.store import FleetStore, row_of
from ematwin.fleet.watch import watch

END = datetime(2026, 1, 1, tzinfo=UTC)
SERVO = "sts3215"


def on_server(folder, url):
    folder.mkdir()
    (folder / "fleet.toml").write_text(f'store = "{url}"\n')
    return FleetStore(folder)


def test_a_database_answers_as_the_folder_does(postgres, tmp_path):
    url = postgres.database("same")
    made = SimulatedFleet(2, 1.0, 20.0, seed=7, end=END)
    stores = [FleetStore(tmp_path / "files"), on_server(tmp_path / "tables", url)]
    for store in stores:
        made.fill(store)
        made.fill(store)  # twice is once
        store.note("EMA-01", "overhaul", END, note="x")
        store.note("EMA-01", "overhaul", END, note="x")
        store.merge()
    files, tables = (store.rows().drop_columns(["judged"]).to_pylist() for store in stores)
    assert files == tables
    assert stores[0].events() == stores[1].events()
    recipe = (Path(__file__).parents[2] / "docs/fleet.md").read_text("utf-8")  # for Grafana
    query = recipe.partition("```sql\n")[2].partition("```")[0]
    shown = stores[1]._database.read(lambda c: c.exec_driver_sql(query).all())
    for unit in Fleet(tmp_path / "files", now=END):
        values = [value for _, serial, value in shown if serial == unit.serial_number]
        assert values == unit.series("friction").value.tolist()
    before = stores[1].version()
    row = row_of("A", END, content="c", motion=0, twin="t", kind="k", grade="healthy")
    assert not stores[1].has("A", [row["id"]])
    stores[1].add([row])
    assert stores[1].has("A", [row["id"]])
    assert stores[1].version() != before


@pytest.mark.parametrize("kept", ["folder", "database"])
def test_a_killed_watch_loses_nothing_and_two_do_nothing_twice(postgres, tmp_path, kept):
    for day in range(1, 5):
        recording(tmp_path / "recordings" / "S-1", day)
    if kept == "database":
        url = postgres.database("two")
        stores = [on_server(tmp_path / name, url) for name in ("one", "two")]
    else:
        stores = [FleetStore(tmp_path / "one") for _ in range(2)]
    command = ("watch", "recordings", "--fleet", "one", "--actuator", SERVO)
    with open(tmp_path / "said", "wb") as said:
        killed = subprocess.Popen(
            [sys.executable, "-m", "ematwin", *command], cwd=tmp_path, stdout=said, stderr=said
        )
    patience = time.monotonic() + 120.0
    while not stores[0].rows().num_rows and killed.poll() is None and time.monotonic() < patience:
        time.sleep(0.02)
    killed.kill()
    killed.wait()
    before = stores[0].rows()["id"].to_pylist()
    assert before, (tmp_path / "said").read_text()
    with ThreadPoolExecutor(2) as both:
        work = partial(watch, recordings=tmp_path / "recordings", actuator=SERVO)
        found = list(both.map(work, stores))
    rows = stores[1].rows()
    assert set(before) <= set(rows["id"].to_pylist())
    assert [f"{when:%d}" for when in rows["time"].to_pylist()] == [f"0{n}" for n in range(1, 5)]
    assert [one.judged + one.known for one in found] == [4, 4]
    with FleetServer(Fleet(stores[1].folder)) as server:
        assert 'href="S-1"' in server.page("")
        stores[0].note("S-1", "overhaul", datetime(2026, 3, 5, tzinfo=UTC), note="new gear")
        assert "new gear" in server.page("S-1")  # as another machine has just entered it


def test_another_machine_reads_rows_and_twins_from_the_database(postgres, tmp_path):
    url = postgres.database("shared")
    SimulatedFleet(2, 1.0, 20.0, seed=7, end=END).fill(on_server(tmp_path / "one", url))
    on_server(tmp_path / "two", url)
    with (tmp_path / "two" / "fleet.toml").open("a") as file:
        file.write('[limits]\nfriction = "0.2 N*m"\n')
    fleet = Fleet(tmp_path / "two", now=END)
    assert [one.serial_number for one in fleet] == ["EMA-01", "EMA-02"]
    assert fleet["EMA-01"].life_left("friction") is not None  # needs its twin


@pytest.mark.parametrize(
    ("store", "error", "said"),
    [
        ("fleet.db", InputError, "postgresql://user@host/name, received 'fleet.db'"),
        ("mysql://a/b", InputError, "received mysql://"),
        ("postgresql://nobody@127.0.0.1:1/x", FileError, "cannot be used"),
    ],
)
def test_a_store_that_cannot_be_used_is_refused(tmp_path, monkeypatch, store, error, said):
    monkeypatch.setattr("ematwin.fleet.tables.PATIENCE", 0.0)
    with pytest.raises(error, match=said):
        on_server(tmp_path / "fleet", store)


def test_a_cluster_judges_into_the_database(postgres, tmp_path, ematwin):
    for day in range(1, 3):
        recording(tmp_path / "recordings" / "S-1", day)
    (tmp_path / "recordings" / "S-1" / "2026-03-09.csv").write_text("height\n1\n")
    on_server(tmp_path / "fleet", postgres.database("judged"))
    arguments = ("watch", "recordings", "--fleet", "fleet", "--actuator", SERVO)
    # a cluster in this process: all that it is given goes through its messages even so
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://",
                      dashboard_address=None) as cluster:  # fmt: skip
        answer = ematwin(*arguments, "--scheduler", cluster.scheduler_address)
    assert answer.code == 0, answer.err
    assert answer.out.startswith("2 recordings judged, 0 known before, 1 set aside.")
    again = ematwin(*arguments)  # on this machine
    assert again.out.startswith("0 recordings judged, 3 known before")
    assert Fleet(tmp_path / "fleet")["S-1"].rows[0]["time"] == datetime(2026, 3, 1, tzinfo=UTC)


def recording(folder, day):
    folder.mkdir(parents=True, exist_ok=True)
    made = ematwin.simulate(actuator=SERVO, noise=0.01, seed=day)
    made.save(folder / f"2026-03-0{day}.parquet")
