"""Writing columns and recordings to CSV and Parquet files, through pyarrow, bit for bit.

All else about a recording is kept as one JSON object: in Parquet in the schema under ``ematwin``,
in CSV in a first line ``# ematwin {...}``. A changed file is recognised by its checksums: one for
each column, so that a column can be read alone, and one over all else. Files of 0.1 have none and
are read as they are. Against chance only: whoever changes a file on purpose can change these, too.
A table of several recordings has labels and units in its columns alone.

No text in a CSV starts a formula: spreadsheets compute a cell that begins with = + - @, a tab or a
line break (OWASP, "CSV injection"). An apostrophe before it makes it a text. Numbers stay numbers.
"""

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import FileError, InputError, RecordError
from ematwin.files import check_target, written_whole
from ematwin.recordings.channel import TIME, Channel, with_time
from ematwin.recordings.recording import Recording
from ematwin.validation import refuse_newer

_FORMULA = re.compile(r"'*[=+\-@\t\r\n]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|-?(inf|nan)|-{1,3}")


def write_recording(
    recording: Recording, path: str | Path, channels: Sequence[Channel] = ()
) -> None:
    """Write one recording as Parquet or CSV, by the ending; it is read back equal, bit for bit.

    ``channels`` of its kind give the units of channels that have none.
    """
    columns = dict(recording.columns())
    metadata: dict[str, Any] = {
        "format": FORMAT, "units": _units([recording], channels),
        "provenance": recording.provenance,
        "means": [one.name for one in channels if one.is_mean and one.name in columns],
    }  # fmt: skip
    if recording.labels:
        metadata["labels"] = recording.labels
    if recording.start is not None:
        metadata["start"] = recording.start.isoformat()
    write_table(path, columns, with_checksums(metadata, columns))


def write_recordings(
    recordings: Sequence[Recording], path: str | Path, channels: Sequence[Channel] = ()
) -> None:
    """Write several recordings as one table, as a test bench would: labels, time, channels.

    Units stand in the names of the columns: ``load [N*m]``.
    """
    if not recordings:
        raise InputError("There are no recordings to write; give at least one.")
    names = list(recordings[0].channels)
    for one in recordings:
        if set(one.channels) != set(names):
            raise RecordError(
                f"{one.name} has the channels {', '.join(one.channels)}, {recordings[0].name} has "
                f"{', '.join(names)}; a table needs the same in all. Write them one by one."
            )
    columns: dict[str, Any] = {}
    for label in dict.fromkeys(label for one in recordings for label in one.labels):
        columns[label] = [one.labels.get(label, "") for one in recordings for _ in one.time]
    units = _units(recordings, channels)
    for name in (TIME.name, *names):
        unit = units.get(name, "")
        parts = [one.time if name == TIME.name else one.channels[name] for one in recordings]
        columns[f"{name} [{unit}]" if unit else name] = np.concatenate(parts)
    write_table(path, columns)


def _units(recordings: Sequence[Recording], channels: Sequence[Channel]) -> dict[str, str]:
    """Units of time and channels as a recording states them, else as its kind does."""
    known = {one.name: one.unit for one in with_time(channels)}
    units = {TIME.name: TIME.unit}
    for recording in reversed(recordings):  # the first that states one counts
        own = known | recording.units
        units |= {name: own[name] for name in recording.channels if name in own}
    return units


def write_rows(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows, with a column for each name that some row has, as Parquet or CSV."""
    names = dict.fromkeys(name for row in rows for name in row)
    write_table(path, {name: [row.get(name) for row in rows] for name in names})


def write_table(path: str | Path, columns: Mapping[str, Any], metadata: str | None = None) -> None:
    """Write columns, and metadata if any, as Parquet or CSV, as the name of the file says."""
    import pyarrow as pa

    path = Path(path)
    check_target(path, (".parquet", ".csv"))
    kind = path.suffix.lower()
    if kind == ".csv":
        columns = {
            no_formula(name): x if isinstance(x, np.ndarray) else [no_formula(cell) for cell in x]
            for name, x in columns.items()
        }
    table = pa.table({name: from_numpy(values) for name, values in columns.items()})
    with written_whole(path) as draft:
        if kind == ".parquet":
            from pyarrow.parquet import write_table as write

            if metadata is not None:
                table = table.replace_schema_metadata({KEY: metadata})
            write(table, draft, compression="zstd", write_page_checksum=True)
        else:
            from pyarrow.csv import write_csv

            with draft.open("wb") as file:
                if metadata is not None:
                    file.write(f"{MARK}{metadata}\n".encode())
                write_csv(table, file)


def no_formula(cell: Any) -> Any:
    """A cell, with an apostrophe before a text that a spreadsheet would compute.

    Texts such as ``-1.5`` are left as they are, and dashes alone, which stand for missing values.
    """
    computed = isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell)
    return f"'{cell}" if computed else cell


def without_apostrophe(text: str) -> str:
    """The text before `no_formula` changed it."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def to_numpy(column: Any) -> np.ndarray:
    """Values (S,) of an array of pyarrow of floats, with NaN where it has nulls.

    The conversion of pyarrow imports pandas, which takes longer than reading a recording.
    """
    return np.from_dlpack(column.fill_null(math.nan) if column.null_count else column)


def from_numpy(values: Any) -> Any:
    """An array of pyarrow of a numpy array of floats, in the same way; else what pyarrow makes."""
    import pyarrow as pa

    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.ndim == 1:
        buffer = pa.py_buffer(np.ascontiguousarray(values))
        return pa.Array.from_buffers(pa.float64(), len(values), [None, buffer])
    return pa.array(values)


NAT = np.iinfo(np.int64).min  # NaT of numpy as a number of ticks
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
