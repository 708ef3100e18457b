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
from ematwin.recordings.formats.base import Progress, RecordedFile, refusing
from ematwin.recordings.formats.csv_dialect import CsvDialect
from ematwin.recordings.formats.csv_file import CsvFile, ends_within_a_line
from ematwin.recordings.tables import to_numpy

_HEAD = 1 << 16  # bytes in which the block of the recording ends
_TICK = 1e-7  # s
_START = "Starttime of export"


class _Column(NamedTuple):
    place: int
    time: int  # place of its column of times


def is_export(path: Path) -> bool:
    """Whether a text file begins as an export of the TwinCAT Scope does."""
    with path.open("rb") as file:
        head = file.read(_HEAD).decode("utf-8-sig", "replace")
    named = re.match(r"Name[\t;|,][^\r\n]*\r?\n", head)
    return named is not None and f"\n{_START}" in head


class TwinCatFile(CsvFile):
    """An export of the TwinCAT Scope; each column of times is a time base."""

    kind: ClassVar[str] = "TwinCAT Scope CSV"
    texts = RecordedFile.texts
    _on_invalid = staticmethod(lambda row: "skip" if row.text == "EOF" else "error")

    def __init__(self, path: Path) -> None:
        RecordedFile.__init__(self, path)
        with path.open("rb") as file:
            self._sign = file.readline().decode("utf-8-sig")[len("Name")]
            told, block = self._block(file), self._block(file)
            start = file.tell()
            rows = file.read(_HEAD).decode("utf-8", "replace")
        first = rows.partition("\n")[0].rstrip("\r").split(self._sign)
        # ticks are too many for a float
        self._in_ticks = first[0].isdigit() and int(first[0]) > 10**15
        decimal = "," if self._sign != "," and "," in rows else "."
        facts = {row[0]: row[1] for row in told if len(row) > 1}
        names = next((row for row in block if row[0] == "Name"), None)
        if names is None or len(names) < 2:
            raise FileError(
                f"Cannot read {path} as {self.kind}: it has no line of channels' names. Export it "
                "again with its header."
            )
        units = next((row for row in block if row[0] == "Unit"), [])
        # older versions end each row with a delimiter
        width = len(names) + (len(first) == len(names) + 1 and not first[-1])
        columns = [str(place) for place in range(width)]
        # pyarrow decodes rows that it shows, and any bytes may be there
        self._dialect = CsvDialect(columns, [], self._sign, decimal, "latin-1", start)
        time = 0
        for place, name in enumerate(names):
            if name == "Name":
                time = place
            elif name.strip():
                self.channels[name.strip()] = _Column(place, time)
                unit = units[place].partition(" (")[0].strip() if place < len(units) else ""
                self.units[name.strip()] = "" if unit == "(None)" else unit
        self._began, self._ended = (
            int(text) if text.strip().isdigit() else 0
            for text in (facts.get(_START, ""), facts.get("Endtime of export", ""))
        )
        if self._began:
            epoch = datetime(1601, 1, 1, tzinfo=UTC)
            self.start = epoch + timedelta(microseconds=self._began // 10)

    def _block(self, file: Any) -> list[list[str]]:
        """Cells of the next lines up to an empty one, the empty ones before them left out."""
        found: list[list[str]] = []
        for raw in iter(file.readline, b""):
            line = raw.decode("utf-8", "replace").rstrip("\r\n")
            if line.strip():
                found.append(line.split(self._sign))
            elif found:
                break
        return found

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
        # the last sample may be a little before the stated end
        if times[-1] + 1.5 * step < length and times.size == longest:
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
        for name, (place, time) in zip(names, columns, strict=True):
            # a fast channel has rows in which slow ones are empty
            found[name] = values[place][np.isfinite(self._stamps[time])]
        if progress is not None:
            progress(1.0)
        return found

    def _read(self, places: Sequence[int], ticks: bool = False) -> dict[int, np.ndarray]:
        """Columns (S,) by their place; those in ticks become ms since the start of the export."""
        import pyarrow as pa
        import pyarrow.compute as pc

        with refusing(self.path, self.kind):
            with self.path.open("rb") as file:
                file.seek(max(self.path.stat().st_size - _HEAD, self._dialect.start))
                if not file.read().rstrip(b"\r\n \0").endswith(b"EOF"):
                    ends_within_a_line(self)
            types = dict.fromkeys(places, pa.int64()) if ticks else None
            table = pa.Table.from_batches([batch for batch, _ in self._batches(places, types)])
        found = {}
        for place, chunks in zip(places, table.columns, strict=True):
            column = chunks.combine_chunks()
            if ticks:
                since = pc.subtract(column, self._began or column[0])
                column = pc.multiply(since.cast(pa.float64()), 1e3 * _TICK)
            found[place] = np.array(to_numpy(column))
        return found
