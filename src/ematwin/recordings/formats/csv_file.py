"""Text tables (CSV and kin), read block by block through pyarrow.

Only the wanted columns become numbers, straight into arrays of about the right length, so that a
file far larger than memory can be read if its wanted columns fit.
"""

from collections.abc import Sequence
from datetime import UTC
from io import BufferedReader
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.recordings.formats.arrow import as_floats, as_integers
from ematwin.recordings.formats.base import Progress, RecordedFile, moment, refusing
from ematwin.recordings.formats.csv_dialect import PLACEHOLDERS, sniff
from ematwin.recordings.sealed import verify
from ematwin.recordings.spreadsheets import without_apostrophe

_BLOCK = 1 << 20  # bytes; pyarrow reads some dozens ahead: four times as much took 100 MB more


class CsvFile(RecordedFile):
    """A text table.

    Parameters
    ----------
    path : Path
    delimiter, decimal, skip_rows : as in `ematwin.recordings.channel_map.CsvOptions`
    """

    kind: ClassVar[str] = "csv"

    def __init__(self, path: Path, **options: Any) -> None:
        super().__init__(path)
        self._dialect = sniff(path, **options)
        self.metadata = self._dialect.metadata
        self.assumed = list(self._dialect.assumed)

    @property
    def names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(self._dialect.names)

    def unit(self, name: str) -> str | None:  # noqa: D102
        if self.metadata:
            return cast("str | None", self.metadata.get("units", {}).get(name))
        return self._dialect.units[self._dialect.names.index(name)] or None

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        positions = [self._dialect.names.index(name) for name in names]
        for name, position in zip(names, positions, strict=True):
            if position in self._dialect.text:
                raise RecordError(
                    f"Column {name} of {self.path} must hold numbers; it holds text. "
                    "Remove text and units from its rows."
                )
        columns = _Columns(len(names))
        origins: dict[int, int] = {}
        size = self.path.stat().st_size
        with refusing(self.path, self.kind), self.path.open("rb") as file:
            _check_end(self.path, file, size, bool(self.metadata), self.assumed)
            file.seek(self._dialect.start)
            for batch in self._batches(file, positions):
                done = max(file.tell() - self._dialect.start, 1)
                share = min(done / max(size - self._dialect.start, 1), 1.0)
                block = [self._numbers(c, origins, n) for n, c in enumerate(batch.columns)]
                columns.append(block, share)
                if progress is not None:
                    progress(share)
        if columns.rows == 0:
            raise FileError(f"{self.path} holds a header and no rows.")
        for place, nanoseconds in origins.items():
            zone = UTC if positions[place] in self._dialect.utc else None
            began = moment(np.datetime64(nanoseconds, "ns"), zone)
            if began is not None:
                self.clocks[names[place]] = began
        if progress is not None:
            progress(1.0)
        found = dict(zip(names, columns.finished(), strict=True))
        verify(found, self.metadata, self.path)
        return found

    def texts(self, name: str) -> list[str]:  # noqa: D102
        import pyarrow as pa

        position = self._dialect.names.index(name)
        encoding = self._dialect.encoding
        code = "utf-8" if encoding.startswith("utf-16") else encoding  # as pyarrow gives them
        with refusing(self.path, self.kind), self.path.open("rb") as file:
            file.seek(self._dialect.start)
            batches = self._batches(file, [position], {position: pa.binary()})
            found = [text for batch in batches for text in batch.column(0).to_pylist()]
        texts = ("" if text is None else text.decode(code, "replace").strip() for text in found)
        return [without_apostrophe(text) for text in texts]

    def _batches(
        self, file: BufferedReader, positions: Sequence[int], types: dict[int, Any] | None = None
    ) -> Any:
        from pyarrow import csv

        width = len(self._dialect.names)
        keys = [f"c{n}" for n in range(width)]
        wanted = [keys[position] for position in positions]
        encoding = self._dialect.encoding
        return csv.open_csv(
            file,
            read_options=csv.ReadOptions(
                column_names=keys,
                block_size=_BLOCK,
                # names were read by us: bytes above 127 in unread columns need no decoding
                encoding=encoding if encoding.startswith("utf-16") else "utf8",
            ),
            parse_options=csv.ParseOptions(delimiter=self._dialect.delimiter),
            convert_options=csv.ConvertOptions(
                include_columns=wanted,
                column_types={
                    key: (types or {}).get(position) or self._arrow_type(position)
                    for key, position in zip(wanted, positions, strict=True)
                },
                null_values=[*csv.ConvertOptions().null_values, *PLACEHOLDERS],
                decimal_point=self._dialect.decimal,
                check_utf8=False,
                strings_can_be_null=True,
            ),
        )

    def _arrow_type(self, position: int) -> Any:
        import pyarrow as pa

        if position in self._dialect.clock:
            return pa.timestamp("ns", tz="UTC" if position in self._dialect.utc else None)
        return pa.string() if position in self._dialect.signed else pa.float64()

    def _numbers(self, column: Any, origins: dict[int, int], place: int) -> np.ndarray:
        """One column of a block; clock times as seconds since ``origins[place]``, in ns."""
        import pyarrow as pa

        if pa.types.is_timestamp(column.type):
            nanoseconds = as_integers(column.cast(pa.int64()))
            return (nanoseconds - origins.setdefault(place, int(nanoseconds[0]))) * 1e-9

        if pa.types.is_string(column.type):  # numbers such as +1.5, which pyarrow does not parse
            import pyarrow.compute as pc

            column = pc.utf8_ltrim(pc.utf8_trim_whitespace(column), characters="+")
            if self._dialect.decimal == ",":
                column = pc.replace_substring(column, ",", ".")
            column = column.cast(pa.float64())
        return as_floats(column)


class _Columns:
    """Columns that grow; their length is foreseen from the share of the file that was read."""

    def __init__(self, count: int) -> None:
        self.rows = 0
        self._arrays = [np.empty(0) for _ in range(count)]

    def append(self, block: Sequence[np.ndarray], share: float) -> None:
        """Add one block; ``share`` of the file has been read with it."""
        if not block:
            return
        rows = self.rows + block[0].size
        if rows > self._arrays[0].size:
            foreseen = int(rows / max(share, 1e-6) * 1.05) + 1
            for array in self._arrays:
                # memory that is not written to is not taken; refcheck: nobody else holds them
                array.resize(max(foreseen, rows), refcheck=False)
        for array, values in zip(self._arrays, block, strict=True):
            array[self.rows : rows] = values
        self.rows = rows

    def finished(self) -> list[np.ndarray]:
        """The columns at their length."""
        for array in self._arrays:
            array.resize(self.rows, refcheck=False)
        return self._arrays


def _check_end(
    path: Path, file: BufferedReader, size: int, is_ours: bool, assumed: list[str]
) -> None:
    file.seek(max(size - 2, 0))
    if file.read().rstrip(b"\x00").endswith((b"\n", b"\r")):
        return
    if is_ours:
        raise FileError(
            f"Cannot read {path} as csv: it ends within a line. It was truncated; copy it again."
        )
    sentence = "the file ends without a line break: its last row was taken as it stands"
    if sentence not in assumed:
        assumed.append(sentence)
