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
from ematwin.recordings.formats.arrow import as_floats
from ematwin.recordings.formats.base import Progress, RecordedFile, refusing

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


class TwinCatFile(RecordedFile):
    """An export of the TwinCAT Scope; each column of times is a time base."""

    kind: ClassVar[str] = "TwinCAT Scope CSV"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        head: list[str] = []
        with path.open("r", encoding="utf-8-sig", errors="replace", newline="") as file:
            first = file.readline()
            self._sign = first[len("Name")]
            told = [line.rstrip("\r\n").split(self._sign) for line in self._block(file, head)]
            block = [line.rstrip("\r\n").split(self._sign) for line in self._block(file, head)]
            cell = file.readline().partition(self._sign)[0]
        self._in_ticks = cell.isdigit() and int(cell) > _TICKS_FROM
        self._skipped = 1 + len(head)
        facts = {row[0]: row[1] for row in told if len(row) > 1}
        names = next((row for row in block if row[0] == "Name"), None)
        if names is None or len(names) < 2:
            raise FileError(
                f"Cannot read {path} as {self.kind}: it has no line of channels' names. Export it "
                "again with its header."
            )
        units = next((row for row in block if row[0] == "Unit"), [])
        self._width = len(names)
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
        from pyarrow import csv

        keys = [f"c{n}" for n in range(self._width)]
        with refusing(self.path, self.kind):
            with self.path.open("rb") as file:
                for _ in range(self._skipped):
                    file.readline()
                rows = file.read()
            whole = rows.rstrip(b"\r\n \0").removesuffix(b"EOF")
            if whole == rows:
                said = "the file ends without a line break: its last row was taken as it stands"
                self.assumed = [*dict.fromkeys([*self.assumed, said])]
            sample = whole[:_HEAD].decode("utf-8", "replace")
            line = sample.partition("\n")[0].rstrip("\r")
            if line.endswith(self._sign) and line.count(self._sign) == self._width:
                keys.append("end")  # older versions end each row with a delimiter
            decimal = "," if self._sign != "," and "," in sample else "."
            table = csv.read_csv(
                pa.BufferReader(whole),
                read_options=csv.ReadOptions(column_names=keys),
                parse_options=csv.ParseOptions(delimiter=self._sign),
                convert_options=csv.ConvertOptions(
                    include_columns=[keys[place] for place in places],
                    column_types={
                        keys[place]: pa.int64() if ticks else pa.float64() for place in places
                    },
                    null_values=["", " "],
                    decimal_point=decimal,
                ),
            )
        columns = [table.column(n).combine_chunks() for n in range(len(places))]
        if ticks:
            began = self._began or columns[0][0].as_py()
            columns = [
                pc.multiply(pc.subtract(one, began).cast(pa.float64()), 1e3 * _TICK)
                for one in columns
            ]
        found = (np.array(as_floats(one)) for one in columns)
        return dict(zip(places, found, strict=True))


def _ticks(text: str) -> int:
    return int(text) if text.strip().isdigit() else 0
