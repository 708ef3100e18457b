"""A fleet on many machines: a real PostgreSQL holds it, the workers of a Dask cluster judge."""

import tempfile
from datetime import UTC, datetime
from pathlib import Path

import pytest
from distributed import LocalCluster
from servers import Postgres

import ematwin
from ematwin import Fleet
from ematwin.errors import FileError, InputError
from ematwin.fleet.simulated import SimulatedFleet
from ematwin.fleet.store import FleetStore, row_of

END = datetime(2026, 1, 1, tzinfo=UTC)
SERVO = "sts3215"


@pytest.fixture(scope="module")
def postgres():
    with tempfile.TemporaryDirectory(prefix="ematwin-postgres-") as folder:
        server = Postgres(Path(folder))
        server.start()
        yield server
        server.stop()


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
    assert stores[0].rows("EMA-02").num_rows == stores[1].rows("EMA-02").num_rows
    before = stores[1].version()
    row = row_of("A", END, content="c", motion=0, twin="t", kind="k", grade="healthy")
    assert not stores[1].has("A", [row["id"]])
    stores[1].add([row])
    assert stores[1].has("A", [row["id"]])
    assert stores[1].version() != before


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
        made = ematwin_recording(day)
        inside = tmp_path / "recordings" / "S-1"
        inside.mkdir(parents=True, exist_ok=True)
        made.save(inside / f"2026-03-0{day}.parquet")
    (inside / "2026-03-09.csv").write_text("height\n1\n")
    on_server(tmp_path / "fleet", postgres.database("judged"))
    arguments = ("watch", "recordings", "--fleet", "fleet", "--actuator", SERVO)
    # a cluster in this process: all that it is given goes through its messages even so
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://",
                      dashboard_address=None) as cluster:  # fmt: skip
        answer = ematwin(*arguments, "--scheduler", cluster.scheduler_address)
    assert answer.code == 0, answer.err
    assert answer.out.startswith("2 recordings judged, 0 known before, 1 set aside.")
    again = ematwin(*arguments)  # on this machine
    assert again.out.startswith("0 recordings judged, 3 known before.")
    assert Fleet(tmp_path / "fleet")["S-1"].rows[0]["time"] == datetime(2026, 3, 1, tzinfo=UTC)


def ematwin_recording(seed):
    return ematwin.simulate(actuator=SERVO, noise=0.01, seed=seed)
