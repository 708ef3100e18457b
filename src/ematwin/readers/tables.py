"""Columns of CSV and Parquet files, through pyarrow, and the metadata of a record in them.

Numbers survive the round trip bit for bit. The metadata of a record is one JSON object: in
Parquet it stands in the schema under ``ematwin``, in CSV in a first line ``# ematwin {...}``.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import FileError, InputError, RecordError
from ematwin.readers.files import written_whole

METADATA_KEY = "ematwin"
_CSV_MARK = f"# {METADATA_KEY} "


def read_table(path: str | Path) -> tuple[Any, dict[str, Any]]:
    """A pyarrow Table and the metadata object ({} if the file has none).

    Raises
    ------
    FileError
        If the file cannot be read, or is truncated, or is not what its name says.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if not path.exists():
        raise FileError(f"There is no file {path}.")
    try:
        if kind == ".parquet":
            return _read_parquet(path)
        if kind == ".csv":
            return _read_csv(path)
    except FileError:
        raise
    except Exception as error:
        # pyarrow reports damage as ArrowInvalid, OSError, UnicodeDecodeError and others
        reason = str(error).splitlines()[0].rstrip(".")
        raise FileError(
            f"Cannot read {path} as {kind[1:]}: {reason}. It may be truncated or of another kind."
        ) from None
    raise InputError(f"Cannot tell how to read {path}: its name must end in .parquet or .csv.")


def _read_parquet(path: Path) -> tuple[Any, dict[str, Any]]:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    metadata = (table.schema.metadata or {}).get(METADATA_KEY.encode())
    return table, json.loads(metadata) if metadata else {}


def _read_csv(path: Path) -> tuple[Any, dict[str, Any]]:
    from pyarrow import csv

    metadata: dict[str, Any] = {}
    comments = 0
    with path.open(encoding="utf-8") as file:
        for line in file:
            if not line.startswith("#"):
                break
            comments += 1
            if line.startswith(_CSV_MARK):
                metadata = json.loads(line[len(_CSV_MARK) :])
    table = csv.read_csv(path, read_options=csv.ReadOptions(skip_rows=comments))
    if table.num_rows == 0:
        raise FileError(f"{path} holds a header and no rows.")
    return table, metadata


def write_table(path: str | Path, columns: dict[str, np.ndarray], metadata: dict[str, Any]) -> None:
    """Write columns and metadata as Parquet or CSV, as the name of the file says."""
    import pyarrow as pa

    path = Path(path)
    kind = path.suffix.lower()
    if kind not in {".parquet", ".csv"}:
        raise InputError(f"Cannot tell how to write {path}: end its name in .parquet or .csv.")
    table = pa.table(columns)
    note = json.dumps(metadata, sort_keys=True)
    with written_whole(path) as draft:
        if kind == ".parquet":
            import pyarrow.parquet as pq

            known = dict(table.schema.metadata or {})
            table = table.replace_schema_metadata({**known, METADATA_KEY: note})
            pq.write_table(table, draft, compression="zstd")
        else:
            from pyarrow import csv

            with draft.open("wb") as file:
                file.write(f"{_CSV_MARK}{note}\n".encode())
                csv.write_csv(table, file)


def column_values(table: Any, name: str, path: str | Path) -> np.ndarray:
    """A column of a table as float64; raise `RecordError` if it does not hold numbers."""
    import pyarrow as pa

    column = table.column(name)
    try:
        return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False))
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        raise RecordError(
            f"Column {name} of {path} must hold numbers; it holds {column.type}. "
            "Remove text and units from its rows."
        ) from None


def read_columns(
    path: str | Path, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Named columns of a file as float64 arrays.

    Raises
    ------
    RecordError
        If a required column is missing or does not hold numbers.
    """
    table, _ = read_table(path)
    missing = [name for name in required if name not in table.column_names]
    if missing:
        raise RecordError(
            f"{path} has no column {missing[0]!r}; it has {', '.join(table.column_names)}. "
            "Rename or add the column."
        )
    wanted = [*required, *(name for name in optional if name in table.column_names)]
    return {name: column_values(table, name, path) for name in wanted}
