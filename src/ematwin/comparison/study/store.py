"""The store of a study: every finished run, and who is doing which of the others.

Runs are inserted whole, under the hash of their inputs; one that is done is never overwritten. A
process claims runs before it does them, so that several can share a study. A claim lapses when
its process is seen to be dead, or when it was not renewed for a while.

What is read is verified: SQLite's structure when a store is opened, each row by its checksum.
"""

import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import Connection, delete, inspect, select, update
from sqlalchemy.dialects import postgresql, sqlite

from ematwin.comparison.study import schema
from ematwin.comparison.study.database import Database
from ematwin.comparison.study.owner import is_dead, owner_name
from ematwin.comparison.study.rows import RowReader, document, row_of, settings_of
from ematwin.comparison.study.run import StoredRun
from ematwin.comparison.study.same import check_same
from ematwin.comparison.study.seal import DamagedError, study_checksum
from ematwin.comparison.study.survey import survey
from ematwin.errors import FileError

LEASE = 60.0  # s for which a claim holds without being renewed
_PAGE = 1000  # runs read at a time; between pages others may write
_FEW = 500  # ids in one question
_Answer = TypeVar("_Answer")
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
        self._seen: dict[str, tuple[float, float]] = {}  # claims of others, since when they stand
        self._schema = schema.SCHEMA
        with self._naming_damage():
            self._database.check_whole()
            self.begun = self._database.exists and self._read(self._look, patient=False)

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
        found: dict[str, Any] = json.loads(self._read(self._said)["settings"])
        return found

    def check(self, settings: Mapping[str, Any]) -> None:
        """Raise `FileError` if this cannot be the store of a study with these settings."""
        self._database.check_writable()
        if self.begun:
            check_same(self.settings(), settings, self.name)

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Make the tables, or check that the study in them is this one; bring them up to date.

        Raises
        ------
        FileError
            If the store holds another study, or cannot be written.
        """
        self.check(settings)
        with self._naming_damage():
            self._database.write(lambda connection: self._begin(connection, settings))
        self.begun = True
        self._schema = schema.SCHEMA

    # --- runs ----------------------------------------------------------------------------------

    def statuses(self) -> dict[str, str]:
        """Ids of the finished runs and how they ended; histories stay where they are."""
        columns = schema.runs.c
        query = select(columns.id, columns.status)
        return self._read(lambda connection: {row[0]: row[1] for row in connection.execute(query)})

    def runs(self) -> Iterator[StoredRun]:
        """Yield all finished runs, by id. Histories stay packed until they are looked at.

        Raises
        ------
        FileError
            If a run is not as it was written; the message names it.
        """
        columns = schema.runs.c
        sealed = self._schema >= schema.SEALED
        there = [column for column in columns if sealed or column.name != "checksum"]
        reader = RowReader(self._document, sealed)
        last = ""
        while True:
            query = select(*there).where(columns.id > last).order_by(columns.id).limit(_PAGE)
            page = self._read(lambda c, query=query: c.execute(query).all())  # type: ignore[misc]
            for row in page:
                with self._naming_damage():
                    one = reader.stored(row._mapping)
                yield one
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

    # --- damage --------------------------------------------------------------------------------

    def _read(self, work: Callable[[Connection], _Answer], patient: bool = True) -> _Answer:
        with self._naming_damage():
            return self._database.read(work, patient)

    @contextmanager
    def _naming_damage(self) -> Iterator[None]:
        """Say of which rows a store is damaged, and how the others are rescued."""
        try:
            yield
        except DamagedError as error:
            found = survey(self._database)
            if not found.runs:
                raise FileError(
                    f"The store {self.name} is damaged: {error}, and no run in it is whole. Put a "
                    "copy in its place, or give another --store."
                ) from None
            rows = found.damaged or [f"{error}; all {len(found.runs)} runs in it are whole"]
            more = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
            raise FileError(
                f"The store {self.name} is damaged: {rows[0]}{more}. What is whole can be rescued: "
                f"ematwin store rescue {self.name} --out rescued.db"
            ) from None

    # --- within transactions -------------------------------------------------------------------

    def _look(self, connection: Connection) -> bool:
        """Whether a study has been begun here; raise unless it is ours to read."""
        tables = set(inspect(connection).get_table_names())
        if not tables:
            return False
        if schema.study.name not in tables:
            raise FileError(
                f"{self.name} is not a study store: it holds other tables "
                f"({', '.join(ascii(name)[1:-1][:40] for name in sorted(tables)[:3])}). "
                "Give another --store."
            )
        self._schema = int(self._said(connection)["schema"])
        return True

    def _said(self, connection: Connection) -> dict[str, str]:
        """What the table of the study says, verified: format, schema, settings."""
        columns = schema.study.c
        found = {row[0]: row[1] for row in connection.execute(select(columns.key, columns.value))}
        version = found.get("schema")
        number = int(version) if isinstance(version, str) and version.isdecimal() else 0
        sealed = number >= schema.SEALED or "checksum" in found
        if number > schema.SCHEMA and found.get("format") == schema.FORMAT:
            schema.check_schema(number, self.name)
        if (
            found.get("format") != schema.FORMAT
            or not 1 <= number <= schema.SCHEMA
            or not isinstance(found.get("settings"), str)
            or (sealed and found.get("checksum") != study_checksum(found))
        ):
            raise DamagedError("the row of the study's settings differs from its checksum")
        return found

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
            schema.seal_study(connection)
            return
        found = self._said(connection)
        schema.migrate(connection, int(found["schema"]), self.name)
        check_same(json.loads(found["settings"]), settings, self.name)

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
                if self._lapsed(claim.id, claim.until, now) or is_dead(claim.owner):
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

    def _lapsed(self, id: str, until: Any, now: float) -> bool:
        """Whether a claim is past its time, or has not been renewed for as long as we look.

        The second is for clocks that were set: a claim of tomorrow shall not be waited for.
        """
        if not (isinstance(until, float) and until >= now):
            return True
        before, since = self._seen.get(id, (math.nan, 0.0))
        if before != until:
            self._seen[id] = (until, time.monotonic())
            return False
        return time.monotonic() - since > LEASE

    def _document(self, key: str) -> str | None:
        query = select(schema.documents.c.body).where(schema.documents.c.key == key)
        row = self._database.read(lambda connection: connection.execute(query).first())
        return None if row is None or not isinstance(row[0], str) else row[0]


def _documents_of(one: StoredRun) -> tuple[dict[str, Any], dict[str, Any]]:
    return settings_of(one.spec), one.result.provenance


def _parts(ids: list[str]) -> Iterable[list[str]]:
    return (ids[n : n + _FEW] for n in range(0, len(ids), _FEW))
