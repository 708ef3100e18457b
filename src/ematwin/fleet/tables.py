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
from ematwin.fleet.store import SCHEMA, FleetStore, settings_in
from ematwin.monitoring.calibration import Calibration
from ematwin.numerics.content import digest

PATIENCE = 60.0  # s for which a database that does not answer is tried again


def _type(one: pa.DataType) -> Any:
    if pa.types.is_list(one):
        return JSON()
    if pa.types.is_timestamp(one):
        return DateTime(timezone=True)
    return Integer() if pa.types.is_integer(one) else Double() if one == pa.float64() else Text()


class TableStore(FleetStore):
    """A fleet whose rows, events and twins are in a database; the folder has copies of twins."""

    def __init__(self, folder: str | Path, *, create: bool = True) -> None:
        super().__init__(folder, create=create)
        url = settings_in(self.folder)["store"]
        if not isinstance(url, str) or "://" not in url:
            raise InputError(
                f"The store of a fleet is postgresql://user@host/name, received {url!r}. Without "
                "one it is the folder of the fleet."
            )
        self._database = Database(url, PATIENCE)
        if not self._database.is_server:
            raise InputError(f"The store of a fleet is a PostgreSQL database, received {url!r}.")
        columns = [Column(one.name, _type(one.type)) for one in SCHEMA if one.name != "id"]
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

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Keep rows; those that are there already stay as they are."""
        blank = dict.fromkeys(SCHEMA.names)
        self._insert(self._rows, [{**blank, **row} for row in rows])

    def has(self, serial_number: str, ids: Iterable[str]) -> bool:
        """Whether somebody has kept these rows meanwhile."""
        wanted = set(ids)
        query = select(func.count()).where(self._rows.c.id.in_(wanted))
        return bool(self._database.read(lambda c: c.execute(query).scalar()) == len(wanted))

    def merge(self) -> None:
        """Nothing is to be done: a database looks after its files."""

    def keep_twin(self, given: Calibration | Path) -> str:
        """Keep a calibration, or its file, as a twin that judges; gives its fingerprint."""
        fingerprint = super().keep_twin(given)
        body = self._twin_file(fingerprint).read_bytes().decode("utf-8")
        self._insert(self._twins, [{"id": fingerprint, "body": body}])
        return fingerprint

    def _kept(self) -> list[pa.Table]:
        query = select(self._rows)
        found = self._database.read(lambda c: [dict(row._mapping) for row in c.execute(query)])
        return [pa.Table.from_pylist(found, schema=SCHEMA)]

    def _twin_file(self, fingerprint: str) -> Path:
        """The file of a twin, which is copied from the database where the folder has none."""
        path = super()._twin_file(fingerprint)
        if not path.exists():
            query = select(self._twins.c.body).where(self._twins.c.id == fingerprint)
            body = self._database.read(lambda c: c.execute(query).scalar())
            if body is not None:
                with written_whole(path, durable=True) as draft:
                    draft.write_text(body, encoding="utf-8", newline="")
        return path

    def _note(self, text: str) -> None:
        self._insert(self._events, [{"id": digest(text), "body": text}])

    def _texts(self) -> list[tuple[str, str]]:
        query = select(self._events.c.id, self._events.c.body)
        return self._database.read(lambda c: [(row.id, row.body) for row in c.execute(query)])

    def _state(self) -> tuple[str, ...]:
        """Counts, which change when anything does: nothing is overwritten."""
        tables = self._rows, self._events
        query = [select(func.count()).select_from(one) for one in tables]
        return self._database.read(lambda c: tuple(str(c.execute(q).scalar()) for q in query))

    def _insert(self, table: Table, rows: list[dict[str, Any]]) -> None:
        if rows:
            query = insert(table).on_conflict_do_nothing()
            self._database.write(lambda c: c.execute(query, rows))
