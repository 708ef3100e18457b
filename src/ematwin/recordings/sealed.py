"""Checksums of what a file of ematwin says of its recording, and of each of its columns.

They stand in the metadata themselves: ``checksums`` has one for each column, ``checksum`` is that
of all other metadata. Files of 0.1 have neither and are read as they are. Against chance only:
whoever changes a file on purpose can change the checksums, too.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import FileError

FORMAT = 1  # of the metadata of a recording; readers refuse what is newer
_OWN, _COLUMNS = "checksum", "checksums"
_REMAINS = re.compile(r'": "[0-9a-f]{32}"')
_STARTS = re.compile(r"([,;])([=+\-@])")


def sealed(metadata: Mapping[str, Any], columns: Mapping[str, Any]) -> dict[str, Any]:
    """Metadata with checksums of (S,) float64 columns, and of the metadata themselves."""
    plain = json.loads(json.dumps(metadata))
    whole = {**plain, _COLUMNS: {name: _of_column(values) for name, values in columns.items()}}
    return {**whole, _OWN: _of_metadata(whole)}


def note(metadata: Mapping[str, Any]) -> str:
    """Metadata as one line of JSON in which a spreadsheet finds no formula after a comma."""
    text = json.dumps(metadata, sort_keys=True)
    return _STARTS.sub(lambda found: f"{found[1]}\\u{ord(found[2]):04x}", text)


def unsealed(text: str, path: Path) -> dict[str, Any]:
    """Metadata of a note, verified if they were sealed.

    Raises
    ------
    FileError
        If they are not as they were written.
    """
    try:
        found = json.loads(text)
    except ValueError:
        raise damaged(path, "what it says of itself cannot be read") from None
    if not isinstance(found, dict):
        raise damaged(path, "what it says of itself cannot be read")
    if isinstance(found.get("format"), int) and found["format"] > FORMAT:
        return found  # of a newer ematwin, which the reader refuses in its own words
    # either shows that it was sealed, in case the other's name is what was damaged
    if (_OWN in found or _COLUMNS in found) and found.get(_OWN) != _of_metadata(found):
        raise damaged(path, "what it says of itself differs from its checksum")
    return found


def looks_sealed(text: str) -> bool:
    """Whether a text that nothing marks as ours was a sealed note, or what is left of one."""
    return _REMAINS.search(text) is not None


def verify(columns: Mapping[str, np.ndarray], metadata: Mapping[str, Any], path: Path) -> None:
    """Raise `FileError` if a column that was read, (S,) float64, differs from its checksum."""
    known = metadata.get(_COLUMNS)
    if known is None:
        return
    for name, values in columns.items():
        if known.get(name) != _of_column(values):
            raise damaged(path, f"column {name} differs from its checksum")


def damaged(path: Path, what: str) -> FileError:
    """What is said of a file of ours that is not as it was written."""
    return FileError(
        f"{path} was changed since ematwin wrote it: {what}. Copy it again; if it was changed on "
        "purpose, save it without its first line or metadata, as any other table."
    )


def _of_column(values: Any) -> str:
    plain: Any = np.ascontiguousarray(values, dtype=np.float64)
    return hashlib.sha256(plain).hexdigest()[:32]


def _of_metadata(metadata: Mapping[str, Any]) -> str:
    said = {name: value for name, value in metadata.items() if name != _OWN}
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:32]
