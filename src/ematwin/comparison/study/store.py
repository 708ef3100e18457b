"""The store of a study: every finished run, and who is doing which of the others.

Runs are inserted whole, under the hash of their inputs; one that is done is never overwritten. A
process claims runs before it does them, so that several can share a study. A claim lapses when
its process is seen to be dead, or when it was not renewed for a while.
"""

import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, delete, inspect, select, update
from sqlalchemy.dialects import postgresql, sqlite

from ematwin.comparison.study import schema
from ematwin.comparison.study.database import Database
from ematwin.comparison.study.owner import is_dead, owner_name
from ematwin.comparison.study.rows import RowReader, document, row_of, settings_of
from ematwin.comparison.study.run import StoredRun
from ematwin.errors import FileError

LEASE = 60.0  # s for which a claim holds without being renewed
_PAGE = 1000  # runs read at a time; between pages others may write
_FEW = 500  # ids in one question
_COUNTED = {"preserve_rowcount": True}
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
        If there is none, it is another kind of database, or of a newer schema.
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
    owner : name of this process among the claims

    Raises
    ------
    FileError
        If it is another kind of database, or of a newer schema.
    """

    def __init__(
        self, where: str | Path, *, patience: float = 120.0, owner: str | None = None
    ) -> None:
        self._database = Database(where, patience)
        self.name = self._database.name
        self.owner = owner or owner_name()
        self._documents: set[str] = set()
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
        """What all runs of the study share, see `ematwin.comparison.study.plan.Plan.settings`."""
        query = select(schema.study.c.value).where(schema.study.c.key == "settings")
        text = self._database.read(lambda connection: connection.execute(query).scalar_one())
        found: dict[str, Any] = json.loads(text)
        return found

    def check(self, settings: Mapping[str, Any]) -> None:
        """Raise `FileError` if this cannot be the store of a study with these settings."""
        self._database.check_writable()
        if self.begun:
            _check_same(self.settings(), settings, self.name)

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Make the tables, or check that the study in them is this one; bring them up to date.

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
        """Ids of the finished runs and how they ended; histories stay where they are."""
        columns = schema.runs.c
        query = select(columns.id, columns.status)
        return self._database.read(
            lambda connection: {row[0]: row[1] for row in connection.execute(query)}
        )

    def runs(self) -> Iterator[StoredRun]:
        """Yield all finished runs, by id. Histories stay packed until they are looked at."""
        columns = schema.runs.c
        reader = RowReader(self._document)
        last = ""
        while True:
            query = select(schema.runs).where(columns.id > last).order_by(columns.id).limit(_PAGE)
            page = self._database.read(lambda c, query=query: c.execute(query).all())  # type: ignore[misc]
            for row in page:
                yield reader.stored(row._mapping)
            if len(page) < _PAGE:
                return
            last = page[-1].id

    def save(self, finished: Sequence[StoredRun]) -> int:
        """Keep runs and give up their claims; a run that is done already stays as it was.

        Returns
        -------
        int, how many were new, or took the place of one that had not been done
        """
        if not finished:
            return 0
        rows = [row_of(one) for one in finished]
        texts = dict(pair for one in finished for pair in map(document, _documents_of(one)))
        kept = self._database.write(lambda connection: self._save(connection, rows, texts))
        self._documents.update(texts)
        return kept

    # --- claims --------------------------------------------------------------------------------

    def claim(self, ids: Sequence[str], retry: bool = False) -> set[str]:
        """Claim runs for this process.

        Parameters
        ----------
        ids : of the wanted runs
        retry : also those that ended otherwise than done

        Returns
        -------
        set of str, those that are ours now; neither finished, nor claimed by a process that lives
        """
        return self._database.write(lambda connection: self._claim(connection, ids, retry))

    def renew(self) -> None:
        """Make the claims of this process hold for another while."""
        claims = schema.claims
        query = update(claims).where(claims.c.owner == self.owner).values(until=time.time() + LEASE)
        self._database.write(lambda connection: connection.execute(query))

    def release(self) -> None:
        """Give up all claims of this process."""
        query = delete(schema.claims).where(schema.claims.c.owner == self.owner)
        self._database.write(lambda connection: connection.execute(query))

    # --- within transactions -------------------------------------------------------------------

    def _look(self, connection: Connection) -> bool:
        """Whether a study has been begun here; raise unless it is ours to read."""
        tables = set(inspect(connection).get_table_names())
        if not tables:
            return False
        study = schema.study
        found = _pairs(connection) if study.name in tables else {}
        if found.get("format") != schema.FORMAT:
            raise FileError(
                f"{self.name} is not a study store: it holds other tables "
                f"({', '.join(sorted(tables)[:3])}). Give another --store."
            )
        schema.check_schema(int(found["schema"]), self.name)
        return True

    def _begin(self, connection: Connection, settings: Mapping[str, Any]) -> None:
        if self._database.is_server:
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_LOCK})")
        study = schema.study
        if not self._look(connection):
            schema.metadata.create_all(connection)
            rows = {
                "format": schema.FORMAT,
                "schema": str(schema.SCHEMA),
                "settings": json.dumps(settings, sort_keys=True),
            }
            connection.execute(
                study.insert(), [{"key": key, "value": value} for key, value in rows.items()]
            )
            return
        found = _pairs(connection)
        schema.migrate(connection, int(found["schema"]), self.name)
        _check_same(json.loads(found["settings"]), settings, self.name)

    def _save(
        self, connection: Connection, rows: list[dict[str, Any]], texts: dict[str, str]
    ) -> int:
        insert = (postgresql if self._database.is_server else sqlite).insert
        for key, body in texts.items():
            if key not in self._documents:
                connection.execute(
                    insert(schema.documents).values(key=key, body=body).on_conflict_do_nothing()
                )
        query: Any = insert(schema.runs)
        query = query.on_conflict_do_update(
            index_elements=["id"],
            set_={name: query.excluded[name] for name in rows[0] if name != "id"},
            where=schema.runs.c.status != "done",
        )
        kept = sum(
            connection.execute(query.values(row), execution_options=_COUNTED).rowcount
            for row in rows
        )
        claims = schema.claims
        ids = [row["id"] for row in rows]
        for part in _parts(ids):
            connection.execute(
                delete(claims).where(claims.c.id.in_(part), claims.c.owner == self.owner)
            )
        return kept

    def _claim(self, connection: Connection, ids: Sequence[str], retry: bool) -> set[str]:
        runs, claims = schema.runs.c, schema.claims
        insert = (postgresql if self._database.is_server else sqlite).insert
        now = time.time()
        ours: set[str] = set()
        for part in _parts(list(dict.fromkeys(ids))):
            finished = select(runs.id).where(runs.id.in_(part))
            if retry:
                finished = finished.where(runs.status == "done")
            taken = set(connection.execute(finished).scalars())
            held = connection.execute(select(claims).where(claims.c.id.in_(part))).all()
            for claim in held:
                if claim.owner == self.owner:
                    continue
                if claim.until < now or is_dead(claim.owner):
                    connection.execute(
                        delete(claims).where(claims.c.id == claim.id, claims.c.owner == claim.owner)
                    )
                else:
                    taken.add(claim.id)
            for id in part:
                if id in taken:
                    continue
                row = {"id": id, "owner": self.owner, "until": now + LEASE}
                query: Any = insert(claims).values(row).on_conflict_do_nothing()
                connection.execute(query)
            # of two that claimed at the same moment one was first: ask the table
            mine = select(claims.c.id).where(claims.c.id.in_(part), claims.c.owner == self.owner)
            won = set(connection.execute(mine).scalars())
            if self._database.is_server:  # a run may have been saved since we looked
                won -= set(connection.execute(finished).scalars())
            ours |= won - taken
        return ours

    def _document(self, key: str) -> Any:
        query = select(schema.documents.c.body).where(schema.documents.c.key == key)
        return json.loads(self._database.read(lambda c: c.execute(query).scalar_one()))


def _pairs(connection: Connection) -> dict[str, str]:
    columns = schema.study.c
    return {row[0]: row[1] for row in connection.execute(select(columns.key, columns.value))}


def _documents_of(one: StoredRun) -> tuple[dict[str, Any], dict[str, Any]]:
    return settings_of(one.spec), one.result.provenance


def _parts(ids: list[str]) -> Iterable[list[str]]:
    return (ids[n : n + _FEW] for n in range(0, len(ids), _FEW))


def _check_same(found: Mapping[str, Any], asked: Mapping[str, Any], where: str) -> None:
    """Raise `FileError` unless both are the settings of one study."""
    for name in dict.fromkeys([*asked, *found]):
        if found.get(name) == asked.get(name):
            continue
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
