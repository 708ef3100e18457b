"""Recordings as they are given: themselves, files, folders, globs, or a table of runs.

A table of runs names recordings of several actuators, each judged by its twin. It is a CSV or
Parquet file, or a DataFrame, with a column ``path``: a recording, a folder or a glob in each row.
Further columns are optional: ``actuator`` (what judges it), ``serial`` (which one it is) and
``time`` (when it was recorded); all others become labels.
"""

import csv
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from glob import glob
from pathlib import Path
from typing import Any

from ematwin.errors import FileError, InputError, RecordError
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.reading import actuator_for, read
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.calibration import Calibration
from ematwin.recordings.channel import Columns
from ematwin.recordings.formats.base import known_suffixes, moment
from ematwin.recordings.formats.csv_dialect import Clock
from ematwin.recordings.recording import Recording
from ematwin.showing.results import is_frame

Given = Recording | str | Path | Iterable[Recording | str | Path]  # or a DataFrame, or several
_GLOB = re.compile(r"[*?\[]")
PATH = "path"
_OWN = (PATH, "actuator", "serial", "time")
_ENCODINGS = ("utf-8-sig", "cp1252")


def recordings_of(
    given: Given, actuator: ParameterSet, columns: Columns = None, *, averaged: bool = True
) -> list[Recording]:
    """Recordings at the rate at which they are compared; files are read as the actuator's kind.

    A table of several motions gives each of them. ``averaged`` False keeps the recorded rate.
    `InputError` if nothing is given, or something that is no recording.
    """
    single = _is_single(given)
    if not (single or isinstance(given, Iterable)):
        raise InputError(f"Give recordings, DataFrames or the paths of files, received {given!r}.")
    items: Iterable[Any] = [given] if single else given  # type: ignore[assignment]
    found: list[Recording] = []
    for n, one in enumerate(items, 1):
        if isinstance(one, Recording):
            if columns is not None:
                raise InputError("A Recording has its channels already; leave columns out.")
            own = [one]
        elif isinstance(one, str | Path) or is_frame(one):
            own = read(
                one if is_frame(one) else files_of(one), columns, actuator=actuator, split=True
            )
        else:
            raise InputError(
                f"Give recordings, DataFrames or the paths of files, received {type(one).__name__}."
            )
        # what comes from no file is a run of its own
        if not (single or isinstance(one, str | Path) or Path(own[-1].source).suffix):
            own = [
                each.changed(labels={**each.labels, "run": each.labels.get("run", str(n))})
                for each in own
            ]
        found += own
    if not found:
        raise InputError("No recording was given; give at least one.")
    return [model_of(actuator).averaged(one) for one in found] if averaged else found


def actuator_of(given: Given, columns: Columns = None) -> ParameterSet:
    """The actuator that is meant where none is named, by the first recording that is given."""
    # an iterator is not looked into: its first recording would be gone
    several = isinstance(given, Collection) and not _is_single(given)
    first = next(iter(given), None) if several else given  # type: ignore[arg-type]
    if isinstance(first, str | Path):
        first = files_of(first)[0]
    if first is None or not (isinstance(first, Recording | Path) or is_frame(first)):
        return load_actuator()  # what is wrong with it is said where it is read
    return actuator_for(first, columns)


def is_one(given: Any) -> bool:
    """Whether a recording, a DataFrame, or the path of one file is given."""
    if isinstance(given, str | Path):
        return not (Path(given).is_dir() or _is_glob(given))
    return _is_single(given)


def _is_single(given: Any) -> bool:
    return isinstance(given, Recording | str | Path | Mapping) or is_frame(given)


def files_of(path: str | Path) -> list[Path]:
    """The files of recordings that a path, a folder or a glob means, day2 before day10.

    `InputError` if a folder or a glob holds none.
    """
    path = Path(path)
    if not (path.is_dir() or _is_glob(path)):
        return [path]
    inside = path.iterdir() if path.is_dir() else map(Path, glob(str(path)))
    known = set(known_suffixes())
    found = [one for one in inside if one.suffix.lower() in known and one.is_file()]
    if not found:
        raise InputError(f"{path} holds no recording: no file ends in {', '.join(sorted(known))}.")
    return sorted(found, key=_in_order)


def _is_glob(path: str | Path) -> bool:
    return bool(_GLOB.search(str(path))) and not Path(path).exists()


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Numbers within a name count as numbers."""
    return [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", str(path))]


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
    """Read the recordings that a table of runs names; `InputError` if it cannot be used.

    Parameters
    ----------
    table : a CSV or Parquet file, relative to which its paths are, or a DataFrame
    actuator : of rows that name none
    columns : as of `ematwin.read`, or a function that gives it for an actuator
    known_of : makes a calibration from the name in a row, or None, and the first file of the row
    options : further ones of `ematwin.read`
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
    rows: Iterable[dict[Any, Any]]
    if is_frame(table):
        rows = table.to_dict("records")
    elif Path(table).suffix.lower() == ".parquet":
        import pyarrow.parquet as pq

        rows = pq.read_table(table).to_pylist()
    else:
        rows = _rows_of_csv(Path(table))
    for row in rows:
        # what is missing is None, or a NaN or NaT of pandas, none of which equals itself
        texts = {
            str(name).strip().casefold(): "" if cell is None or cell != cell else str(cell).strip()
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
            return moment(clock.times([text])[0], clock.zone)
    raise InputError(
        f"{where} has the time {text!r}; write a date such as 2026-03-01 or 03.03.2026 09:14:02."
    )


def _called_apart(groups: list[Group]) -> Iterator[Group]:
    """Groups by serial number, else by the actuator's name; numbered where these are alike."""
    names = [group.name or group.known.actuator.name for group in groups]
    for n, (group, name) in enumerate(zip(groups, names, strict=True)):
        alike = names[:n].count(name)
        yield replace(group, name=f"{name} ({alike + 1})" if alike else name)
