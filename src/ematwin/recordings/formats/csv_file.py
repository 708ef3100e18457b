"""Text tables (CSV and kin), read block by block through pyarrow.

Only the wanted columns become numbers, so that a file far larger than memory can be read if its
wanted columns fit.
"""

from collections.abc import Iterator, Sequence
from datetime import UTC
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.recordings.formats.base import Progress, RecordedFile, refusing
from ematwin.recordings.formats.csv_dialect import MISSING, PLACEHOLDERS, over_midnight, sniff
from ematwin.recordings.tables import to_numpy, verify, without_apostrophe


class CsvFile(RecordedFile):
    """A text table; options as in `ematwin.recordings.channel_map.CsvOptions`."""

    kind: ClassVar[str] = "csv"
    _on_invalid: ClassVar[Any] = None  # what is asked for rows of another width

    def __init__(self, path: Path, **options: Any) -> None:
        super().__init__(path)
        self._dialect = sniff(path, **options)
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
        for name, position in zip(names, positions, strict=True):
            if position in self._dialect.text:
                raise RecordError(
                    f"Column {name} of {self.path} must hold numbers; it holds text. "
                    "Remove text and units from its rows."
                )
        parts: list[list[np.ndarray]] = [[] for _ in names]
        origins: dict[int, int] = {}
        with refusing(self.path, self.kind):
            if ends_within_a_line(self) and self.metadata:
                raise FileError(
                    f"Cannot read {self.path} as csv: it ends within a line. It was truncated; "
                    "copy it again."
                )
            for batch, share in self._batches(positions):
                for place, column in enumerate(batch.columns):
                    parts[place].append(self._numbers(column, positions[place], origins))
                if progress is not None:
                    progress(share)
        if names and not sum(part.size for part in parts[0]):
            raise FileError(f"{self.path} holds a header and no rows.")
        found = {}
        for name, position in zip(names, positions, strict=True):
            found[name] = np.concatenate(parts.pop(0))  # one after the other, to spare memory
            clock = self._dialect.clocks.get(position)
            if clock is not None and not clock.is_dated:
                found[name] = over_midnight(found[name])
            elif clock is not None and position in origins:
                first = np.datetime64(origins[position], "ns")
                self.note_clock(name, first, UTC if clock.is_utc else None)
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

    def _batches(
        self, positions: Sequence[int], types: dict[int, Any] | None = None
    ) -> Iterator[tuple[Any, float]]:
        """Yield blocks of rows of some columns, and the share of the file that was read."""
        import pyarrow as pa
        from pyarrow import csv

        keys = [f"c{n}" for n in range(len(self._dialect.names))]
        # names were read by us: bytes above 127 in other columns stay undecoded
        encoding = self._dialect.encoding
        encoding = encoding if encoding.startswith(("utf-16", "latin")) else "utf8"
        start = self._dialect.start
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
                    include_columns=list(chosen),
                    column_types=chosen,
                    null_values=[*csv.ConvertOptions().null_values, *PLACEHOLDERS],
                    decimal_point=self._dialect.decimal,
                    check_utf8=False,
                    strings_can_be_null=True,
                ),
            )
            for batch in batches:
                yield batch, min(max(file.tell() - start, 1) / size, 1.0)

    def _numbers(self, column: Any, position: int, origins: dict[int, int]) -> np.ndarray:
        """One column of a block; clock times as seconds since ``origins[position]``, in ns."""
        import pyarrow as pa

        clock = self._dialect.clocks.get(position)
        if clock is not None:
            try:
                times = clock.nanoseconds(column.to_pylist())
            except RecordError as error:
                name = self._dialect.names[position]
                raise RecordError(
                    f"Column {name} of {self.path} holds clock times, but {error}. Correct it."
                ) from None
            known = times != MISSING
            origin = origins.setdefault(position, int(times[known][0])) if known.any() else 0
            return np.where(known, (times - origin) * 1e-9, np.nan)
        if pa.types.is_string(column.type):  # numbers such as +1.5, which pyarrow does not parse
            import pyarrow.compute as pc

            column = pc.utf8_ltrim(pc.utf8_trim_whitespace(column), characters="+")
            if self._dialect.decimal == ",":
                column = pc.replace_substring(column, ",", ".")
            column = column.cast(pa.float64())
        return np.array(to_numpy(column))


def ends_within_a_line(file: RecordedFile) -> bool:
    """Whether a table ends without a line break, which is noted for the provenance."""
    with file.path.open("rb") as content:
        content.seek(max(file.path.stat().st_size - 2, 0))
        if content.read().rstrip(b"\x00").endswith((b"\n", b"\r")):
            return False
    said = "the file ends without a line break: its last row was taken as it stands"
    if said not in file.assumed:
        file.assumed.append(said)
    return True
