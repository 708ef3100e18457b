"""The rows and events of a fleet as files; `ematwin.fleet.store` describes them.

A part is written whole, under the hash of its rows. Small parts are merged later.
"""

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from ematwin.errors import FileError
from ematwin.files import written_whole
from ematwin.numerics.content import digest


class FolderRows:
    """Rows and events of a fleet in its folder; `ematwin.fleet.tables.TableRows` is alike."""

    def __init__(self, folder: Path, schema: pa.Schema) -> None:
        self.folder, self._schema = folder, schema

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Keep rows, of each actuator in one file; those that are there already stay once."""
        by: dict[str, list[Mapping[str, Any]]] = {}
        for row in rows:
            by.setdefault(row["serial_number"], []).append(row)
        for serial, several in by.items():
            self._write(
                serial, pa.Table.from_pylist([dict(r) for r in several], schema=self._schema)
            )

    def rows(self, serial_number: str | None) -> list[pa.Table]:
        """The rows of all actuators or of one."""
        parts = [self._read(path) for path in self._files(serial_number)]
        return [one for one in parts if one is not None]

    def merge(self) -> None:
        """Merge the files of actuators that have many; what another process moves is left."""
        for folder in (self.folder / "rows").iterdir():
            files = sorted(folder.glob("[!.]*.parquet"))  # not what a killed process left
            if len(files) <= 64:
                continue
            parts = [self._read(path) for path in files]
            # by their ids: a merger that was killed has left rows in two parts
            rows = {row["id"]: row for p in parts if p is not None for row in p.to_pylist()}
            table = pa.Table.from_pylist(list(rows.values()), schema=self._schema)
            kept = self._write(table["serial_number"][0].as_py(), table)
            for path in files:
                if path != kept:
                    path.unlink(missing_ok=True)

    def has(self, serial_number: str, ids: Iterable[str]) -> bool:
        """Whether these rows are kept as one part."""
        return self._part(serial_number, ids).exists()

    def note(self, text: str) -> None:
        """Keep an event, JSON; the same one again is kept once."""
        with written_whole(self.folder / "events" / f"{digest(text)}.json", durable=True) as draft:
            draft.write_text(text, encoding="utf-8")

    def events(self) -> list[tuple[str, str]]:
        """Places and texts of all events."""
        found = []
        for path in (self.folder / "events").glob("[!.]*.json"):
            with suppress(FileNotFoundError):
                found.append((str(path), path.read_text("utf-8", errors="replace")))
        return found

    def version(self) -> tuple[str, ...]:
        """Names of all files."""
        names = (
            str(path.relative_to(self.folder))
            for name in ("rows", "events")
            for path in (self.folder / name).rglob("[!.]*.*")
        )
        return tuple(sorted(names))

    def twin(self, fingerprint: str) -> Path:
        """The file of a twin."""
        return self.folder / "twins" / f"{fingerprint}.toml"

    def keep_twin(self, fingerprint: str) -> None:
        """Nothing is to be done: the folder has it."""

    def _part(self, serial: str, ids: Iterable[str]) -> Path:
        folder = self.folder / "rows" / _folder_name(serial)
        return folder / f"{digest(json.dumps(sorted(ids)))}.parquet"

    def _write(self, serial: str, table: pa.Table) -> Path:
        path = self._part(serial, table["id"].to_pylist())
        path.parent.mkdir(exist_ok=True)
        with written_whole(path, durable=True) as draft:
            pq.write_table(table, draft)
        return path

    def _files(self, serial: str | None) -> list[Path]:
        inside = "*" if serial is None else _folder_name(serial)
        return sorted((self.folder / "rows").glob(f"{inside}/[!.]*.parquet"))

    def _read(self, path: Path) -> pa.Table | None:
        """A part; None where it was merged into another meanwhile."""
        try:
            return pq.ParquetFile(path).read().cast(self._schema)
        except FileNotFoundError:
            return None
        except (pa.ArrowInvalid, OSError, ValueError) as error:
            raise FileError(
                f"{path} is damaged ({str(error).splitlines()[0][:80]}). Remove it, and watch its "
                "recordings again."
            ) from None


def _folder_name(serial_number: str) -> str:
    """A serial number as the name of a folder: ``..`` and ``/`` are none."""
    return quote(serial_number, safe="-_ ").replace(".", "%2E") or "unknown"
