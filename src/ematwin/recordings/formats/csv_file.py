"""Text tables (CSV and kin, TwinCAT Scope), read block by block through pyarrow.

Only the wanted columns become numbers, so that a file far larger than memory can be read if its
wanted columns fit.
"""

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.recordings.formats import csv_dialect
from ematwin.recordings.formats.base import Progress, RecordedFile, as_float, refusing
from ematwin.recordings.formats.csv_dialect import CsvDialect
from ematwin.recordings.tables import to_numpy, verify, without_apostrophe


class CsvFile(RecordedFile):
    """A text table; options as in `ematwin.recordings.channel.CsvOptions`."""

    kind: ClassVar[str] = "csv"
    _on_invalid: ClassVar[Any] = None  # what is asked for rows of another width

    def __init__(self, path: Path, **options: Any) -> None:
        super().__init__(path)
        self._dialect = csv_dialect.sniff(path, **options)
        self.channels = {name: place for place, name in enumerate(self._dialect.names)}
        self.metadata = self._dialect.metadata
        self.units = self.metadata.get("units", {}) if self.metadata else {
            name: "s" if place in self._dialect.clocks else self._dialect.units[place]
            for name, place in self.channels.items()
        }  # fmt: skip
        self.assumed = list(self._dialect.assumed)

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        positions = [self.channels[name] for name in names]
        for position in positions:
            if position in self._dialect.text:
                raise self._no_number(position, "text")
        parts: list[list[np.ndarray]] = [[] for _ in names]
        with refusing(self.path, self.kind):
            if self._ends_within_a_line() and self.metadata:
                said = "it ends within a line. It was truncated; copy it again."
                raise FileError(f"Cannot read {self.path} as csv: {said}")
            try:
                for batch, share in self._batches(positions):
                    for place, column in enumerate(batch.columns):
                        parts[place].append(self._numbers(column, positions[place]))
                    if progress is not None:
                        progress(share)
            except ValueError as error:
                if text := _TEXT.match(str(error)):
                    raise self._no_number(int(text[1]), repr(text[2])) from None
                raise
        if names and not sum(part.size for part in parts[0]):
            raise FileError(f"{self.path} holds a header and no rows.")
        found = {}
        for name, position in zip(names, positions, strict=True):
            found[name] = np.concatenate(parts.pop(0))  # one after the other, to spare memory
            if clock := self._dialect.clocks.get(position):
                if clock.is_dated:
                    self.note_clock(name, found[name], clock.zone)
                found[name] = as_float(found[name], name, self.path)
            if clock and not clock.is_dated:
                found[name] = csv_dialect.over_midnight(found[name])
        if progress is not None:
            progress(1.0)
        verify(found, self.metadata, self.path)
        return found

    def texts(self, name: str) -> list[str]:  # noqa: D102
        import pyarrow as pa

        position = self.channels[name]
        encoding = self._dialect.encoding
        code = "utf-8" if encoding.startswith("utf-16") else encoding  # as pyarrow gives them
        with refusing(self.path, self.kind):
            batches = self._batches([position], {position: pa.binary()})
            found = [text for batch, _ in batches for text in batch.column(0).to_pylist()]
        texts = ("" if text is None else text.decode(code, "replace").strip() for text in found)
        return [without_apostrophe(text) for text in texts]

    def _no_number(self, position: int, held: str) -> RecordError:
        told = f"Column {self._dialect.names[position]} of {self.path} must hold numbers"
        return RecordError(f"{told}; it holds {held}. Remove text and units from its rows.")

    def _batches(
        self, positions: Sequence[int], types: dict[int, Any] | None = None
    ) -> Iterator[tuple[Any, float]]:
        """Yield blocks of rows of some columns, and the share of the file that was read."""
        import pyarrow as pa
        from pyarrow import csv

        keys = [f"c{n}" for n in range(len(self._dialect.names))]
        # names were read by us: bytes above 127 in other columns stay undecoded
        encoding, start = self._dialect.encoding, self._dialect.start
        encoding = encoding if encoding.startswith(("utf-16", "latin")) else "utf8"
        size = max(self.path.stat().st_size - start, 1)
        as_text = {*self._dialect.clocks, *self._dialect.signed}
        usual = {n: pa.string() if n in as_text else pa.float64() for n in positions}
        chosen = {keys[n]: kind for n, kind in (usual | (types or {})).items()}
        with self.path.open("rb") as file:
            file.seek(start)
            batches = csv.open_csv(
                file,
                # pyarrow reads dozens of blocks ahead: four times as much took 100 MB more
                csv.ReadOptions(column_names=keys, block_size=1 << 20, encoding=encoding),
                csv.ParseOptions(
                    delimiter=self._dialect.delimiter, invalid_row_handler=self._on_invalid
                ),
                csv.ConvertOptions(
                    include_columns=list(chosen), column_types=chosen,
                    null_values=[*csv.ConvertOptions().null_values, *csv_dialect.PLACEHOLDERS],
                    decimal_point=self._dialect.decimal, check_utf8=False,
                    strings_can_be_null=True,
                ),
            )  # fmt: skip
            for batch in batches:
                yield batch, min(max(file.tell() - start, 1) / size, 1.0)

    def _numbers(self, column: Any, position: int) -> np.ndarray:
        """One column of a block: floats, or clock times."""
        import pyarrow as pa

        clock = self._dialect.clocks.get(position)
        if clock is not None:
            try:
                return clock.times(column.to_pylist())
            except RecordError as error:
                name = self._dialect.names[position]
                raise RecordError(
                    f"Column {name} of {self.path} holds clock times, but {error}. Correct it."
                ) from None
        if pa.types.is_string(column.type):  # numbers such as +1.5, which pyarrow does not parse
            import pyarrow.compute as pc

            column = pc.utf8_ltrim(pc.utf8_trim_whitespace(column), characters="+")
            if self._dialect.decimal == ",":
                column = pc.replace_substring(column, ",", ".")
            column = column.cast(pa.float64())
        return np.array(to_numpy(column))

    def _ends_within_a_line(self) -> bool:
        """Whether the table ends without a line break, which is noted for the provenance."""
        with self.path.open("rb") as content:
            content.seek(max(self.path.stat().st_size - 2, 0))
            if content.read().rstrip(b"\x00").endswith((b"\n", b"\r")):
                return False
        said = "the file ends without a line break: its last row was taken as it stands"
        if said not in self.assumed:
            self.assumed.append(said)
        return True


_TEXT = re.compile(r"In CSV column #(\d+): .*invalid value '(.*)'", re.DOTALL)  # of pyarrow
_HEAD = 1 << 16  # bytes in which the block of the recording ends
_TICK = 1e-7  # s
_START = "Starttime of export"


def is_export(path: Path) -> bool:
    """Whether a text file begins as an export of the TwinCAT Scope does."""
    with path.open("rb") as file:
        head = file.read(_HEAD).decode("utf-8-sig", "replace")
    named = re.match(r"Name[\t;|,][^\r\n]*\r?\n", head)
    return named is not None and f"\n{_START}" in head


class TwinCatFile(CsvFile):
    """An export of the TwinCAT Scope: a block for the recording, one for its channels, rows.

    A cell of the channels' block that repeats the key of its line (``Name``) stands above a column
    of times, a time base; columns up to the next one share it. Times are ms since the start of the
    export, or ticks of 100 ns since 1601.

    Beckhoff Information System, TE13xx TC3 Scope View, "Export to CSV".
    """

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
            said = "it has no line of channels' names. Export it again with its header."
            raise FileError(f"Cannot read {path} as {self.kind}: {said}")
        units = next((row for row in block if row[0] == "Unit"), [])
        # older versions end each row with a delimiter
        columns = [*names, ""] if len(first) == len(names) + 1 and not first[-1] else names
        # pyarrow decodes rows that it shows, and any bytes may be there
        self._dialect = CsvDialect(columns, [], self._sign, decimal, "latin-1", start)
        self._times: dict[str, int] = {}  # places of the columns of times, by channel
        time = 0
        for place, name in enumerate(names):
            if name == "Name":
                time = place
            elif name.strip():
                self.channels[name.strip()], self._times[name.strip()] = place, time
                unit = units[place].partition(" (")[0].strip() if place < len(units) else ""
                self.units[name.strip()] = "" if unit == "(None)" else unit
        ends = (facts.get(key, "").strip() for key in (_START, "Endtime of export"))
        self._began, self._ended = (int(text) if text.isdigit() else 0 for text in ends)
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
        own = self._stamps[self._times[name]]
        # columns with the same times are one base: most exports repeat them for each channel
        equal = (place for place, one in self._stamps.items() if np.array_equal(one, own, True))
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
        """Each column of times (S,), ms since the start, by its place; NaN for an empty cell."""
        import pyarrow as pa
        import pyarrow.compute as pc

        places = sorted({*self._times.values()})
        types = dict.fromkeys(places, pa.int64()) if self._in_ticks else None
        with refusing(self.path, self.kind):
            table = pa.Table.from_batches([batch for batch, _ in self._batches(places, types)])
        found = {}
        for place, chunks in zip(places, table.columns, strict=True):
            column = chunks.combine_chunks()
            if self._in_ticks:
                since = pc.subtract(column, self._began or column[0])
                column = pc.multiply(since.cast(pa.float64()), 1e3 * _TICK)
            found[place] = np.array(to_numpy(column))
        return found

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        # a fast channel has rows in which slow ones are empty
        rows = {name: np.isfinite(self._stamps[self._times[name]]) for name in names}
        found = super().read(names, progress)
        return {name: values[rows[name]] for name, values in found.items()}

    def _ends_within_a_line(self) -> bool:
        with self.path.open("rb") as file:
            file.seek(max(self.path.stat().st_size - _HEAD, self._dialect.start))
            is_whole = file.read().rstrip(b"\r\n \0").endswith(b"EOF")
        return not is_whole and super()._ends_within_a_line()
