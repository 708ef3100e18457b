"""Records in files: `read` and `write`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, ParameterError, RecordError
from ematwin.quantities import parse_quantity
from ematwin.readers.bench_record import record_in, record_of_bench
from ematwin.readers.column_map import ColumnMap
from ematwin.readers.gaps import Policy, check_policy
from ematwin.readers.recording import Progress, Recording, open_recording
from ematwin.readers.resample import check_rate, to_constant_rate
from ematwin.readers.tables import write_table
from ematwin.signals.record import COLUMNS, UNITS, Record

FORMAT = 1  # of the metadata; readers refuse what is newer
WRITTEN = (".parquet", ".csv")  # endings that `write` knows


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


def read(
    path: str | Path,
    columns: ColumnMap | Mapping[str, Any] | str | Path | None = None,
    *,
    resample_to: float | str | None = None,
    gaps: Policy = "refuse",
    progress: Progress | None = None,
) -> Record:
    """Read a record from a file of ematwin or of a test bench.

    Parameters
    ----------
    path : a .csv, .parquet, .mat, .mf4, .mdf, .tdms, .h5 or .hdf5 file
    columns : which channel is which column: a `ColumnMap`, a mapping such as
        ``{"current_a": "Phase A [A]"}``, or a TOML file. None: channels named as in `COLUMNS`,
        an alias (``i_a``, ``t``) or a unit in brackets allowed
    resample_to : float (Hz) or text such as ``"20 kHz"``; None keeps the recorded rate
    gaps : "refuse"; "longest" takes the longest stretch without holes; "mask" fills holes and
        lists them in ``provenance["masked_s"]``
    progress : called with the share read, in [0, 1], now and then

    Returns
    -------
    Record
        A file that `write` made, read without a map, comes back bit for bit. Of others, the
        provenance says which channel became what (``columns``), what was taken for granted
        (``assumed``) and what was done (``changed``), with sentences to show (``warnings``).

    Raises
    ------
    InputError
        If the map or an option cannot be used.
    FileError
        If the file cannot be read.
    RecordError
        If a column is missing or holds what a record cannot.
    MissingExtraError
        If the library for this format is not installed.
    """
    column_map = ColumnMap.of(columns)
    check_policy(gaps)
    rate = _hertz(resample_to)
    path = Path(path)
    with open_recording(path, **column_map.csv.model_dump(exclude_none=True)) as recording:
        _check_format(recording)
        if recording.metadata and columns is None:
            own = _own(recording, progress)
            return own if rate is None else _at_rate(own, rate, path)
        return record_of_bench(recording, column_map, rate, gaps, progress)


def _own(recording: Recording, progress: Progress | None) -> Record:
    """What `write` wrote, unchanged."""
    known = [name for name in COLUMNS if name in recording.names]
    for name in ("time", "command"):
        if name not in known:
            raise RecordError(
                f"{recording.path} has no column {name!r}; it has {', '.join(recording.names)}. "
                "Rename or add the column."
            )
    for name, unit in recording.metadata.get("units", {}).items():
        if name in UNITS and unit != UNITS[name]:
            raise RecordError(
                f"{recording.path} gives {name} in {unit}; a record holds it in {UNITS[name]}. "
                "Convert it."
            )
    values = recording.read(known, progress)
    source = {"source": "file", "file": recording.path.name}
    return record_in(values, recording.metadata.get("provenance") or source, recording.path)


def _at_rate(record: Record, rate: float, path: Path) -> Record:
    columns = dict(record.columns())
    time, columns, changed = to_constant_rate(columns.pop("time"), columns, rate, path)
    provenance = dict(record.provenance)
    provenance["changed"] = [*provenance.get("changed", []), *changed]
    return record_in({"time": time, **columns}, provenance, path)


def _check_format(recording: Recording) -> None:
    found = recording.metadata.get("format", FORMAT)
    if found > FORMAT:
        raise RecordError(
            f"{recording.path} was written by a newer ematwin (format {found}, this one knows "
            f"{FORMAT}). Update ematwin."
        )


def _hertz(rate: float | str | None) -> float | None:
    if isinstance(rate, str):
        try:
            rate = parse_quantity(rate, "Hz", "resample_to")
        except ParameterError as error:
            raise InputError(str(error)) from None
    check_rate(rate)
    return rate
