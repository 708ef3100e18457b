"""Parquet files, through pyarrow, column by column."""

from datetime import UTC
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.recordings.formats.base import RecordedFile, refusing
from ematwin.recordings.tables import KEY, checked, to_numpy


class ParquetFile(RecordedFile):
    """A Parquet file; units are taken from the field metadata ``unit`` where there is any."""

    kind: ClassVar[str] = "parquet"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        import pyarrow.parquet as pq

        # pages that were written without a checksum are read as they are
        self._file = pq.ParquetFile(path, page_checksum_verification=True)
        schema = self._file.schema_arrow
        notes = {key: note.decode("latin-1") for key, note in (schema.metadata or {}).items()}
        self.metadata = checked(notes.get(KEY.encode()), path, "".join(notes.values()))
        self.units = self.metadata.get("units", {})
        for field in schema:
            own = self.channels[field.name] = field.metadata or {}
            if not self.metadata and (unit := own.get(b"unit") or own.get(b"units")):
                self.units[field.name] = unit.decode()

    def values(self, name: str) -> np.ndarray:
        """Values (S,) of a column; moments and periods are s since the first of them."""
        column, rows = self._file.read(columns=[name]).column(0), self._file.metadata.num_rows
        if len(column) != rows:
            raise FileError(
                f"{self.path} promises {rows} rows of {name} and holds {len(column)}. It was "
                "damaged; copy it again."
            )
        return self._numbers(column.combine_chunks(), name)

    def texts(self, name: str) -> list[str]:  # noqa: D102
        import pyarrow as pa

        with refusing(self.path, self.kind):
            column = self._file.read(columns=[name]).column(0)
            if pa.types.is_floating(column.type):
                return super().texts(name)
            return ["" if text is None else text for text in column.cast(pa.string()).to_pylist()]

    def close(self) -> None:
        """Close the file, and give back the memory that its pages were unpacked in."""
        import pyarrow as pa

        self._file.close()
        pa.default_memory_pool().release_unused()

    def _numbers(self, column: Any, name: str) -> np.ndarray:
        import pyarrow as pa

        kind = column.type
        if kind == pa.float64():
            return to_numpy(column)  # a cast would load what computes with columns
        is_moment = pa.types.is_timestamp(kind)
        if is_moment or pa.types.is_time(kind) or pa.types.is_duration(kind):
            import pyarrow.compute as pc

            in_ns = (
                pa.timestamp("ns", tz=kind.tz) if is_moment
                else pa.time64("ns") if pa.types.is_time(kind) else pa.duration("ns")
            )  # fmt: skip
            ticks = column.cast(in_ns).cast(pa.int64())
            origin = (ticks[0].as_py() or 0) if len(ticks) else 0
            if is_moment:  # a time of day has no date
                zone = None if kind.tz is None else UTC
                self.note_clock(name, np.datetime64(origin, "ns"), zone)
            since = pc.subtract(ticks, origin)
            return to_numpy(since.cast(pa.float64(), safe=False)) * 1e-9
        try:
            return to_numpy(column.cast(pa.float64()))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise RecordError(
                f"Column {name} of {self.path} must hold numbers; it holds {kind}. "
                "Remove text and units from its rows."
            ) from None
