"""Metadata of a recording in a file, with the checksum by which a changed file is recognised.

The metadata are one JSON object: in Parquet it stands in the schema under ``ematwin``, in CSV in a
first line ``# ematwin {...}``. ``checksums`` has one for each column, so that a column can be read
alone; ``checksum`` is over all other metadata. Files of 0.1 have neither and are read as they
are. Against chance only: whoever changes a file on purpose can change the checksums, too.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.validation import refuse_newer

FORMAT = 1  # of the metadata of a recording; readers refuse what is newer
KEY = "ematwin"
MARK = f"# {KEY} "  # of the first line of a CSV


def with_checksums(metadata: Mapping[str, Any], columns: Mapping[str, Any]) -> str:
    """One line of JSON: metadata, and checksums of them and of (S,) float64 columns."""
    checksums = {name: _of_column(values) for name, values in columns.items()}
    whole = json.loads(json.dumps({**metadata, "checksums": checksums}))
    text = json.dumps({**whole, "checksum": _of_metadata(whole)}, sort_keys=True)
    return re.sub(r"([,;])([=+\-@])", lambda m: f"{m[1]}\\u{ord(m[2]):04x}", text)


def checked(text: str | None, path: Path, others: str = "") -> dict[str, Any]:
    """The metadata in a file, from ``text`` as `with_checksums` made it; empty for files of others.

    ``others`` is whatever else stands there, by which ours are recognised without their mark.
    Raises `FileError` if they were changed.
    """
    if text is None:
        if re.search(r'": "[0-9a-f]{32}"', others):
            raise _damaged(path, "what it says of itself has lost its mark")
        return {}
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise _damaged(path, "what it says of itself cannot be read")
    refuse_newer(str(path), found.get("format"), FORMAT, RecordError)
    # either shows that it had checksums, in case the other's name is what was damaged
    if {"checksum", "checksums"} & found.keys() and found.get("checksum") != _of_metadata(found):
        raise _damaged(path, "what it says of itself differs from its checksum")
    return found


def verify(columns: Mapping[str, np.ndarray], metadata: Mapping[str, Any], path: Path) -> None:
    """Raise `FileError` if a column that was read, (S,) float64, differs from its checksum."""
    known = metadata.get("checksums")
    for name, values in columns.items():
        if known is not None and known.get(name) != _of_column(values):
            raise _damaged(path, f"column {name} differs from its checksum")


def _damaged(path: Path, what: str) -> FileError:
    return FileError(
        f"{path} was changed since ematwin wrote it: {what}. Copy it again; if it was changed on "
        "purpose, save it without its first line or metadata, as any other table."
    )


def _of_column(values: Any) -> str:
    content = np.ascontiguousarray(values, dtype=np.float64)
    return hashlib.sha256(content.data).hexdigest()[:32]


def _of_metadata(metadata: Mapping[str, Any]) -> str:
    rest = {name: value for name, value in metadata.items() if name != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()[:32]
