"""The store of a study: every finished run, and who is doing which of the others.

A run is one row under the hash of its inputs: its status, its values as JSON, its history, and a
checksum of these three; one that is done is never overwritten. What all runs share are the
settings of the study, kept once. A process claims runs before it does them, so that several can
share a study. A claim holds for `LEASE` seconds and is renewed; one that was not renewed is void,
and doing its run twice does no harm, because both give the same numbers.

Reading verifies: SQLite's structure when a store is opened, each row by its checksum. A
store that is not as it was written is refused.
"""

import hashlib
import json
import os
import socket
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import sqlalchemy as sql
from sqlalchemy import Column, Connection, String, Table, Text, delete, select
from sqlalchemy.dialects import postgresql, sqlite

from ematwin.benchmarking.database import DamagedError, Database
from ematwin.benchmarking.plan import SHARED, Run, RunSpec
from ematwin.errors import FileError

LEASE = 30.0  # s for which a claim holds without being renewed
FORMAT = "ematwin study"
SCHEMA = 3  # of the tables below

metadata = sql.MetaData()
_study = Table(
    "ematwin_study",
    metadata,
    Column("key", String(40), primary_key=True),  # format, schema, settings, checksum
    Column("value", Text, nullable=False),
)
_runs = Table(
    "ematwin_runs",
    metadata,
    Column("id", String(24), primary_key=True),
    Column("status", String(16), nullable=False),
    Column("body", Text, nullable=False),  # JSON, in ASCII
    Column("history", sql.LargeBinary, nullable=False),  # ematwin.benchmarking.plan.pack
    Column("checksum", String(24), nullable=False),
    sql.Index("ematwin_runs_status", "id", "status"),  # resuming reads this, not the histories
)
_claims = Table(
    "ematwin_claims",
    metadata,
    Column("id", String(24), primary_key=True),  # of a run that somebody is doing
    Column("owner", Text, nullable=False),
    Column("until", sql.Double, nullable=False),  # s since 1970; after it the claim is void
)


def open_store(where: str | Path, *, patience: float = 120.0) -> "Store":
    """Open the store of a study, or raise `FileError` if none was begun there."""
    store = Store(where, patience=patience)
    if not store.begun:
        store.close()
        raise FileError(
            f"There is no study in {store.name}. Run one with: ematwin compare --store {store.name}"
        )
    return store


class Store:
    """A study in a SQLite file or a PostgreSQL database.

    Opening looks but does not touch; `begin` makes the tables where there are none. One that is
    damaged, another kind of database or of another schema is refused with a `FileError`.
    ``where`` and ``patience`` are as of `Database`.
    """

    def __init__(self, where: str | Path, *, patience: float = 120.0) -> None:
        self._database = Database(where, patience)
        self.name = self._database.name
        # of this process among the claims
        self.owner = f"{socket.gethostname()} {os.getpid()} {uuid.uuid4().hex[:12]}"
        self._ours = _claims.c.owner == self.owner
        self._database.check_whole()
        self.begun = self._database.exists and self._database.read(self._look, patient=False)

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    def settings(self) -> dict[str, Any]:
        """Give what all runs share, see `ematwin.benchmarking.plan.Plan.settings`."""
        return json.loads(self._database.read(self._said)["settings"])

    def check(self, settings: Mapping[str, Any]) -> None:
        """Raise `FileError` if this cannot be the store of a study with these settings."""
        self._database.check_writable()
        if self.begun:
            _check_same(self.settings(), settings, self.name)

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Make the tables, or check that the study in them is this one."""
        self.check(settings)

        def work(connection: Connection) -> None:
            if self._database.is_server:
                connection.exec_driver_sql("SELECT pg_advisory_xact_lock(1701667188)")
            if self._look(connection):
                _check_same(json.loads(self._said(connection)["settings"]), settings, self.name)
                return
            metadata.create_all(connection)
            text = json.dumps(settings, sort_keys=True)
            said = {"format": FORMAT, "schema": str(SCHEMA), "settings": text}
            said["checksum"] = _study_checksum(said)
            pairs = [{"key": key, "value": value} for key, value in said.items()]
            connection.execute(_study.insert(), pairs)

        self._database.write(work)
        self.begun = True

    def statuses(self) -> dict[str, str]:
        """Give ids of the finished runs and how they ended; histories stay where they are."""
        query = select(_runs.c.id, _runs.c.status)
        return self._database.read(
            lambda connection: {id: status for id, status in connection.execute(query)}
        )

    def runs(self) -> Iterator[Run]:
        """Yield all finished runs, by id; one that is not as it was written is refused by name."""
        settings = self.settings()
        shared = {name: settings[name] for name in SHARED}
        query = select(_runs).order_by(_runs.c.id).limit(1000)

        def after(last: str) -> list[Run]:
            rows = query.where(_runs.c.id > last)
            return self._database.read(lambda c: [_run_of(row, shared) for row in c.execute(rows)])

        page = after("")  # by pages: between them others may write
        while page:
            yield from page
            page = after(page[-1].spec.id)

    def save(self, finished: Sequence[Run]) -> None:
        """Keep runs and give up their claims; a run that is done already stays as it was."""
        if not finished:
            return
        query = self._insert(_runs)
        query = query.on_conflict_do_update(
            index_elements=["id"],
            set_={column.name: query.excluded[column.name] for column in _runs.c},
            where=_runs.c.status != "done",
        )
        rows = [_row_of(one) for one in finished]
        claimed = _claims.c.id.in_([one.spec.id for one in finished])

        def work(connection: Connection) -> None:
            connection.execute(query, rows)
            connection.execute(delete(_claims).where(claimed, self._ours))

        self._database.write(work)

    def claim(self, ids: Sequence[str], retry: bool = False) -> set[str]:
        """Claim runs for this process; ``retry``: also those that ended otherwise than done.

        Gives those that are ours now: neither finished, nor claimed by another process.
        """
        held = _claims.c
        finished = select(_runs.c.id).where(_runs.c.id.in_(ids))
        if retry:
            finished = finished.where(_runs.c.status == "done")

        def work(connection: Connection) -> set[str]:
            now = time.time()
            # a claim of far in the future was made by a clock that is wrong
            void = sql.or_(held.until < now, held.until > now + 2.0 * LEASE)
            query = self._insert(_claims)
            query = query.on_conflict_do_update(
                index_elements=["id"],
                set_={"owner": query.excluded.owner, "until": query.excluded.until},
                where=sql.or_(self._ours, void),
            ).returning(held.id)
            asked = [{"id": id, "owner": self.owner, "until": now + LEASE} for id in ids]
            won = set(connection.execute(query, asked).scalars())
            # asked after the claims stand: a run may have been saved meanwhile
            done = set(connection.execute(finished).scalars())
            connection.execute(delete(_claims).where(held.id.in_(done), self._ours))
            return won - done

        return self._database.write(work)

    def renew(self) -> None:
        """Make the claims of this process hold for another while."""
        query = sql.update(_claims).where(self._ours)
        self._database.write(lambda c: c.execute(query.values(until=time.time() + LEASE)))

    def release(self) -> None:
        """Give up all claims of this process."""
        query = delete(_claims).where(self._ours)
        self._database.write(lambda connection: connection.execute(query))

    def _look(self, connection: Connection) -> bool:
        """Whether a study has been begun here; raise unless it is ours to read."""
        tables = set(sql.inspect(connection).get_table_names())
        if not tables:
            return False
        if _study.name not in tables:
            raise FileError(
                f"{self.name} is not a study store: it holds other tables "
                f"({', '.join(ascii(name)[1:-1][:40] for name in sorted(tables)[:3])}). "
                "Give another --store."
            )
        self._said(connection)
        return True

    def _said(self, connection: Connection) -> dict[str, str]:
        """Read format, schema and settings from the table of the study, verified."""
        found = {key: value for key, value in connection.execute(select(_study))}
        schema = found.get("schema")
        if found.get("format") == FORMAT and schema != str(SCHEMA):
            raise FileError(
                f"The store {self.name} has schema {schema}, and this ematwin knows schema "
                f"{SCHEMA} (2 is that of version 0.2). Use the ematwin that wrote it, or give "
                "another --store."
            )
        if found.get("checksum") != _study_checksum(found):
            raise DamagedError("the row of the study's settings differs from its checksum")
        return found

    def _insert(self, table: Table) -> Any:
        return (postgresql if self._database.is_server else sqlite).insert(table)


def _row_of(one: Run) -> dict[str, Any]:
    """Make the row of a run, with its checksum."""
    inputs = {name: x for name, x in vars(one.spec).items() if name not in (*SHARED, "id")}
    outcome = vars(one).copy()
    spec, status, history = (outcome.pop(name) for name in ("spec", "status", "history"))
    values = spec.id, status, json.dumps({"inputs": inputs, "outcome": outcome}), history
    return dict(zip(_runs.c.keys(), (*values, _checksum(*values)), strict=True))


def _run_of(row: Any, shared: Mapping[str, Any]) -> Run:
    """Make the run of a row and the settings that all runs share."""
    if row.checksum != _checksum(row.id, row.status, row.body, row.history):
        raise DamagedError(f"run {row.id} differs from its checksum")
    body = json.loads(row.body)
    inputs, outcome = body["inputs"], body["outcome"]
    spec = RunSpec(**{**shared, **inputs, "faults": tuple(inputs["faults"])})
    # the id is the key of the row: hashing 100,000 of them again would take half a minute
    spec.__dict__["id"] = row.id
    outcome["faults"] = tuple(outcome["faults"])
    return Run(spec, row.status, **outcome, history=bytes(row.history))


def _checksum(id: str, status: str, body: str, history: Any) -> str:
    """Hash the values of a row; against chance, nobody is kept from changing a run on purpose."""
    content = history if isinstance(history, bytes) else ascii(history).encode()
    return hashlib.sha256(ascii([id, status, body]).encode() + content).hexdigest()[:24]


def _study_checksum(said: Mapping[str, str]) -> str:
    """Hash all entries of the study's table but its checksum."""
    pairs = sorted((name, value) for name, value in said.items() if name != "checksum")
    return hashlib.sha256(ascii(pairs).encode()).hexdigest()[:24]


def _check_same(found: Mapping[str, Any], asked: Mapping[str, Any], where: str) -> None:
    """Raise `FileError` unless both are the settings of one study."""
    for name in dict.fromkeys([*asked, *found]):
        if found.get(name) != asked.get(name):
            place, old, new = _difference(name, found.get(name), asked.get(name))
            raise FileError(
                f"The store {where} holds another study: its {place} is {old}, received {new}. "
                "Give another --store, or the settings of that study."
            )


def _difference(place: str, old: Any, new: Any) -> tuple[str, str, str]:
    """Where two settings differ, and both values there, shortly."""
    if isinstance(old, dict) and isinstance(new, dict) and old.get("name") == new.get("name"):
        for key in dict.fromkeys([*new, *old]):
            if old.get(key) != new.get(key):
                return _difference(f"{place}.{key}", old.get(key), new.get(key))
    return place, _short(old), _short(new)


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return str(value["name"]) if "name" in value else json.dumps(value)
    return f"{value:g}" if isinstance(value, float) else str(value)
