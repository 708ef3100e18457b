"""CSV exports of the TwinCAT Scope: a block for the recording, a block for its channels, rows.

Beckhoff Information System, TE13xx TC3 Scope View, "Export to CSV". A cell of the channels' block
that repeats the key of its line (``Name``) stands above a column of times; columns up to the next
one share it. Times are ms since the start of the export, or ticks of 100 ns since 1601.
"""

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ematwin.errors import FileError
from ematwin.recordings.formats.arrow import to_numpy
from ematwin.recordings.formats.base import Progress, RecordedFile, refusing
from ematwin.recordings.formats.csv_dialect import CsvDialect
from ematwin.recordings.formats.csv_file import CsvFile

_HEAD = 1 << 16  # bytes in which the block of the recording ends
_TICK = 1e-7  # s
_EPOCH = datetime(1601, 1, 1, tzinfo=UTC)
_TICKS_FROM = 10**15  # a time beyond it is counted in ticks, which are too many for a float
_LATE = 1.5  # samples by which the last one may be before the stated end
_START, _END = "Starttime of export", "Endtime of export"
_PAIR = re.compile(r"^Name(?P<sign>[\t;|,])(?P<name>[^\r\n]*)\r?\n", re.MULTILINE)


class _Column(NamedTuple):
    place: int
    time: int  # place of its column of times
    unit: str


def is_export(path: Path) -> bool:
    """Whether a text file begins as an export of the TwinCAT Scope does."""
    with path.open("rb") as file:
        head = file.read(_HEAD).decode("utf-8-sig", "replace")
    return _PAIR.match(head) is not None and f"\n{_START}" in head


class TwinCatFile(CsvFile):
    """An export of the TwinCAT Scope; each column of times is a time base."""

    kind: ClassVar[str] = "TwinCAT Scope CSV"
    _last_row = "EOF"
    texts = RecordedFile.texts  # its columns are numbers

    def __init__(self, path: Path) -> None:
        RecordedFile.__init__(self, path)  # its block of names is no dialect to be recognised
        head: list[str] = []
        with path.open("r", encoding="utf-8-sig", errors="replace", newline="") as file:
            first = file.readline()
            self._sign = first[len("Name")]
            told = [line.rstrip("\r\n").split(self._sign) for line in self._block(file, head)]
            block = [line.rstrip("\r\n").split(self._sign) for line in self._block(file, head)]
            cell = file.readline().partition(self._sign)[0]
        self._in_ticks = cell.isdigit() and int(cell) > _TICKS_FROM
        facts = {row[0]: row[1] for row in told if len(row) > 1}
        names = next((row for row in block if row[0] == "Name"), None)
        if names is None or len(names) < 2:
            raise FileError(
                f"Cannot read {path} as {self.kind}: it has no line of channels' names. Export it "
                "again with its header."
            )
        units = next((row for row in block if row[0] == "Unit"), [])
        self._dialect = self._rows(1 + len(head), len(names))
        time = 0
        for place, name in enumerate(names):
            if name == "Name":
                time = place
            elif name.strip():
                unit = units[place].partition(" (")[0].strip() if place < len(units) else ""
                unit = "" if unit == "(None)" else unit
                self.channels[name.strip()] = _Column(place, time, unit)
        self._began, self._ended = (_ticks(facts.get(key, "")) for key in (_START, _END))
        if self._began:
            self.start = _EPOCH + timedelta(microseconds=self._began // 10)

    def _rows(self, skipped: int, width: int) -> CsvDialect:
        """How the rows below some lines are written."""
        with self.path.open("rb") as file:
            for _ in range(skipped):
                file.readline()
            start = file.tell()
            sample = file.read(_HEAD).decode("utf-8", "replace")
        line = sample.partition("\n")[0].rstrip("\r")
        if line.endswith(self._sign) and line.count(self._sign) == width:
            width += 1  # older versions end each row with a delimiter
        decimal = "," if self._sign != "," and "," in sample else "."
        names = [str(place) for place in range(width)]
        return CsvDialect(names, [""] * width, self._sign, decimal, "utf-8", start)

    @staticmethod
    def _block(file: Any, head: list[str]) -> list[str]:
        """The next lines up to an empty one, the empty ones before them left out."""
        found: list[str] = []
        for line in file:
            head.append(line)
            if line.strip():
                found.append(line)
            elif found:
                break
        return found

    def unit(self, name: str) -> str | None:  # noqa: D102
        return self.channels[name].unit or None

    def time_base(self, name: str) -> str:  # noqa: D102
        own = self.channels[name].time
        # columns with the same times are one base: most exports repeat them for each channel
        equal = (k for k, v in self._stamps.items() if np.array_equal(v, self._stamps[own], True))
        return str(next(equal))

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        values = self._stamps[int(key)]
        values = values[np.isfinite(values)]
        if not values.size:
            raise FileError(f"Cannot read {self.path} as {self.kind}: it holds no rows.")
        times = values * 1e-3
        step = times[1] - times[0] if times.size > 1 else 0.0
        length = (self._ended - self._began) * _TICK if self._began and self._ended else 0.0
        longest = max(int(np.isfinite(one).sum()) for one in self._stamps.values())
        if times[-1] + _LATE * step < length and times.size == longest:
            raise FileError(
                f"Cannot read {self.path} as {self.kind}: it ends at {times[-1]:.6g} s of "
                f"{length:.6g} s. It was truncated; export it again."
            )
        return np.asarray(times)

    @cached_property
    def _stamps(self) -> dict[int, np.ndarray]:
        """Each column of times (S,), ms, by its place; NaN where a cell is empty."""
        places = sorted({column.time for column in self.channels.values()})
        return self._read(places, self._in_ticks)

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        columns = [self.channels[name] for name in names]
        values = self._read(sorted({column.place for column in columns}))
        found = {}
        for name, (place, time, _) in zip(names, columns, strict=True):
            # a fast channel has rows in which slow ones are empty
            found[name] = values[place][np.isfinite(self._stamps[time])]
        if progress is not None:
            progress(1.0)
        return found

    def _read(self, places: Sequence[int], ticks: bool = False) -> dict[int, np.ndarray]:
        """Columns (S,) by their place; those in ticks become ms since the start of the export."""
        import pyarrow as pa
        import pyarrow.compute as pc

        types = dict.fromkeys(places, pa.int64() if ticks else pa.float64())
        parts: dict[int, list[np.ndarray]] = {place: [] for place in places}
        began = self._began
        with refusing(self.path, self.kind):
            self._check_end()
            for batch, _ in self._batches(places, types):
                for place, column in zip(places, batch.columns, strict=True):
                    if ticks:
                        began = began or column[0].as_py()
                        since = pc.subtract(column, began).cast(pa.float64())
                        column = pc.multiply(since, 1e3 * _TICK)
                    parts[place].append(np.array(to_numpy(column)))
        return {place: np.concatenate(parts.pop(place)) for place in places}

    def _check_end(self) -> None:
        with self.path.open("rb") as file:
            file.seek(max(self.path.stat().st_size - _HEAD, 0))
            if not file.read().rstrip(b"\r\n \0").endswith(b"EOF"):
                super()._check_end()


def _ticks(text: str) -> int:
    return int(text) if text.strip().isdigit() else 0
