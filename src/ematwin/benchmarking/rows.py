"""Runs as rows of a database and back, exact to the last bit, with a checksum in each row.

Parts that thousands of runs share (settings, versions) are kept once, as documents named by their
hash. A run's checksum is over all of its values, so that a changed bit anywhere in its row is
noticed when the row is read. 64 bits are plenty against chance; nobody is kept from changing a run
on purpose.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from sys import intern
from typing import Any

from sqlalchemy import (
    BigInteger,
    Column,
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

from ematwin.benchmarking.run import RunResult, RunSpec, StoredRun
from ematwin.errors import FileError

FORMAT = "ematwin study"
SCHEMA = 2  # of the tables below; that of version 0.2, too

SHARED = ("population", "iterations", "noise", "actuator", "scenario", "box", "model")
NUMBERS = ("cost", "relative_misfit", "err", "err_wrapped", "seconds", "cpu_seconds")

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
    Column("history", LargeBinary, nullable=False),  # ematwin.benchmarking.run.pack
    Column("stopped", Text, nullable=False),
    Column("provenance", String(24), nullable=False),  # document
    Column("checksum", String(16)),
    Index("ematwin_runs_status", "id", "status"),  # resuming reads this, not the histories
)

claims = Table(
    "ematwin_claims",
    metadata,
    Column("id", String(24), primary_key=True),  # of a run that somebody is doing
    Column("owner", Text, nullable=False),
    Column("until", Float(53), nullable=False),  # s since 1970; after it the claim is void
)

_SUMMED = tuple(column.name for column in runs.c if column.name not in ("history", "checksum"))


class DamagedError(FileError):
    """Something in a store is not as it was written."""


def row_of(one: StoredRun) -> dict[str, Any]:
    """Make the row of a run, with its checksum."""
    spec, result = one.spec, one.result
    row = {
        "id": spec.id,
        "case_name": str(spec.case),
        "faults": json.dumps(spec.faults),
        "algorithm": str(spec.algorithm),
        "run": int(spec.run),
        "seed": int(spec.seed),
        "record_seed": int(spec.record_seed),
        "settings": document(settings_of(spec))[0],
        "status": str(result.status),
        "found": json.dumps(result.faults),
        **{name: _or_null(getattr(result, name)) for name in NUMBERS},
        "evaluations": int(result.evaluations),
        "history": result.history,
        # no database takes NUL or half of a surrogate pair, which messages of failures may hold
        "stopped": result.stopped.replace("\0", "").encode("utf-8", "replace").decode(),
        "provenance": document(result.provenance)[0],
    }
    return {**row, "checksum": row_checksum(row)}


def run_of(row: Mapping[str, Any], documents: Mapping[str, Any]) -> StoredRun:
    """Make the run of a row.

    Parameters
    ----------
    documents : contents by key, see `contents`

    Raises
    ------
    DamagedError
        If the row, or a document that it names, is not as it was written.
    """
    if row["checksum"] != row_checksum(row):
        raise DamagedError(f"{_called(row)} differs from its checksum")
    for key in (row["settings"], row["provenance"]):
        if key not in documents:
            raise DamagedError(f"the document {key}, which runs share, is missing")
    spec = RunSpec(
        case=intern(row["case_name"]),
        faults=tuple(json.loads(row["faults"])),
        algorithm=intern(row["algorithm"]),
        run=row["run"],
        seed=row["seed"],
        record_seed=row["record_seed"],
        **documents[row["settings"]],
    )
    # the id is the key of the row: hashing 100,000 of them again would take half a minute
    spec.__dict__["id"] = row["id"]
    result = RunResult(
        id=row["id"],
        status=intern(row["status"]),
        faults=tuple(json.loads(row["found"])),
        **{name: math.nan if row[name] is None else float(row[name]) for name in NUMBERS},
        evaluations=row["evaluations"],
        history=bytes(row["history"]),
        stopped=row["stopped"],
        provenance=documents[row["provenance"]],
    )
    return StoredRun(spec, result)


def row_checksum(row: Mapping[str, Any]) -> str:
    """Hash the values of a row to 16 hexadecimal digits; the same for either database."""
    # a database may give 0.0 back as 0, and drops the sign of a negative zero
    values = [
        row[name] + 0.0 if name in NUMBERS and isinstance(row[name], int | float) else row[name]
        for name in _SUMMED
    ]
    digest = hashlib.sha256(ascii(values).encode())
    history = row["history"]
    digest.update(history if isinstance(history, bytes) else ascii(history).encode())
    return digest.hexdigest()[:16]


def settings_of(spec: RunSpec) -> dict[str, Any]:
    """Give the inputs of a run that it shares with the others of its study."""
    return {name: getattr(spec, name) for name in SHARED}


def document(value: Mapping[str, Any]) -> tuple[str, str]:
    """Give key and JSON text of values that many runs share."""
    text = json.dumps(value, sort_keys=True)
    return _key(text), text


def contents(bodies: Mapping[str, str]) -> dict[str, Any]:
    """Give the values of documents by key.

    Raises
    ------
    DamagedError
        If one is not as it was written.
    """
    for key, body in bodies.items():
        if not isinstance(body, str) or _key(body) != key:
            raise DamagedError(f"the document {key!a}, which runs share, differs from its key")
    return {key: json.loads(body) for key, body in bodies.items()}


def study_checksum(pairs: Mapping[str, str]) -> str:
    """Hash all entries of the study's table but its checksum."""
    said = {name: value for name, value in pairs.items() if name != "checksum"}
    return _key(json.dumps(said, sort_keys=True))


def _key(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:24]


def _called(row: Mapping[str, Any]) -> str:
    """Name a run by its case and algorithm, where its row can be read."""
    known = [row[name] for name in ("case_name", "algorithm") if isinstance(row[name], str)]
    words = ", ".join([*known, f"run {row['run']}"])
    return f"run {row['id']} ({words})".encode("ascii", "backslashreplace").decode()[:120]


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
