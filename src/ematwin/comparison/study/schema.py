"""Tables of a study store, and how older ones are brought up to date.

Parts that thousands of runs share (settings, versions) are kept once, as documents.
"""

from typing import Any

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    Double,
    Float,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    select,
)

from ematwin.comparison.study.rows import RowReader
from ematwin.comparison.study.run import RunSpec
from ematwin.comparison.study.seal import (
    DamagedError,
    called,
    document_key,
    row_checksum,
    study_checksum,
)
from ematwin.errors import FileError

FORMAT = "ematwin study"
SCHEMA = 2
SEALED = 2  # the first schema whose runs have checksums
_PAGE = 1000  # runs read at a time

# MIGRATIONS[n] are the statements that bring schema n + 1 to n + 2
MIGRATIONS: tuple[tuple[str, ...], ...] = (
    ("ALTER TABLE ematwin_runs ADD COLUMN checksum VARCHAR(16)",),
)

metadata = MetaData()

study = Table(
    "ematwin_study",
    metadata,
    Column("key", String(40), primary_key=True),  # format, schema, settings, checksum
    Column("value", Text, nullable=False),
)

documents = Table(
    "ematwin_documents",
    metadata,
    Column("key", String(24), primary_key=True),  # hash of the body
    Column("body", Text, nullable=False),  # JSON
)

runs = Table(
    "ematwin_runs",
    metadata,
    Column("id", String(24), primary_key=True),
    Column("case_name", Text, nullable=False),
    Column("faults", Text, nullable=False),  # JSON, as are found and the documents
    Column("algorithm", Text, nullable=False),
    Column("run", Integer, nullable=False),
    Column("seed", BigInteger, nullable=False),
    Column("record_seed", BigInteger, nullable=False),
    Column("settings", String(24), nullable=False),  # document
    Column("status", String(16), nullable=False),
    Column("found", Text, nullable=False),
    Column("cost", Double),  # NULL stands for NaN in all numbers
    Column("relative_misfit", Double),
    Column("err", Double),
    Column("err_wrapped", Double),
    Column("evaluations", BigInteger, nullable=False),
    Column("seconds", Double),
    Column("cpu_seconds", Double),
    Column("history", LargeBinary, nullable=False),  # ematwin.comparison.study.history.pack
    Column("stopped", Text, nullable=False),
    Column("provenance", String(24), nullable=False),  # document
    Column("checksum", String(16)),  # ematwin.comparison.study.seal.row_checksum
    Index("ematwin_runs_status", "id", "status"),  # resuming reads this, not the histories
)

claims = Table(
    "ematwin_claims",
    metadata,
    Column("id", String(24), primary_key=True),  # of a run that somebody is doing
    Column("owner", Text, nullable=False),
    Column("until", Float(53), nullable=False),  # s since 1970; after it the claim is void
)


def migrate(connection: Connection, found: int, where: str) -> None:
    """Bring an older schema up to date, or refuse a newer one; runs without checksums get them.

    Raises
    ------
    FileError
        If the store was made by a newer ematwin.
    DamagedError
        If a run that has no checksum yet cannot be read.
    """
    check_schema(found, where)
    if found == SCHEMA:
        return
    for statements in MIGRATIONS[found - 1 : SCHEMA - 1]:
        for statement in statements:
            connection.exec_driver_sql(statement)
    if found < SEALED:
        _seal_runs(connection)
    connection.execute(study.update().where(study.c.key == "schema").values(value=str(SCHEMA)))
    seal_study(connection)


def check_schema(found: int, where: str) -> None:
    """Raise `FileError` if a newer ematwin made the store."""
    if found > SCHEMA:
        raise FileError(
            f"The store {where} has schema {found}, and this ematwin knows up to {SCHEMA}. "
            "Update ematwin, or give another --store."
        )


def seal_study(connection: Connection) -> None:
    """Write the checksum of the study's own table, and a second copy of its settings."""
    pairs = {row.key: row.value for row in connection.execute(select(study))}
    connection.execute(study.delete().where(study.c.key == "checksum"))
    connection.execute(study.insert().values(key="checksum", value=study_checksum(pairs)))
    key = document_key(pairs["settings"])
    if connection.execute(select(documents.c.key).where(documents.c.key == key)).first() is None:
        connection.execute(documents.insert().values(key=key, body=pairs["settings"]))


def _seal_runs(connection: Connection) -> None:
    bodies = {row.key: row.body for row in connection.execute(select(documents))}
    reader = RowReader(bodies.get, sealed=False)
    last = ""
    while True:
        query = select(runs).where(runs.c.id > last).order_by(runs.c.id).limit(_PAGE)
        page = connection.execute(query).all()
        for row in page:
            values: dict[str, Any] = dict(row._mapping)
            one = reader.stored(values)
            if RunSpec.id.func(one.spec) != row.id:  # type: ignore[attr-defined]
                raise DamagedError(f"{called(values)} has other inputs than its id says")
            connection.execute(
                runs.update().where(runs.c.id == row.id).values(checksum=row_checksum(values))
            )
        if len(page) < _PAGE:
            return
        last = page[-1].id
