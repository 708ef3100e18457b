"""Tables of runs: recordings of several actuators, each judged by its twin.

A table of runs is a CSV or Parquet file, or a DataFrame, with a column ``path``: a recording, a
folder or a glob in each row. Further columns are optional: ``actuator`` (what judges it),
``serial`` (which one it is) and ``time`` (when it was recorded); all others become labels.
"""

import csv
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import FileError, InputError, RecordError
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.reading import read
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.gather import files_of
from ematwin.recordings.channel import Columns
from ematwin.recordings.formats.csv_dialect import Clock
from ematwin.recordings.recording import Recording
from ematwin.showing.results import is_frame

PATH = "path"
_OWN = (PATH, "actuator", "serial", "time")
_ENCODINGS = ("utf-8-sig", "cp1252")


@dataclass(frozen=True)
class Group:
    """The recordings of one actuator."""

    name: str  # its serial number, else the name of the actuator; "" where there is one alone
    known: Calibration
    recordings: list[Recording]  # in the order of the table


@dataclass(frozen=True)
class Runs:
    """Contents of a table of runs, as `ematwin.identify` and `ematwin.detect` take it."""

    groups: tuple[Group, ...]

    @property
    def recordings(self) -> list[Recording]:
        """Recordings of all actuators."""
        return [one for group in self.groups for one in group.recordings]


def is_table_of_runs(given: Any) -> bool:
    """Whether something is a table with a column ``path``."""
    if is_frame(given):
        return any(str(name).strip().casefold() == PATH for name in given.columns)
    if not isinstance(given, str | Path) or not Path(given).is_file():
        return False
    return PATH in _names_in(Path(given))


def listed(table: Any) -> Iterator[tuple[list[Path], datetime | None, dict[str, str]]]:
    """Files, time and all columns of each row of a table of runs; errors as of `read_runs`."""
    what = table if isinstance(table, str | Path) else "The table of runs"
    rows = list(_rows(table))
    if not rows:
        raise InputError(f"{what} names no recording; give a row for each.")
    clock = Clock.of([row.get("time", "") for row in rows])
    for n, row in enumerate(rows, 1):
        if not row[PATH]:
            raise InputError(f"{what} has no path in row {n}; name a recording, folder or glob.")
        start = _moment(row.get("time", ""), clock, f"{what}, row {n}")
        yield files_of(_folder(table) / row[PATH]), start, row


def _folder(table: Any) -> Path:
    """The folder relative to which the paths of a table are."""
    return Path(table).parent if isinstance(table, str | Path) else Path()


def read_runs(
    table: Any,
    actuator: Any = None,
    columns: Columns | Callable[[ParameterSet], Columns] = None,
    *,
    known_of: Callable[[Any, Path], Calibration],
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Runs:
    """Read the recordings that a table of runs names.

    Parameters
    ----------
    table : a CSV or Parquet file, relative to which its paths are, or a DataFrame
    actuator : of rows that name none
    columns : as of `ematwin.read`, or a function that gives it for an actuator
    known_of : makes a calibration from the name in a row, or None, and the first file of the row
    options : further ones of `ematwin.read`

    Raises
    ------
    InputError
        If the table cannot be used.
    FileError, RecordError, ParameterError
        If a recording or an actuator cannot be read.
    """
    folder = _folder(table)
    rows = list(listed(table))
    named: dict[str, Calibration] = {}
    groups: dict[tuple[str, str], Group] = {}
    for n, (files, start, row) in enumerate(rows, 1):
        judge, serial = row.get("actuator", ""), row.get("serial", "")
        if judge not in named:
            own = folder / judge if judge.endswith(".toml") else judge
            named[judge] = known_of(own or actuator, files[0])
        known = named[judge]
        group = groups.setdefault((serial, judge), Group(serial, known, []))
        found = read(
            files, columns(known.actuator) if callable(columns) else columns,
            actuator=known.actuator, split=True, **options,
        )  # fmt: skip
        labels = {name: text for name, text in row.items() if name not in _OWN and text}
        group.recordings.extend(
            one.changed(start=one.start or start, labels={**labels, **one.labels}) for one in found
        )
        if progress is not None:
            progress(n / len(rows))
    return Runs(tuple(_called_apart(list(groups.values()))))


def _names_in(path: Path) -> list[str]:
    """Names of the columns of a CSV or Parquet file, in small letters; none of other files."""
    if path.suffix.lower() == ".parquet":
        import pyarrow.parquet as pq

        try:
            return [name.strip().casefold() for name in pq.read_schema(path).names]
        except (OSError, ValueError):
            return []  # what is wrong with it is said where it is read as a recording
    if path.suffix.lower() not in (".csv", ".tsv", ".txt"):
        return []
    with path.open("rb") as file:
        line = file.readline(1 << 16)
    text = line.decode(_ENCODINGS[0], "replace")
    return [name.strip().casefold() for name in next(csv.reader([text], delimiter=_sign(text)), [])]


def _sign(header: str) -> str:
    """The delimiter of a header."""
    return max(",;\t", key=header.count)


def _rows(table: Any) -> Iterator[dict[str, str]]:
    """The rows of a table of runs, as texts by the name of the column in small letters."""
    rows: Iterable[dict[str, Any]]
    if is_frame(table):
        columns = [table[name].tolist() for name in table.columns]
        names = list(map(str, table.columns))
        rows = (dict(zip(names, cells, strict=True)) for cells in zip(*columns, strict=True))
    elif Path(table).suffix.lower() == ".parquet":
        import pyarrow.parquet as pq

        rows = pq.read_table(table).to_pylist()
    else:
        rows = _rows_of_csv(Path(table))
    for row in rows:
        # what is missing is None, or a NaN or NaT of pandas, none of which equals itself
        texts = {
            name.strip().casefold(): "" if cell is None or cell != cell else str(cell).strip()
            for name, cell in row.items()
        }
        if any(texts.values()):
            yield texts


def _rows_of_csv(path: Path) -> Iterator[dict[str, Any]]:
    content = path.read_bytes()
    for encoding in _ENCODINGS:
        with suppress(UnicodeDecodeError):
            lines = content.decode(encoding).splitlines()
            break
    else:
        raise FileError(f"Cannot read {path} as text; save it as UTF-8.")
    sign = _sign(lines[0])
    for n, row in enumerate(csv.DictReader(lines, delimiter=sign, restval=""), 1):
        if more := row.pop(None, None):
            raise InputError(
                f"{path} has {len(row) + len(more)} cells in row {n} and {len(row)} in its header; "
                f"put what holds a {sign!r} in quotes."
            )
        yield row


def _moment(text: str, clock: Clock | None, where: str) -> datetime | None:
    """A date, with or without a clock time, as a datetime."""
    if not text:
        return None
    with suppress(ValueError):
        return datetime.fromisoformat(text)
    with suppress(RecordError):
        if clock is not None and clock.is_dated:
            time = np.datetime64(int(clock.nanoseconds([text])[0]), "ns")
            moment: datetime = time.astype("datetime64[us]").item()
            return moment.replace(tzinfo=UTC) if clock.is_utc else moment
    raise InputError(
        f"{where} has the time {text!r}; write a date such as 2026-03-01 or 03.03.2026 09:14:02."
    )


def _called_apart(groups: list[Group]) -> Iterator[Group]:
    """Groups by serial number, else by the actuator's name; numbered where these are alike."""
    names = [group.name or group.known.actuator.name for group in groups]
    for n, (group, name) in enumerate(zip(groups, names, strict=True)):
        alike = names[:n].count(name)
        yield Group(f"{name} ({alike + 1})" if alike else name, group.known, group.recordings)
