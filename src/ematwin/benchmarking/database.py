"""The database under a store: opening, transactions, and retries when it does not answer.

SQLite keeps one file with a rollback journal: each commit is on the disk before it returns, and a
killed process leaves nothing that the next opening does not mend. PostgreSQL is reached by its URL.
"""

import logging
import os
import sqlite3
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from ematwin.errors import FileError, InputError, MissingExtraError

Answer = TypeVar("Answer")

_MAGIC = b"SQLite format 3\0"
_DAMAGE = ("malformed", "not a database", "decode", "unsupported file", "no such column", "corrupt")


class DamagedError(FileError):
    """Something in a database is not as it was written."""


class Database:
    """Transactions on a SQLite file or a PostgreSQL database, postgresql://user@host/name.

    One that does not answer is tried again for ``patience``, s.
    """

    def __init__(self, where: str | Path, patience: float = 120.0) -> None:
        self.patience = patience
        self.url = _url(str(where))
        self.path = None if self.url.database is None or self.is_server else Path(self.url.database)
        self.name = str(self.path or self.url.render_as_string(hide_password=True))
        if self.path is not None:
            _check_file(self.path)
        self._readers = _engine(self.url)
        self._writers = self._readers.execution_options(ematwin_writes=True)

    @property
    def is_server(self) -> bool:
        """Whether it is PostgreSQL."""
        return self.url.get_backend_name() == "postgresql"

    @property
    def exists(self) -> bool:
        """Whether there is anything yet; a server always is."""
        return self.path is None or (self.path.exists() and self.path.stat().st_size > 0)

    def check_writable(self) -> None:
        """Raise `FileError` if the file, or a new one in its folder, cannot be written."""
        if self.path is None:
            return
        folder = self.path.parent
        if not (folder.is_dir() and os.access(folder, os.W_OK)):
            raise FileError(
                f"Cannot write the store {self.path}: the folder {folder} is missing or "
                "read-only. Choose a folder that exists and is yours."
            )
        if self.path.exists() and not os.access(self.path, os.W_OK):
            raise FileError(f"Cannot write the store {self.path}: the file is read-only.")

    def check_whole(self) -> None:
        """Raise `FileError` if SQLite finds its file damaged; a server checks its files itself."""
        if self.path is not None and self.exists:
            # the quick check does not compare indexes, from which ids are read, with the rows
            found = self.read(lambda c: c.exec_driver_sql("PRAGMA integrity_check(1)").scalar())
            if found != "ok":
                raise self._damaged(found)

    def read(self, work: Callable[[Connection], Answer], patient: bool = True) -> Answer:
        """Do ``work`` in a transaction that only reads; it may be done more than once."""
        return self._do(self._readers, work, patient)

    def write(self, work: Callable[[Connection], Answer]) -> Answer:
        """Do ``work`` in one transaction that writes; it may be done more than once."""
        return self._do(self._writers, work, True)

    def close(self) -> None:
        """Let go of the database."""
        self._readers.dispose()

    def _do(self, engine: Engine, work: Callable[[Connection], Answer], patient: bool) -> Answer:
        end = time.monotonic() + (self.patience if patient else 0.0)
        pause = 0.1
        while True:
            try:
                with engine.begin() as connection:
                    return work(connection)
            except (DamagedError, UnicodeDecodeError) as error:
                raise self._damaged(error) from None
            except DBAPIError as error:
                left = end - time.monotonic()
                if not _is_passing(error) or left <= 0.0:
                    raise self._refusal(error) from None
                if pause == 0.1:
                    logging.getLogger("ematwin").warning(
                        "The store %s does not answer; trying again for %.0f s.", self.name, left
                    )
                time.sleep(min(pause, left))
                pause = min(2.0 * pause, 2.0)
            except BaseException as error:
                # an interrupted statement keeps its lock for as long as the frames that hold it
                traceback.clear_frames(error.__traceback__)
                raise

    def _damaged(self, how: object) -> FileError:
        said = ascii(" ".join(str(how).split()))[1:-1][:120]
        return FileError(
            f"The store {self.name} is damaged: {said}. Put a copy in its place, or give another "
            "--store."
        )

    def _refusal(self, error: DBAPIError) -> FileError:
        """Put the database's complaint into a sentence."""
        cause = " ".join(str(error.orig).split()) or type(error.orig).__name__
        if "full" in cause or getattr(error.orig, "sqlstate", None) == "53100":
            return FileError(
                f"The disk of the store {self.name} is full ({cause}). Finished runs are kept; "
                "make room and give the same command again."
            )
        if type(error.orig) is sqlite3.DatabaseError or any(word in cause for word in _DAMAGE):
            return self._damaged(cause)
        return FileError(
            f"The store {self.name} cannot be used: {cause.rstrip('.?')}. Finished runs are kept; "
            "give the same command again once it can."
        )


def _is_passing(error: DBAPIError) -> bool:
    """Whether another moment may bring another answer."""
    cause = error.orig
    if isinstance(cause, sqlite3.Error):
        return "locked" in str(cause) or "busy" in str(cause)
    state = str(getattr(cause, "sqlstate", None) or "")
    if not state:
        return type(cause).__name__ in {"OperationalError", "InterfaceError"}
    # 08: connection lost; 57P: shutting down or starting; 40, 55P: others were in the way
    return state[:2] in {"08", "40"} or state[:3] in {"57P", "55P"}


def _url(text: str) -> URL:
    if "://" not in text:
        return URL.create("sqlite", database=text)
    try:
        url = make_url(text)
        backend = url.get_backend_name()
    except (ArgumentError, NoSuchModuleError):
        backend = ""
    if backend == "sqlite" and url.database:
        return URL.create("sqlite", database=url.database)
    if backend not in {"postgresql", "postgres"}:
        kind = text.split("://")[0]
        raise InputError(
            f"A store is a file or a URL postgresql://user@host/name, received {kind}://."
        )
    try:
        import psycopg  # noqa: F401  # checked here, for the message
    except ImportError:
        raise MissingExtraError("psycopg", "postgres", "A PostgreSQL store") from None
    return url.set(drivername="postgresql+psycopg")


def _check_file(path: Path) -> None:
    """Before SQLite sees it: a missing file may become one, another kind of file may not."""
    try:
        if path.is_dir():
            raise FileError(f"The store {path} is a folder. Give the name of a file.")
        if path.exists():
            with path.open("rb") as file:
                head = file.read(len(_MAGIC))
            if head and head != _MAGIC:
                raise FileError(
                    f"{path} is not a study store but another kind of file. Give another --store."
                )
    except PermissionError as error:
        raise FileError(f"Cannot read the store {path}: {error.strerror}.") from None


def _engine(url: URL) -> Engine:
    if url.get_backend_name() == "postgresql":
        settings = {"connect_timeout": 10}  # s
        return create_engine(url, pool_size=1, pool_pre_ping=True, connect_args=settings)
    # SQLite itself waits so many seconds for a lock
    engine = create_engine(url, connect_args={"timeout": 5.0})

    @event.listens_for(engine, "connect")
    def _connected(connection: Any, _: Any) -> None:
        connection.isolation_level = None  # transactions are begun below, not by the driver

    @event.listens_for(engine, "begin")
    def _begun(connection: Connection) -> None:
        # a writer takes the lock at once: two readers that both want to write would deadlock
        writes = connection.get_execution_options().get("ematwin_writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine
