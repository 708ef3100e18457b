"""The store of a study: every finished run, and who is doing which of the others.

Runs are inserted whole, under the hash of their inputs; one that is done is never overwritten. A
process claims runs before it does them, so that several can share a study. A claim holds for
`LEASE` seconds and is renewed; one that was not renewed is void, and doing its run twice does no
harm, because both give the same numbers.

Reading verifies: SQLite's structure when a store is opened, each row by its checksum. A
store that is not as it was written is refused.
"""

import json
import os
import socket
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, delete, inspect, or_, select, update
from sqlalchemy.dialects import postgresql, sqlite

from ematwin.benchmarking import rows
from ematwin.benchmarking.database import Database
from ematwin.benchmarking.rows import DamagedError
from ematwin.benchmarking.run import StoredRun
from ematwin.errors import FileError

LEASE = 30.0  # s for which a claim holds without being renewed
_PAGE = 1000  # runs read at a time; between pages others may write
_LOCK = 0x656D6174  # of PostgreSQL, for making the tables


def open_store(where: str | Path, *, patience: float = 120.0) -> "Store":
    """Open the store of a study that was begun.

    Parameters
    ----------
    where : path of a SQLite file, or a URL such as postgresql://user@host/name
    patience : float, s, for which a database that does not answer is tried again

    Raises
    ------
    FileError
        If there is none, it is damaged, another kind of database, or of another schema.
    """
    store = Store(where, patience=patience)
    if not store.begun:
        store.close()
        raise FileError(
            f"There is no study in {store.name}. Run one with: ematwin compare --store {store.name}"
        )
    return store


class Store:
    """A study in a SQLite file or a PostgreSQL database.

    Opening looks but does not touch; `begin` makes the tables where there are none.

    Parameters
    ----------
    where : path or URL
    patience : float, s
    owner : name of this process among the claims; None takes one that no other has

    Raises
    ------
    FileError
        If it is damaged, another kind of database, or of another schema.
    """

    def __init__(
        self, where: str | Path, *, patience: float = 120.0, owner: str | None = None
    ) -> None:
        self._database = Database(where, patience)
        self.name = self._database.name
        self.owner = owner or f"{socket.gethostname()} {os.getpid()} {uuid.uuid4().hex[:12]}"
        self._documents: dict[str, Any] = {}  # read or written so far
        self._database.check_whole()
        self.begun = self._database.exists and self._database.read(self._look, patient=False)

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    # --- the study -----------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """Give what all runs share, see `ematwin.benchmarking.plan.Plan.settings`."""
        found: dict[str, Any] = json.loads(self._database.read(self._said)["settings"])
        return found

    def check(self, settings: Mapping[str, Any]) -> None:
        """Raise `FileError` if this cannot be the store of a study with these settings."""
        self._database.check_writable()
        if self.begun:
            _check_same(self.settings(), settings, self.name)

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Make the tables, or check that the study in them is this one.

        Raises
        ------
        FileError
            If the store holds another study, or cannot be written.
        """
        self.check(settings)
        self._database.write(lambda connection: self._begin(connection, settings))
        self.begun = True

    # --- runs ----------------------------------------------------------------------------------

    def statuses(self) -> dict[str, str]:
        """Give ids of the finished runs and how they ended; histories stay where they are."""
        query = select(rows.runs.c.id, rows.runs.c.status)
        return self._database.read(
            lambda connection: {id: status for id, status in connection.execute(query)}
        )

    def runs(self) -> Iterator[StoredRun]:
        """Yield all finished runs, by id.

        Raises
        ------
        FileError
            If a run is not as it was written; the message names it.
        """
        last = ""
        while True:
            page = self._database.read(lambda connection, last=last: self._page(connection, last))  # type: ignore[misc]
            yield from page
            if len(page) < _PAGE:
                return
            last = page[-1].spec.id

    def save(self, finished: Sequence[StoredRun]) -> int:
        """Keep runs and give up their claims; a run that is done already stays as it was.

        Returns
        -------
        int, how many were new, or took the place of one that had not been done
        """
        if not finished:
            return 0
        return self._database.write(lambda connection: self._save(connection, finished))

    # --- claims --------------------------------------------------------------------------------

    def claim(self, ids: Sequence[str], retry: bool = False) -> set[str]:
        """Claim runs for this process.

        Parameters
        ----------
        ids : of the wanted runs
        retry : also those that ended otherwise than done

        Returns
        -------
        set of str, those that are ours now; neither finished, nor claimed by another process
        """
        return self._database.write(lambda connection: self._claim(connection, ids, retry))

    def renew(self) -> None:
        """Make the claims of this process hold for another while."""
        claims = rows.claims
        query = update(claims).where(claims.c.owner == self.owner).values(until=time.time() + LEASE)
        self._database.write(lambda connection: connection.execute(query))

    def release(self) -> None:
        """Give up all claims of this process."""
        query = delete(rows.claims).where(rows.claims.c.owner == self.owner)
        self._database.write(lambda connection: connection.execute(query))

    # --- within transactions -------------------------------------------------------------------

    def _look(self, connection: Connection) -> bool:
        """Whether a study has been begun here; raise unless it is ours to read."""
        tables = set(inspect(connection).get_table_names())
        if not tables:
            return False
        if rows.study.name not in tables:
            raise FileError(
                f"{self.name} is not a study store: it holds other tables "
                f"({', '.join(ascii(name)[1:-1][:40] for name in sorted(tables)[:3])}). "
                "Give another --store."
            )
        self._said(connection)
        return True

    def _said(self, connection: Connection) -> dict[str, str]:
        """Read format, schema and settings from the table of the study, verified."""
        columns = rows.study.c
        found = {
            key: value for key, value in connection.execute(select(columns.key, columns.value))
        }
        schema = found.get("schema")
        if found.get("format") == rows.FORMAT and schema != str(rows.SCHEMA):
            raise FileError(
                f"The store {self.name} has schema {schema}, and this ematwin knows schema "
                f"{rows.SCHEMA} (2 since version 0.2). Use the ematwin that wrote it, or give "
                "another --store."
            )
        if found.get("checksum") != rows.study_checksum(found):
            raise DamagedError("the row of the study's settings differs from its checksum")
        return found

    def _begin(self, connection: Connection, settings: Mapping[str, Any]) -> None:
        if self._database.is_server:
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_LOCK})")
        if self._look(connection):
            _check_same(json.loads(self._said(connection)["settings"]), settings, self.name)
            return
        rows.metadata.create_all(connection)
        said = {
            "format": rows.FORMAT,
            "schema": str(rows.SCHEMA),
            "settings": json.dumps(settings, sort_keys=True),
        }
        said["checksum"] = rows.study_checksum(said)
        pairs = [{"key": key, "value": value} for key, value in said.items()]
        connection.execute(rows.study.insert(), pairs)

    def _page(self, connection: Connection, last: str) -> list[StoredRun]:
        """Read the runs after an id, at most `_PAGE`."""
        query = select(rows.runs).where(rows.runs.c.id > last).order_by(rows.runs.c.id)
        page = connection.execute(query.limit(_PAGE)).all()
        named = {key for row in page for key in (row.settings, row.provenance)}
        if not named <= self._documents.keys():
            found = connection.execute(select(rows.documents)).all()
            self._documents |= rows.contents({row.key: row.body for row in found})
        return [rows.run_of(dict(row._mapping), self._documents) for row in page]

    def _save(self, connection: Connection, finished: Sequence[StoredRun]) -> int:
        shared = dict(
            rows.document(value)
            for one in finished
            for value in (rows.settings_of(one.spec), one.result.provenance)
        )
        for key, body in shared.items():
            document = self._insert(rows.documents).values(key=key, body=body)
            connection.execute(document.on_conflict_do_nothing())
        kept = 0
        for one in finished:
            row = rows.row_of(one)
            query = self._insert(rows.runs).values(row)
            query = query.on_conflict_do_update(
                index_elements=["id"],
                set_={name: query.excluded[name] for name in row if name != "id"},
                where=rows.runs.c.status != "done",
            )
            kept += connection.execute(
                query, execution_options={"preserve_rowcount": True}
            ).rowcount
        claims = rows.claims.c
        ours = claims.id.in_([one.spec.id for one in finished]) & (claims.owner == self.owner)
        connection.execute(delete(rows.claims).where(ours))
        return kept

    def _claim(self, connection: Connection, ids: Sequence[str], retry: bool) -> set[str]:
        claims, runs, now = rows.claims.c, rows.runs.c, time.time()
        # a claim of far in the future was made by a clock that is wrong
        void = or_(claims.until < now, claims.until > now + 2.0 * LEASE)
        connection.execute(delete(rows.claims).where(claims.id.in_(ids), void))
        for id in ids:
            row = {"id": id, "owner": self.owner, "until": now + LEASE}
            connection.execute(self._insert(rows.claims).values(row).on_conflict_do_nothing())
        mine = select(claims.id).where(claims.id.in_(ids), claims.owner == self.owner)
        finished = select(runs.id).where(runs.id.in_(ids))
        if retry:
            finished = finished.where(runs.status == "done")
        won = set(connection.execute(mine).scalars())
        # asked after the claims stand: a run may have been saved meanwhile
        done = set(connection.execute(finished).scalars())
        connection.execute(
            delete(rows.claims).where(claims.id.in_(done), claims.owner == self.owner)
        )
        return won - done

    def _insert(self, table: Any) -> Any:
        return (postgresql if self._database.is_server else sqlite).insert(table)


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
