"""The store of a fleet: one row for each judged recording, in Parquet files by serial number.

    fleet/rows/<serial number>/<part>.parquet    estimates from recordings
    fleet/events/<event>.json                    overhauls, alarms, and answers to them
    fleet/calibrations/<serial number>[@from].toml   which twin judges whom, and from when on
    fleet/twins/<fingerprint>.toml               each twin that has judged

With ``store = "postgresql://user@host/name"`` in ``fleet.toml`` rows and events are in tables of
that database (`ematwin.fleet.tables`).

A row is known by the hash of its recording and of the twin that judged it. A part is written whole,
under the hash of its rows, and is on the disk before its name appears: a process that is killed
leaves a row or none, and two that judge the same recording leave it once. So several may write to
one store without a lock. Fields follow the blocks of ISO 13374: data manipulation (time,
covariates), state detection (grade, faults), health assessment (values with their covariance).
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote
from uuid import uuid4

import pyarrow as pa
import pyarrow.parquet as pq

from ematwin.errors import FileError, InputError
from ematwin.files import written_whole
from ematwin.monitoring.calibration import Calibration
from ematwin.numerics.content import digest
from ematwin.validation import load_toml

YEAR = 365.25 * 86_400.0  # s
SET_ASIDE = "set aside"  # grade of what could not be judged

SCHEMA = pa.schema(
    [
        ("id", pa.string()),
        ("serial_number", pa.string()),
        ("time", pa.timestamp("us", "UTC")),  # when the recording began
        ("judged", pa.timestamp("us", "UTC")),
        ("source", pa.string()),
        ("content", pa.string()),  # hash of the file
        ("motion", pa.int32()),  # within the file
        ("twin", pa.string()),  # fingerprint of the calibration
        ("kind", pa.string()),
        ("grade", pa.string()),  # healthy, changed, fault, none, or set aside
        ("faults", pa.list_(pa.string())),
        ("sentence", pa.string()),
        ("reason", pa.string()),  # why there is no verdict, or why it was set aside
        ("names", pa.list_(pa.string())),  # of the magnitudes
        ("values", pa.list_(pa.float64())),
        ("covariance", pa.list_(pa.float64())),  # row by row
        ("temperature", pa.float64()),  # deg C
        ("load", pa.float64()),  # SI, mean of its size
        ("note", pa.string()),  # "late", where later recordings were known already
    ]
)


class FleetStore:
    """The folder of a fleet, made where it is missing; ``create`` False refuses what is none.

    A `ematwin.fleet.tables.TableStore` where its ``fleet.toml`` names a database.
    """

    def __new__(cls, folder: str | Path, *, create: bool = True) -> "FleetStore":
        """The store that the settings of the folder name."""
        if "store" not in settings_in(Path(folder)):
            return super().__new__(FleetStore)
        from ematwin.fleet.tables import TableStore

        return super().__new__(TableStore)

    def __init__(self, folder: str | Path, *, create: bool = True) -> None:
        self.folder = Path(folder)
        if not create and not (self.folder / "rows").is_dir():
            raise FileError(
                f"There is no fleet in {self.folder}. Make one with: ematwin watch RECORDINGS "
                f"--fleet {self.folder}"
            )
        try:
            for name in ("rows", "events", "calibrations", "twins"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(
                f"Cannot make the fleet {self.folder}: {error.strerror}. Choose a folder that is "
                "yours."
            ) from None

    def __reduce__(self) -> Any:
        return FleetStore, (self.folder,)  # a worker of a cluster connects by itself

    # --- rows ----------------------------------------------------------------------------------

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Keep rows, of each actuator in one file; those that are there already stay once."""
        by: dict[str, list[dict[str, Any]]] = {}
        for row in rows:
            by.setdefault(row["serial_number"], []).append(dict(row))
        for serial, several in by.items():
            self._write(serial, pa.Table.from_pylist(several, schema=SCHEMA))

    def rows(self) -> pa.Table:
        """The rows of all actuators by serial number and time; each recording once.

        A recording that several twins have judged has the latest judgement. A file that was judged
        while it was still written counts as it is now.
        """
        whole = pa.concat_tables([SCHEMA.empty_table(), *self._kept()]).sort_by("judged")
        keys = zip(whole["content"].to_pylist(), whole["motion"].to_pylist(), strict=True)
        latest = {key: n for n, key in enumerate(keys)}  # of several judgements the last
        whole = whole.take(pa.array(sorted(latest.values()), pa.int64()))
        whole = whole.filter(_as_they_are(whole))
        return whole.sort_by([("serial_number", "ascending"), ("time", "ascending")])

    def merge(self) -> None:
        """Merge the files of actuators that have many; what another process moves is left."""
        for folder in (self.folder / "rows").iterdir():
            files = sorted(folder.glob("[!.]*.parquet"))  # not what a killed process left
            if len(files) <= 64:
                continue
            # by their ids: a merger that was killed has left rows in two parts
            rows = {row["id"]: row for part in _parts(files) for row in part.to_pylist()}
            table = pa.Table.from_pylist(list(rows.values()), schema=SCHEMA)
            kept = self._write(table["serial_number"][0].as_py(), table)
            for path in files:
                if path != kept:
                    path.unlink(missing_ok=True)

    def has(self, serial_number: str, ids: Iterable[str]) -> bool:
        """Whether somebody has kept these rows meanwhile."""
        return self._part(serial_number, ids).exists()

    def _kept(self) -> list[pa.Table]:
        """All rows that are kept."""
        return list(_parts(sorted((self.folder / "rows").glob("*/[!.]*.parquet"))))

    def _part(self, serial: str, ids: Iterable[str]) -> Path:
        folder = self.folder / "rows" / _folder_name(serial)
        return folder / f"{digest(json.dumps(sorted(ids)))}.parquet"

    def _write(self, serial: str, table: pa.Table) -> Path:
        path = self._part(serial, table["id"].to_pylist())
        path.parent.mkdir(exist_ok=True)
        with written_whole(path, durable=True) as draft:
            pq.write_table(table, draft)
        return path

    # --- twins ---------------------------------------------------------------------------------

    def twin(self, fingerprint: str) -> Calibration:
        """A twin that judges or has judged."""
        return _read_once(self._twin_file(fingerprint))

    def keep_twin(self, given: Calibration | Path) -> str:
        """Keep a calibration, or its file, as a twin that judges; gives its fingerprint."""
        if isinstance(given, Calibration):
            draft = self.folder / "twins" / f".{uuid4().hex}.toml"
            given.save(draft)
            try:
                return self.keep_twin(draft)
            finally:
                draft.unlink()
        fingerprint = content_of(given)
        kept = self._twin_file(fingerprint)
        if not kept.exists():
            Calibration.of(given)  # what cannot be read is said now
            with written_whole(kept, durable=True) as draft:
                draft.write_bytes(given.read_bytes())
        return fingerprint

    def _twin_file(self, fingerprint: str) -> Path:
        return self.folder / "twins" / f"{fingerprint}.toml"

    # --- events --------------------------------------------------------------------------------

    def note(self, serial_number: str, what: str, when: datetime, **more: Any) -> dict[str, Any]:
        """Keep an event, and give it as `events` does; the same one again is kept once."""
        event = {"serial_number": serial_number, "what": what, "time": when.isoformat(), **more}
        text = json.dumps(event, sort_keys=True, default=str)
        self._note(text)
        return _event(text)

    def events(self) -> list[dict[str, Any]]:
        """All events by time, each with its ``id``, and since when it is ``known``; datetimes."""
        found = []
        for place, text in self._texts():
            try:
                found.append(_event(text))
            except (ValueError, KeyError, TypeError):
                raise FileError(f"{place} is damaged. Remove it.") from None
        return sorted(found, key=lambda one: (one["time"], one["serial_number"], one["what"]))

    def _note(self, text: str) -> None:
        with written_whole(self.folder / "events" / f"{digest(text)}.json", durable=True) as draft:
            draft.write_text(text, encoding="utf-8")

    def _texts(self) -> list[tuple[str, str]]:
        """Places and texts of all events."""
        found = []
        for path in (self.folder / "events").glob("[!.]*.json"):
            with suppress(FileNotFoundError):
                found.append((str(path), path.read_text("utf-8", errors="replace")))
        return found

    def version(self) -> tuple[str, ...]:
        """The kept parts, and the age of the settings: changes when anything does."""
        settings = self.folder / "fleet.toml"
        age = str(settings.stat().st_mtime_ns) if settings.exists() else ""
        return (age, *self._state())

    def _state(self) -> tuple[str, ...]:
        """Names of all files."""
        names = (
            str(path.relative_to(self.folder))
            for name in ("rows", "events")
            for path in (self.folder / name).rglob("[!.]*.*")
        )
        return tuple(sorted(names))


def settings_in(folder: Path) -> dict[str, Any]:
    """The content of a ``fleet.toml``; nothing where there is none."""
    path = folder / "fleet.toml"
    return load_toml(path, "settings") if path.exists() else {}


def _parts(files: Iterable[Path]) -> Iterator[pa.Table]:
    """Yield rows of files, but of those that were merged into another meanwhile."""
    for path in files:
        try:
            yield pq.ParquetFile(path).read().cast(SCHEMA)
        except FileNotFoundError:
            continue
        except (pa.ArrowInvalid, OSError, ValueError) as error:
            raise FileError(
                f"{path} is damaged ({str(error).splitlines()[0][:80]}). Remove it, and watch its "
                "recordings again."
            ) from None


def _folder_name(serial_number: str) -> str:
    """A serial number as the name of a folder: ``..`` and ``/`` are none."""
    return quote(serial_number, safe="-_ ").replace(".", "%2E") or "unknown"


def _event(text: str) -> dict[str, Any]:
    event: dict[str, Any] = json.loads(text)
    event |= {"id": digest(text), "time": moment_of(event["time"])}
    event["known"] = moment_of(event.pop("entered", event["time"]))
    return event


# the file of a twin, which each recording needs and nothing changes
_read_once = cache(Calibration.of)


def _as_they_are(rows: pa.Table) -> pa.Array:
    """Which rows, (N,) booleans, in the order of judgement, are of files as they are now.

    The others have source, actuator and time of a later row with other contents; or were set aside,
    and their source has later contents.
    """
    names = ("source", "serial_number", "time", "grade", "content")
    several = list(zip(*(rows[name].to_pylist() for name in names), strict=True))
    latest: dict[tuple[Any, ...], str] = {}
    for source, serial, time, _, content in several:
        latest[source,] = latest[source, serial, time] = content
    kept = [
        source is None
        or content == latest[(source,) if grade == SET_ASIDE else (source, serial, time)]
        for source, serial, time, grade, content in several
    ]
    return pa.array(kept, pa.bool_())


def row_of(
    serial_number: str, time: datetime | None, *, content: str, motion: int, twin: str, **more: Any
) -> dict[str, Any]:
    """A row of the store, whose id follows from recording and twin."""
    return {
        "id": id_of(content, motion, twin), "serial_number": serial_number, "time": time,
        "judged": datetime.now(UTC), "content": content, "motion": motion, "twin": twin, **more,
    }  # fmt: skip


def id_of(content: str, motion: int, twin: str) -> str:
    """The identifier of a row."""
    return digest(f"{content} {motion} {twin}")


def content_of(path: Path) -> str:
    """The hash of a file, which is read again only where its size or time has changed.

    `FileError` if it cannot be read.
    """
    try:
        now = path.stat()
        return _hash_at(path, now.st_size, now.st_mtime_ns)
    except OSError as error:
        raise FileError(f"Cannot read {path}: {os.strerror(error.errno or 5)}.") from None


@cache
def _hash_at(path: Path, size: int, time: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:20]


def moment_of(text: str | datetime) -> datetime:
    """A moment with its zone, UTC where it has none, of ISO 8601; else `InputError`."""
    try:
        found = text if isinstance(text, datetime) else datetime.fromisoformat(text)
    except (ValueError, TypeError):
        raise InputError(
            f"A time is written as 2026-05-01 or 2026-05-01T08:30:00, received {text!r}."
        ) from None
    return found if found.tzinfo is not None else found.replace(tzinfo=UTC)


def years(moment: datetime) -> float:
    """Years since 1970, the time axis of trends."""
    return moment.timestamp() / YEAR


def moment_at(time: float) -> datetime:
    """The moment of a number of years since 1970."""
    return datetime.fromtimestamp(time * YEAR, UTC)
