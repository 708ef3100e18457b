"""Watching: recordings of many actuators are judged once each, as they come.

Who was recorded is said by a label ``serial_number``, by a pattern for paths, or by the folder of
the file; when, by the recording itself or by a date in its path; which twin judges, by
``calibrations/<serial number>[@<from>].toml`` in the fleet. What cannot be judged is set aside with
the reason, and tried again once another twin is there for it.
"""

import os
import random
import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import EmatwinError, InputError, RecordError
from ematwin.files import written_whole
from ematwin.fleet.store import SET_ASIDE, FleetStore, content_of, id_of, moment_of, row_of
from ematwin.models.reading import read
from ematwin.models.registry import model_of
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.identify import identify
from ematwin.numerics.content import digest
from ematwin.numerics.side_by_side import cores
from ematwin.recordings.formats.base import known_suffixes
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}(?:[T_ ]\d{2}[-:]?\d{2}(?:[-:]?\d{2})?)?")
_EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)  # clocks that were never set begin in 1970 or 1980
_AHEAD = timedelta(days=1)  # zones and clocks may be off by as much


@dataclass
class Watched:
    """What came of watching.

    Attributes
    ----------
    judged : recordings that got a row, with a verdict or without
    set_aside : files and reasons
    known : files that had been judged before
    duplicates : files that are equal to another one
    """

    judged: int = 0
    set_aside: list[tuple[str, str]] = field(default_factory=list)
    known: int = 0
    duplicates: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        parts = [f"{self.judged} recordings judged", f"{self.known} known before"]
        if self.duplicates:
            parts.append(f"{len(self.duplicates)} duplicates")
        if self.set_aside:
            parts.append(f"{len(self.set_aside)} set aside")
        return ", ".join(parts) + "."


class Twins:
    """The calibrations of a fleet, by serial number and the day from which they hold.

    Parameters
    ----------
    store : its ``calibrations`` are read, and what judges is kept among its ``twins``
    given : for actuators without a file: what `ematwin.identify` takes; None for none
    """

    def __init__(self, store: FleetStore, given: Any = None) -> None:
        self._store = store
        self._known: dict[str, Calibration] = {}
        self._by: dict[str, list[tuple[datetime, str]]] = {}
        for path in sorted((store.folder / "calibrations").glob("[!.]*.toml")):
            serial, _, since = path.stem.partition("@")
            begin = moment_of(since) if since else _EARLIEST
            self._by.setdefault(serial, []).append((begin, self._keep(path)))
        for periods in self._by.values():
            periods.sort()
        self._given = ""
        if given is not None:
            known = Calibration.of(given)
            draft = store.folder / "twins" / f".{digest(str(random.random()))}.toml"
            known.save(draft)
            self._given = self._keep(draft)
            draft.unlink()

    def _keep(self, path: Path) -> str:
        fingerprint = content_of(path)
        kept = self._store.folder / "twins" / f"{fingerprint}.toml"
        if not kept.exists():
            Calibration.of(path)  # what cannot be read is said now
            with written_whole(kept, durable=True) as draft:
                draft.write_bytes(path.read_bytes())
        return fingerprint

    def select(self, serial: str, time: datetime | None) -> str:
        """Fingerprint of the twin that judges an actuator at a time; "" if there is none."""
        if not serial or time is None:
            return ""
        held = [mark for begin, mark in self._by.get(serial, ()) if begin <= time]
        if held:
            return held[-1]
        return "" if serial in self._by else self._given

    def load(self, fingerprint: str) -> Calibration:
        """A twin."""
        if fingerprint not in self._known:
            path = self._store.folder / "twins" / f"{fingerprint}.toml"
            self._known[fingerprint] = Calibration.of(path)
        return self._known[fingerprint]


def watch(
    store: FleetStore,
    recordings: str | Path | Iterable[str | Path],
    actuator: Any = None,
    *,
    pattern: str | None = None,
    columns: Any = None,
    threads: int | None = None,
    progress: Callable[[float], None] | bool | None = None,
) -> Watched:
    """Judge the recordings that are not in the store yet, on all cores, and keep each at once.

    Parameters
    ----------
    store : FleetStore
    recordings : a folder, which is searched with all folders in it; a file; or several
    actuator : the twin of actuators that have no file among ``calibrations``
    pattern : regular expression for paths with a group ``serial``, and perhaps one ``time``
    columns : as of `ematwin.read`
    threads : threads that share the work; None takes one for each core
    progress : True shows a bar; else called with the share done

    Returns
    -------
    Watched

    Raises
    ------
    InputError
        If there is no such folder, or the pattern cannot be used.
    """
    paths = _Paths(recordings, pattern)
    twins, known, found = Twins(store, actuator), store.known(), Watched()
    seen: dict[str, str] = {}
    todo: list[tuple[Path, str]] = []
    for path in paths.files:
        content = content_of(path)
        if content in seen:
            found.duplicates.append(str(path))
            continue
        seen[content] = str(path)
        if content in known and not _changed(known[content], twins, paths, path):
            found.known += 1
            continue
        todo.append((path, content))
    # two watchers on one store begin at different recordings
    random.Random(os.urandom(8)).shuffle(todo)
    latest = _latest(known)
    lent = max(1, min(threads or cores(), len(todo)))
    with told(progress, "judging") as tell, ThreadPoolExecutor(lent) as pool:
        tasks: dict[Future[Any], Path] = {}
        for path, content in todo:
            work = pool.submit(_judged, store, path, content, twins, paths, columns, latest)
            tasks[work] = path
        try:
            for done, task in enumerate(as_completed(tasks), 1):
                rows = task.result()
                found.known += not rows
                for row in rows:
                    if row["grade"] == SET_ASIDE:
                        found.set_aside.append((row["source"], row["reason"]))
                    else:
                        found.judged += 1
                if tell is not None:
                    tell(done / len(todo))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    store.merge()
    return found


class _Paths:
    """Files of recordings, and what their paths say."""

    def __init__(self, given: str | Path | Iterable[str | Path], pattern: str | None) -> None:
        items = [Path(given)] if isinstance(given, str | Path) else [Path(one) for one in given]
        self.roots = [one for one in items if one.is_dir()]
        self.files: list[Path] = []
        for one in items:
            if one.is_dir():
                known = set(known_suffixes())
                self.files += sorted(
                    path
                    for path in one.rglob("*")
                    if path.suffix.lower() in known
                    and path.is_file()
                    and not any(part.startswith(".") for part in path.relative_to(one).parts)
                )
            elif one.is_file():
                self.files.append(one)
            else:
                raise InputError(f"There is no file or folder {one}. Give one with recordings.")
        try:
            self._pattern = None if pattern is None else re.compile(pattern)
        except re.error as error:
            raise InputError(
                f"The pattern {pattern!r} is no regular expression: {error}."
            ) from None
        if self._pattern is not None and "serial" not in self._pattern.groupindex:
            raise InputError(
                f"The pattern {pattern!r} has no group serial. Write for example "
                r"(?P<serial>EMA-\d+)."
            )

    def serial(self, path: Path) -> str:
        """Serial number that a path says; "" for none."""
        if self._pattern is not None:
            match = self._pattern.search(str(path))
            return match["serial"] if match else ""
        for root in self.roots:
            if path.is_relative_to(root):
                inside = path.relative_to(root).parts[:-1]
                return inside[0] if inside else ""
        return ""

    def time(self, path: Path) -> datetime | None:
        """Time that a path says, UTC."""
        text = None
        if self._pattern is not None and "time" in self._pattern.groupindex:
            match = self._pattern.search(str(path))
            text = match["time"] if match else None
        else:
            match = _DATE.search(path.name)
            text = match[0] if match else None
        if text is None:
            return None
        day, clock = text[:10], re.sub(r"\D", "", text[10:])
        parts = ":".join(clock[n : n + 2] for n in range(0, len(clock), 2))
        try:
            return moment_of(f"{day}T{parts}" if parts else day)
        except InputError:
            return None


def _changed(
    rows: Sequence[dict[str, Any]], twins: Twins, paths: _Paths, path: Path
) -> bool:  # fmt: skip
    """Whether a file is now judged by another twin than before."""
    return any(
        twins.select(
            row["serial_number"] or paths.serial(path), row["time"] or paths.time(path)
        )
        != row["twin"]
        for row in rows
    )  # fmt: skip


def _latest(known: dict[str, list[dict[str, Any]]]) -> dict[str, datetime]:
    latest: dict[str, datetime] = {}
    for rows in known.values():
        for row in rows:
            if row["time"] is not None:
                serial = row["serial_number"]
                latest[serial] = max(latest.get(serial, row["time"]), row["time"])
    return latest


def _judged(
    store: FleetStore, path: Path, content: str, twins: Twins, paths: _Paths, columns: Any,
    latest: dict[str, datetime],
) -> list[dict[str, Any]]:  # fmt: skip
    """The rows of a file, which are kept before they are given."""
    serial = paths.serial(path)
    rows: list[dict[str, Any]] = []
    try:
        first = twins.select(serial, paths.time(path) or datetime.now(UTC))
        several = read(
            path, columns, actuator=twins.load(first).actuator if first else None, split=True
        )
    except Exception as error:  # whatever a damaged file makes a reader raise
        several = []
        when = paths.time(path)
        mark = twins.select(serial, when)
        rows.append(_aside(path, content, 0, serial, when, _sentence(error), mark))
    found = []
    for one in several:
        who = one.labels.get("serial_number", serial)
        when = paths.time(path) if one.start is None else moment_of(one.start)
        found.append((who, when, twins.select(who, when)))
    by: dict[str, list[str]] = {}
    for motion, (who, _, mark) in enumerate(found):
        by.setdefault(who, []).append(id_of(content, motion, mark))
    if by and all(store.has(who, ids) for who, ids in by.items()):
        return []  # another watcher was faster
    for motion, (one, (who, when, mark)) in enumerate(zip(several, found, strict=True)):
        try:
            rows.append(_row(path, content, motion, one, who, when, mark, twins, latest))
        except Exception as error:  # the rest goes on
            rows.append(_aside(path, content, motion, who, when, _sentence(error), mark))
    store.add(rows)
    return rows


def _row(
    path: Path, content: str, motion: int, one: Recording, serial: str, when: datetime | None,
    mark: str, twins: Twins, latest: dict[str, datetime],
) -> dict[str, Any]:  # fmt: skip
    if not serial:
        raise RecordError(
            "Nothing says which actuator was recorded. Put it into a folder with its serial "
            "number, or give a pattern for paths."
        )
    if when is None:
        raise RecordError(
            "Nothing says when it was recorded. Put the date into its name, such as "
            "2026-05-01T08-30.csv."
        )
    if when < _EARLIEST or when > datetime.now(UTC) + _AHEAD:
        raise RecordError(
            f"It was recorded on {when:%Y-%m-%d} by its own clock, which cannot be. Correct the "
            "time of the recorder."
        )
    if not mark:
        raise RecordError(
            f"There is no twin of {serial} at {when:%Y-%m-%d}. Put its calibration into the "
            f"fleet as calibrations/{serial}.toml, or give one for all with --actuator."
        )
    twin = twins.load(mark)
    found = identify(one, twin, threads=1)
    estimate = found.estimate
    faults = {f.name for f in twin.model.faults(twin.actuator) if f.direction_of is None}
    at = [n for n, name in enumerate(estimate.names) if name in faults]
    late = serial in latest and when < latest[serial]
    return row_of(
        serial, when, content=content, motion=motion, twin=mark, kind=twin.model.kind,
        grade=found.verdict.grade, faults=list(found.verdict.faults),
        sentence=found.verdict.sentence, reason=found.verdict.reason,
        names=[estimate.names[n] for n in at], values=estimate.values[at].tolist(),
        covariance=estimate.covariance[np.ix_(at, at)].ravel().tolist(),
        temperature=_temperature(one), load=_load(one, twin), source=str(path),
        note="late" if late else "",
    )  # fmt: skip


def _aside(
    path: Path, content: str, motion: int, serial: str, when: datetime | None, reason: str,
    twin: str = "",
) -> dict[str, Any]:  # fmt: skip
    return row_of(
        serial, when, content=content, motion=motion, twin=twin, kind="", grade=SET_ASIDE,
        reason=reason, source=str(path),
    )  # fmt: skip


def _sentence(error: Exception) -> str:
    if isinstance(error, EmatwinError):
        return str(error)
    return f"It cannot be judged ({type(error).__name__}: {str(error)[:200]})."


def _temperature(one: Recording) -> float | None:
    """Degrees Celsius: a label, or the mean of a channel of that name."""
    text = one.labels.get("temperature")
    if text is not None:
        match = re.match(r"\s*([-+]?\d+(?:\.\d+)?)", text)
        return float(match[1]) if match else None
    channel = one.channels.get("temperature")
    return None if channel is None else float(channel.mean())


def _load(one: Recording, twin: Calibration) -> float | None:
    """Mean size of the recorded load, SI."""
    name = model_of(twin.actuator).load
    channel = one.channels.get(name) if name is not None else None
    return None if channel is None else float(np.abs(channel).mean())
