"""The rows and events of a fleet as tables of a PostgreSQL database: for watchers on many machines.

`ematwin.fleet.store` describes them. A row is inserted once under its id, and stays. Twins are
kept too, so that each machine can read what another's twin has judged.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
from sqlalchemy import JSON, Column, DateTime, Double, Integer, MetaData, Table, Text, func, select
from sqlalchemy.dialects.postgresql import insert

from ematwin.benchmarking.database import Database
from ematwin.errors import InputError
from ematwin.files import written_whole
from ematwin.numerics.content import digest

PATIENCE = 60.0  # s for which a database that does not answer is tried again


def _type(one: pa.DataType) -> Any:
    if pa.types.is_list(one):
        return JSON()
    if pa.types.is_timestamp(one):
        return DateTime(timezone=True)
    return Integer() if pa.types.is_integer(one) else Double() if one == pa.float64() else Text()


class TableRows:
    """Rows, events and twins of a fleet in a database; `ematwin.fleet.folder.FolderRows` is alike.

    Parameters
    ----------
    url : postgresql://user@host/name
    folder : of the fleet, for copies of twins
    """

    def __init__(self, url: str, folder: Path, schema: pa.Schema) -> None:
        self._given = url, folder, schema
        if not isinstance(url, str) or "://" not in url:
            raise InputError(
                f"The store of a fleet is postgresql://user@host/name, received {url!r}. Without "
                "one it is the folder of the fleet."
            )
        self._database, self._folder, self._schema = Database(url, PATIENCE), folder, schema
        if not self._database.is_server:
            raise InputError(f"The store of a fleet is a PostgreSQL database, received {url!r}.")
        columns = [Column(one.name, _type(one.type)) for one in schema if one.name != "id"]
        held = MetaData()
        self._rows = Table("ematwin_fleet", held, Column("id", Text, primary_key=True), *columns)
        self._events, self._twins = (
            Table(name, held, Column("id", Text, primary_key=True), Column("body", Text))
            for name in ("ematwin_fleet_events", "ematwin_fleet_twins")
        )

        def make(connection: Any) -> None:
            connection.exec_driver_sql("SELECT pg_advisory_xact_lock(1718379877)")
            held.create_all(connection)

        self._database.write(make)

    def __reduce__(self) -> Any:
        return TableRows, self._given  # a worker of a cluster connects by itself

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Keep rows; those that are there already stay as they are."""
        blank = dict.fromkeys(self._schema.names)
        self._keep(self._rows, [{**blank, **row} for row in rows])

    def rows(self, serial_number: str | None) -> list[pa.Table]:
        """The rows of all actuators or of one."""
        query = select(self._rows)
        if serial_number is not None:
            query = query.where(self._rows.c.serial_number == serial_number)
        found = self._database.read(lambda c: [dict(row._mapping) for row in c.execute(query)])
        return [pa.Table.from_pylist(found, schema=self._schema)]

    def has(self, serial_number: str, ids: Iterable[str]) -> bool:
        """Whether all of these rows are kept."""
        wanted = list(ids)
        query = select(func.count()).where(self._rows.c.id.in_(wanted))
        return bool(self._database.read(lambda c: c.execute(query).scalar()) == len(set(wanted)))

    def merge(self) -> None:
        """Nothing is to be done: a database looks after its files."""

    def note(self, text: str) -> None:
        """Keep an event, JSON; the same one again is kept once."""
        self._keep(self._events, [{"id": digest(text), "body": text}])

    def events(self) -> list[tuple[str, str]]:
        """Places and texts of all events."""
        query = select(self._events.c.id, self._events.c.body)
        return self._database.read(lambda c: [(row.id, row.body) for row in c.execute(query)])

    def version(self) -> tuple[str, ...]:
        """Counts, which change when anything does: nothing is overwritten."""
        tables = self._rows, self._events
        query = [select(func.count()).select_from(one) for one in tables]
        return self._database.read(lambda c: tuple(str(c.execute(q).scalar()) for q in query))

    def twin(self, fingerprint: str) -> Path:
        """The file of a twin, which is copied from the database where the folder has none."""
        path = self._folder / "twins" / f"{fingerprint}.toml"
        if not path.exists():
            query = select(self._twins.c.body).where(self._twins.c.id == fingerprint)
            body = self._database.read(lambda c: c.execute(query).scalar())
            if body is not None:
                with written_whole(path, durable=True) as draft:
                    draft.write_text(body, encoding="utf-8", newline="")
        return path

    def keep_twin(self, fingerprint: str) -> None:
        """Keep the file of a twin for other machines."""
        body = self.twin(fingerprint).read_bytes().decode("utf-8")
        self._keep(self._twins, [{"id": fingerprint, "body": body}])

    def _keep(self, table: Table, rows: list[dict[str, Any]]) -> None:
        if rows:
            query = insert(table).on_conflict_do_nothing()
            self._database.write(lambda c: c.execute(query, rows))
