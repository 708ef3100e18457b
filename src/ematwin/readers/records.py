"""Records in files: `read` and `write`."""

from pathlib import Path
from typing import Any

from ematwin.errors import RecordError
from ematwin.readers.tables import column_values, read_table, write_table
from ematwin.signals.record import COLUMNS, UNITS, Record

FORMAT = 1  # of the metadata; readers refuse what is newer


def write(record: Record, path: str | Path) -> None:
    """Write a record to a Parquet or CSV file; what is read back is equal, bit for bit.

    Raises
    ------
    FileError
        If the file cannot be written; nothing is left half-written.
    """
    columns = dict(record.columns())
    metadata: dict[str, Any] = {
        "format": FORMAT,
        "units": {name: UNITS[name] for name in columns},
        "provenance": record.provenance,
    }
    write_table(path, columns, metadata)


def read(path: str | Path) -> Record:
    """Read a record from a Parquet or CSV file with columns named as in `COLUMNS`.

    Columns of other names are ignored.

    Raises
    ------
    FileError
        If the file cannot be read.
    RecordError
        If a column is missing or holds what a record cannot.
    """
    table, metadata = read_table(path)
    if metadata.get("format", FORMAT) > FORMAT:
        raise RecordError(
            f"{path} was written by a newer ematwin (format {metadata['format']}, this one knows "
            f"{FORMAT}). Update ematwin."
        )
    known = [name for name in COLUMNS if name in table.column_names]
    for name in ("time", "command"):
        if name not in known:
            raise RecordError(
                f"{path} has no column {name!r}; it has {', '.join(table.column_names)}. "
                "Rename or add the column."
            )
    for name, unit in metadata.get("units", {}).items():
        if name in UNITS and unit != UNITS[name]:
            raise RecordError(
                f"{path} gives {name} in {unit}; a record holds it in {UNITS[name]}. Convert it."
            )
    values = {name: column_values(table, name, path) for name in known}
    provenance = metadata.get("provenance") or {"source": "file", "file": Path(path).name}
    try:
        return Record(**values, provenance=provenance)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from None
