"""Tables of a study store, and how older ones are brought up to date.

Parts that thousands of runs share (settings, versions) are kept once, as documents.
"""

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
)

from ematwin.errors import FileError

FORMAT = "ematwin study"
SCHEMA = 1

# MIGRATIONS[n] are the statements that bring schema n + 1 to n + 2
MIGRATIONS: tuple[tuple[str, ...], ...] = ()

metadata = MetaData()

study = Table(
    "ematwin_study",
    metadata,
    Column("key", String(40), primary_key=True),  # format, schema, settings
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
    """Bring an older schema up to date, or refuse a newer one.

    Raises
    ------
    FileError
        If the store was made by a newer ematwin.
    """
    check_schema(found, where)
    if found == SCHEMA:
        return
    for statements in MIGRATIONS[found - 1 : SCHEMA - 1]:
        for statement in statements:
            connection.exec_driver_sql(statement)
    connection.execute(study.update().where(study.c.key == "schema").values(value=str(SCHEMA)))


def check_schema(found: int, where: str) -> None:
    """Raise `FileError` if a newer ematwin made the store."""
    if found > SCHEMA:
        raise FileError(
            f"The store {where} has schema {found}, and this ematwin knows up to {SCHEMA}. "
            "Update ematwin, or give another --store."
        )
