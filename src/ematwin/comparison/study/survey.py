"""What of a store is as it was written, whatever became of the rest.

Of a SQLite file every page is looked at, so that a run is found as long as its own pages are whole;
its checksum says whether it is. A server's rows are asked for.
"""

import hashlib
import json
import shutil
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ematwin.comparison.study.pages import Record, records
from ematwin.comparison.study.rows import SHARED, RowReader
from ematwin.comparison.study.run import RunSpec, StoredRun
from ematwin.comparison.study.seal import COLUMNS, DamagedError, called, document_key
from ematwin.errors import FileError

if TYPE_CHECKING:
    from ematwin.comparison.study.database import Database

_SETTINGS = {"seed", "population", "iterations", "actuator", "scenario"}
_STATUSES = {"done", "failed", "timeout", "not finite"}
_ID = 24  # digits


@dataclass
class Survey:
    """What was found in a store.

    Attributes
    ----------
    settings : those of the study, None if no copy is whole
    runs : whole runs, by id
    unsealed : int, how many of them have no checksum, because 0.1 wrote them
    damaged : what is not as it was written or is gone, in words
    """

    settings: dict[str, Any] | None = None
    runs: dict[str, StoredRun] = field(default_factory=dict)
    unsealed: int = 0
    damaged: list[str] = field(default_factory=list)

    def _take(
        self,
        rows: Iterable[Mapping[str, Any]],
        bodies: Iterable[tuple[str, str]],
        said: Mapping[str, Any],
        listed: Iterable[str],
    ) -> None:
        whole = [_mended(key, body) for key, body in bodies]
        self.settings = _settings(said, whole)
        if self.settings is not None:  # what runs share of them, should its document be lost
            shared = {name: self.settings.get(name) for name in SHARED}
            whole.append(json.dumps(shared, sort_keys=True))
        documents = {document_key(body): body for body in whole}
        readers = {True: RowReader(documents.get), False: RowReader(documents.get, sealed=False)}
        damaged: dict[Any, str] = {}
        for row in rows:
            sealed = row.get("checksum") is not None
            try:
                one = readers[sealed].stored(row)
                if not sealed and RunSpec.id.func(one.spec) != row["id"]:  # type: ignore[attr-defined]
                    raise DamagedError(f"{called(row)} has other inputs than its id says")
            except DamagedError as error:
                damaged[row.get("id")] = str(error)
                continue
            before = self.runs.get(one.spec.id)
            if before is None or before.result.status != "done":
                self.runs[one.spec.id] = one
                self.unsealed += before is None and not sealed
        self.damaged = [text for id, text in damaged.items() if id not in self.runs]
        self.damaged += [
            f"run {id} is gone"
            for id in listed
            if id not in self.runs and not any(_alike(id, other) for other in damaged)
        ]


def survey(database: "Database") -> Survey:
    """Look at all of a store; writes nothing."""
    if database.path is not None:
        return survey_file(database.path)
    found = Survey()
    found._take(*_asked(database))
    return found


def survey_file(path: Path) -> Survey:
    """Look at all of a SQLite file, which need not be one that SQLite opens.

    Raises
    ------
    FileError
        If it cannot be read at all.
    """
    found = Survey()
    try:
        with tempfile.TemporaryDirectory(prefix="ematwin-") as folder:
            found._take(*_sorted(records(_settled_copy(path, Path(folder)))))
    except OSError as error:
        raise FileError(f"Cannot read the store {path}: {error.strerror or error}.") from None
    return found


def _settings(said: Mapping[str, Any], bodies: Iterable[str]) -> dict[str, Any] | None:
    """The study's settings from its own table or, where that is damaged, from their copy."""
    text = said.get("settings")
    copies = [body for body in bodies if '"seed"' in body]
    if isinstance(text, str) and (text in copies or "checksum" not in said):
        copies.insert(0, text)
    for copy in copies:
        with suppress(json.JSONDecodeError):
            found = json.loads(copy)
            if isinstance(found, dict) and set(found) >= _SETTINGS:
                return found
    return None


def _mended(key: str, body: str) -> str:
    """The text of a document, with the bit turned back that was flipped, if one was.

    All runs of a study share one or two documents; its key, a hash, says when the text is right.
    """
    if document_key(body) == key:
        return body
    raw = bytearray(body.encode("utf-8", "surrogateescape"))
    for n in range(len(raw)):
        for bit in range(8):
            raw[n] ^= 1 << bit
            if hashlib.sha256(raw).hexdigest()[:_ID] == key:
                return raw.decode()
            raw[n] ^= 1 << bit
    return body


def _alike(id: str, other: Any) -> bool:
    """Whether one may be the other with a letter damaged."""
    return (
        isinstance(other, str)
        and len(other) == len(id)
        and sum(a != b for a, b in zip(id, other, strict=True)) < 2
    )


def _settled_copy(path: Path, folder: Path) -> Path:
    """A copy in which SQLite has taken back a commit that was cut short."""
    copy = folder / "study.db"
    shutil.copyfile(path, copy)
    for ending in ("-journal", "-wal"):
        beside = path.with_name(path.name + ending)
        if beside.exists():
            shutil.copyfile(beside, copy.with_name(copy.name + ending))
            with suppress(sqlite3.Error), closing(sqlite3.connect(copy)) as opened:
                opened.execute("PRAGMA schema_version").fetchall()
    return copy


def _sorted(
    found: Iterator[Record],
) -> tuple[list[dict[str, Any]], list[tuple[str, str]], dict[str, Any], list[str]]:
    """Rows of runs, bodies of documents, what the study's table says, ids that indexes list."""
    rows: list[dict[str, Any]] = []
    bodies: list[tuple[str, str]] = []
    said: dict[str, Any] = {}
    by_id: set[str] = set()
    by_status: set[str] = set()
    for record in found:
        values = record.values
        if values is None:
            continue
        if record.is_row and len(values) in (len(COLUMNS), len(COLUMNS) + 1):
            rows.append(dict(zip((*COLUMNS, "checksum"), values, strict=False)))
        elif record.is_row and len(values) == 2 and isinstance(values[1], str):
            if isinstance(values[0], str) and len(values[0]) == _ID:
                bodies.append((values[0], values[1]))
            else:
                said[values[0]] = values[1]
        elif not record.is_row and isinstance(values[0], str) and len(values[0]) == _ID:
            if len(values) == 3 and values[1] in _STATUSES:
                by_status.add(values[0])
            elif len(values) == 2:
                by_id.add(values[0])
    return rows, bodies, said, sorted(by_id & by_status)


def _asked(
    database: "Database",
) -> tuple[list[Mapping[str, Any]], list[tuple[str, str]], dict[str, Any], list[str]]:
    """The same of a server, whose own checksums look after its indexes."""
    from sqlalchemy import select

    from ematwin.comparison.study import schema

    def ask(connection: Any) -> Any:
        said = {row.key: row.value for row in connection.execute(select(schema.study))}
        there = [
            column
            for column in schema.runs.c
            if said.get("schema") != "1" or column.name != "checksum"
        ]
        rows = [dict(row._mapping) for row in connection.execute(select(*there))]
        bodies = [(row.key, row.body) for row in connection.execute(select(schema.documents))]
        return rows, bodies, said, []

    return database.read(ask)
