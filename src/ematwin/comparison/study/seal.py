"""Checksums of what a store holds: of each run, of each document, and of the study itself.

A run's checksum is over all of its values, so that a flipped bit anywhere in its row is noticed
when the row is read. Documents are named by their own hash. 64 bits are plenty against chance;
nobody is kept from changing a run on purpose.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from ematwin.errors import FileError

# of a row, in the order of the table; the checksum of a run is over these
COLUMNS = (
    "id", "case_name", "faults", "algorithm", "run", "seed", "record_seed", "settings", "status",
    "found", "cost", "relative_misfit", "err", "err_wrapped", "evaluations", "seconds",
    "cpu_seconds", "history", "stopped", "provenance",
)  # fmt: skip
NUMBERS = ("cost", "relative_misfit", "err", "err_wrapped", "seconds", "cpu_seconds")
_PLAIN = tuple(name for name in COLUMNS if name != "history")


class DamagedError(FileError):
    """Something in a store is not as it was written."""


def row_checksum(row: Mapping[str, Any]) -> str:
    """Of the values of a row, 16 hexadecimal digits; the same for either database."""
    # a database may give 0.0 back as 0, and drops the sign of a negative zero
    values = [
        row[name] + 0.0 if name in NUMBERS and isinstance(row[name], int | float) else row[name]
        for name in _PLAIN
    ]
    digest = hashlib.sha256(ascii(values).encode())
    history = row["history"]
    digest.update(history if isinstance(history, bytes) else ascii(history).encode())
    return digest.hexdigest()[:16]


def document_key(text: str) -> str:
    """The name of a document: a hash of its text, 24 hexadecimal digits."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:24]


def study_checksum(pairs: Mapping[str, str]) -> str:
    """Of what the table of the study says besides its checksum."""
    said = {name: value for name, value in pairs.items() if name != "checksum"}
    return document_key(json.dumps(said, sort_keys=True))


def called(row: Mapping[str, Any]) -> str:
    """A run, in words that its user knows, as far as its row can be read."""
    known = (row.get("case_name"), row.get("algorithm"))
    place = ", ".join(one for one in known if isinstance(one, str) and one.isprintable())
    number = row.get("run")
    named = f"{place}, run {number}" if isinstance(number, int) else place
    id = row.get("id")
    shown = id if isinstance(id, str) and id.isalnum() and id.isascii() else ascii(id)[:40]
    return f"run {shown} ({named})" if named else f"run {shown}"
