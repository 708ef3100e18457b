"""Writing columns to CSV and Parquet files, through pyarrow, with the metadata of a record if any.

Numbers survive the round trip bit for bit. The metadata of a record is one JSON object: in
Parquet it stands in the schema under ``ematwin``, in CSV in a first line ``# ematwin {...}``.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ematwin.errors import InputError
from ematwin.readers.files import written_whole

METADATA_KEY = "ematwin"
_CSV_MARK = f"# {METADATA_KEY} "


def write_table(
    path: str | Path, columns: Mapping[str, Any], metadata: dict[str, Any] | None = None
) -> None:
    """Write columns, and metadata if any, as Parquet or CSV, as the name of the file says."""
    import pyarrow as pa

    path = Path(path)
    kind = path.suffix.lower()
    if kind not in {".parquet", ".csv"}:
        raise InputError(f"Cannot tell how to write {path}: end its name in .parquet or .csv.")
    table = pa.table(dict(columns))
    note = None if metadata is None else json.dumps(metadata, sort_keys=True)
    with written_whole(path) as draft:
        if kind == ".parquet":
            import pyarrow.parquet as pq

            if note is not None:
                known = dict(table.schema.metadata or {})
                table = table.replace_schema_metadata({**known, METADATA_KEY: note})
            pq.write_table(table, draft, compression="zstd")
        else:
            from pyarrow import csv

            with draft.open("wb") as file:
                if note is not None:
                    file.write(f"{_CSV_MARK}{note}\n".encode())
                csv.write_csv(table, file)
