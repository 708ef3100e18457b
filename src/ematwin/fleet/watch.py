"""Watching: recordings of many actuators are judged once each, as they come.

Who was recorded is said by a label ``serial_number``, by a table of runs, by a pattern for paths,
or by the folder of the file; when, by the recording itself, that table, or a date in its path;
which twin judges, by ``calibrations/<serial number>[@<from>].toml`` in the fleet. What cannot be
judged is set aside with the reason, and tried again once another twin is there for it.
"""

import random
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import EmatwinError, FileError, InputError, RecordError
from ematwin.fleet.store import SET_ASIDE, FleetStore, content_of, id_of, moment_of, row_of
from ematwin.models.reading import actuator_for, read
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.identify import identify
from ematwin.monitoring.runs import is_table_of_runs, listed
from ematwin.numerics.side_by_side import cores
from ematwin.recordings.formats.base import known_suffixes
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

_EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)  # clocks that were never set begin in 1970 or 1980
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}(?:[T_ ]\d{2}[-:]?\d{2}(?:[-:]?\d{2})?)?")


@dataclass
class Watched:
    """What came of watching."""

    judged: int = 0  # recordings that got a row, with a verdict or without
    set_aside: list[tuple[str, str]] = field(default_factory=list)  # files and reasons
    known: int = 0  # files that are known from before
    still_aside: int = 0  # of them, those that are set aside
    duplicates: list[str] = field(default_factory=list)  # files that are equal to another one

    def __str__(self) -> str:
        aside = f" ({self.still_aside} of them set aside)" if self.still_aside else ""
        parts = [f"{self.judged} recordings judged", f"{self.known} known before{aside}"]
        if self.duplicates:
            parts.append(f"{len(self.duplicates)} duplicates")
        if self.set_aside:
            parts.append(f"{len(self.set_aside)} set aside")
        return ", ".join(parts) + "."


class Paths:
    """Files of recordings, and what their paths say, or the table of runs that names them."""

    def __init__(self, given: str | Path | Iterable[str | Path], pattern: str | None) -> None:
        items = [Path(given)] if isinstance(given, str | Path) else [Path(one) for one in given]
        self.roots = [one for one in items if one.is_dir()]
        self.files: list[Path] = []
        self._listed: dict[Path, tuple[str, datetime | None]] = {}
        for one in items:
            if is_table_of_runs(one):
                for files, start, row in listed(one):
                    self.files += files
                    when = None if start is None else moment_of(start)
                    self._listed |= dict.fromkeys(files, (row.get("serial", ""), when))
            elif one.is_dir():
                known = set(known_suffixes())
                inside = (path for path in one.rglob("*") if path.suffix.lower() in known)
                self.files += sorted(
                    path for path in inside if path.is_file()
                    and not any(part.startswith(".") for part in path.relative_to(one).parts)
                )  # fmt: skip
            elif one.is_file():
                self.files.append(one)
            else:
                raise InputError(f"There is no file or folder {one}. Give one with recordings.")
        try:
            self._pattern = None if pattern is None else re.compile(pattern)
        except (re.error, TypeError) as error:
            raise InputError(
                f"The pattern {pattern!r} is no regular expression: {error}."
            ) from None
        if self._pattern is not None and "serial" not in self._pattern.groupindex:
            raise InputError(
                f"The pattern {pattern!r} has no group serial. Write for example "
                r"(?P<serial>EMA-\d+)."
            )

    def told(self, path: Path) -> tuple[str, datetime | None]:
        """Serial number and time, UTC, that its table or its path says; "" and None for none."""
        serial, time = self._listed.get(path, ("", None))
        date = _DATE.search(path.name)
        text = date and date[0]
        if self._pattern is not None:
            match = self._pattern.search(str(path))
            serial = serial or (match["serial"] if match else "")
            if "time" in self._pattern.groupindex:
                text = match and match["time"]
        elif not serial:
            inside = [path.relative_to(one) for one in self.roots if path.is_relative_to(one)]
            serial = inside[0].parts[0] if inside and len(inside[0].parts) > 1 else ""
        if time is None and text is not None:
            clock = re.sub(r"\D", "", text[10:])
            with suppress(InputError):
                time = moment_of(f"{text[:10]}T{clock}" if clock else text[:10])
        return serial, time


class Twins:
    """The calibrations of a fleet, by serial number and the day from which they hold.

    Those in the store's ``calibrations``, and ``given`` for actuators without a file there: what
    `ematwin.identify` takes; None for none. What judges is kept among the store's ``twins``.
    """

    def __init__(self, store: FleetStore, given: Any = None) -> None:
        self._by: dict[str, list[tuple[datetime, str]]] = {}
        for path in sorted((store.folder / "calibrations").glob("[!.]*.toml")):
            serial, _, since = path.stem.partition("@")
            try:
                begin = moment_of(since) if since else _EARLIEST
            except InputError as error:
                raise InputError(f"{path} has no day after its @. {error}") from None
            self._by.setdefault(serial, []).append((begin, store.keep_twin(path)))
        for periods in self._by.values():
            periods.sort()
        self._given = "" if given is None else store.keep_twin(Calibration.of(given))
        every = (mark for periods in self._by.values() for _, mark in periods)
        self._reading = self._given or next(every, "")

    def select(self, serial: str, time: datetime | None) -> str:
        """Fingerprint of the twin that judges an actuator at a time; "" if there is none.

        Without a serial number one that reads the file, which may say it.
        """
        if not serial:
            return self._reading
        if time is None:
            return ""
        held = [mark for begin, mark in self._by.get(serial, ()) if begin <= time]
        if held:
            return held[-1]
        return "" if serial in self._by else self._given


def watch(
    store: FleetStore,
    recordings: str | Path | Iterable[str | Path],
    actuator: Any = None,
    *,
    pattern: str | None = None,
    columns: Any = None,
    threads: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[float], None] | bool | None = None,
) -> Watched:
    """Judge the recordings that are not in the store yet, on all cores, and keep each at once.

    Parameters
    ----------
    recordings : a folder, which is searched with all folders in it; a file; a table of runs
        (columns path, serial, time); or several of these
    actuator : the twin of actuators that have no file among ``calibrations``
    pattern : regular expression for paths with a group ``serial``, and perhaps one ``time``
    columns : as of `ematwin.read`
    threads : threads that share the work; None takes one for each core
    scheduler : address of a Dask scheduler, tcp://host:8786, whose workers share the work instead;
        they see the folders of recordings and fleet under the same paths
    progress : True shows a bar; else called with the share done

    `InputError` if there is no such folder, or the pattern cannot be used; `EngineError` if the
    scheduler or its workers are lost: finished judgements are kept.
    """
    if scheduler is not None:  # its workers have other working directories
        several = [recordings] if isinstance(recordings, str | Path) else recordings
        store, recordings = FleetStore(store.folder.resolve()), [Path(p).resolve() for p in several]
    paths, found = Paths(recordings, pattern), Watched()
    fields = ["content", "serial_number", "time", "twin", "grade", "source"]
    rows = store.rows().select(fields).to_pylist()  # by time
    latest = {row["serial_number"]: row["time"] for row in rows if row["time"] is not None}
    known: dict[str, list[dict[str, Any]]] = {}  # what each file gave, by its hash
    for row in rows:
        known.setdefault(row["content"], []).append(row)
    judge = _Judge(store, Twins(store, actuator), paths, columns, latest)
    todo: dict[str, Path] = {}  # by content
    seen: set[str] = set()
    for path in paths.files:
        try:
            content = content_of(path)
        except FileError as error:  # unreadable, or removed meanwhile; it has no row
            found.set_aside.append((str(path), str(error)))
            continue
        if content in seen:
            found.duplicates.append(str(path))
        elif content in known and not judge.judges_anew(path, known[content]):
            found.known += 1
            found.still_aside += all(row["grade"] == SET_ASIDE for row in known[content])
        else:
            todo[content] = path
        seen.add(content)
    order = list(todo.items())
    random.SystemRandom().shuffle(order)  # of two watchers each begins with others
    lent = max(1, min(threads or cores(), len(todo)))
    with told(progress, "judging") as tell, _workers(lent, scheduler if todo else None) as pool:
        tasks = [pool.submit(judge, path, content) for content, path in order]
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
            for task in tasks:
                task.cancel()
            raise
    store.merge()
    return found


@contextmanager
def _workers(threads: int, scheduler: str | None) -> Iterator[Executor]:
    """Threads here, or the workers of a Dask scheduler."""
    if scheduler is None:
        with ThreadPoolExecutor(threads) as pool:
            yield pool
        return
    from ematwin.benchmarking.dask import DaskEngine
    from ematwin.benchmarking.engine import EngineError

    engine = DaskEngine(scheduler, threads)
    engine.start()
    from distributed import KilledWorker

    try:
        yield engine.client.get_executor(pure=False, retries=3)
    except (CancelledError, KilledWorker, OSError):
        raise EngineError(
            f"The scheduler at {scheduler} was lost, or its workers were. Results so far are kept; "
            "start them, and give the same command again."
        ) from None
    finally:
        engine.close()


@dataclass
class _Judge:
    """Judges files."""

    store: FleetStore
    twins: Twins
    paths: Paths
    columns: Any
    latest: dict[str, datetime]  # time of the latest recording of each actuator

    def judges_anew(self, path: Path, rows: Sequence[dict[str, Any]]) -> bool:
        """Whether another twin judges a file now, or it was set aside under another name."""
        serial, stated = self.paths.told(path)
        for row in rows:
            if row["grade"] == SET_ASIDE and Path(row["source"]).parts[-2:] != path.parts[-2:]:
                return True
            judge = self.twins.select(row["serial_number"] or serial, row["time"] or stated)
            if judge != row["twin"]:
                return True
        return False

    def __call__(self, path: Path, content: str) -> list[dict[str, Any]]:
        """The rows of a file, which are kept before they are given."""
        store, select = self.store, self.twins.select
        serial, stated = self.paths.told(path)
        try:
            first = select(serial, stated or datetime.now(UTC))
            actuator = store.twin(first).actuator if first else actuator_for(path, self.columns)
            several = read(path, self.columns, actuator=actuator, split=True)
        except Exception as error:  # whatever a damaged file makes a reader raise
            made: dict[str, Any] = {
                "content": content, "motion": 0, "twin": select(serial, stated)
            }  # fmt: skip
            rows = [_aside(error, serial, stated, path, made)]
            store.add(rows)
            return rows
        found = []
        by: dict[str, list[str]] = {}
        for motion, one in enumerate(several):
            who, when = one.labels.get("serial_number", serial), stated
            if one.start is not None:  # when its time is zero, which may be in another motion
                when = moment_of(one.start) + timedelta(seconds=float(one.time[0]))
            made = {"content": content, "motion": motion, "twin": select(who, when)}
            found.append((one, who, when, made))
            by.setdefault(who, []).append(id_of(**made))
        if by and all(store.has(who, ids) for who, ids in by.items()):
            return []  # another watcher was faster
        rows = []
        for one, who, when, made in found:
            try:
                late = when is not None and when < self.latest.get(who, when)
                more = {"source": str(path), "note": "late" if late else ""}
                rows.append(_row(one, who, when, store, **more, **made))
            except Exception as error:  # the rest goes on
                rows.append(_aside(error, who, when, path, made))
        store.add(rows)
        return rows


def _row(
    one: Recording, serial: str, when: datetime | None, store: FleetStore, *, twin: str, **more: Any
) -> dict[str, Any]:
    """The row of a recording."""
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
    if when < _EARLIEST or when > datetime.now(UTC) + timedelta(days=1):  # zones are a day apart
        raise RecordError(
            f"It was recorded on {when:%Y-%m-%d} by its own clock, which cannot be. Correct the "
            "time of the recorder."
        )
    if not twin:
        raise RecordError(
            f"There is no twin of {serial} at {when:%Y-%m-%d}. Put its calibration into the "
            f"fleet as calibrations/{serial}.toml, or give one for all with --actuator."
        )
    known = store.twin(twin)
    found = identify(one, known, threads=1)
    estimate, verdict = found.estimate, found.verdict
    faults = {f.name for f in known.model.faults(known.actuator) if f.direction_of is None}
    at = [n for n, name in enumerate(estimate.names) if name in faults]
    load = one.channels.get(known.model.load or "")
    return row_of(
        serial, when, twin=twin, kind=known.model.kind, grade=verdict.grade,
        faults=list(verdict.faults), sentence=verdict.sentence, reason=verdict.reason,
        names=[estimate.names[n] for n in at], values=estimate.values[at].tolist(),
        covariance=estimate.covariance[np.ix_(at, at)].ravel().tolist(),
        temperature=_temperature(one), load=None if load is None else float(np.abs(load).mean()),
        **more,
    )  # fmt: skip


def _aside(
    error: Exception, serial: str, when: datetime | None, path: Path, made: dict[str, Any]
) -> dict[str, Any]:
    """The row of what could not be judged; its id is that of no judgement."""
    reason = str(error)
    if not isinstance(error, EmatwinError):
        reason = f"It cannot be judged ({type(error).__name__}: {reason[:200]})."
    more: dict[str, Any] = {"kind": "", "grade": SET_ASIDE, "reason": reason, "source": str(path)}
    own = id_of(made["content"], made["motion"], f"{made['twin']} {reason} {path}")
    return row_of(serial, when, **made, **more) | {"id": own}


def _temperature(one: Recording) -> float | None:
    """Degrees Celsius: a label, or the mean of a channel of that name."""
    text = one.labels.get("temperature")
    if text is not None:
        match = re.match(r"\s*([-+]?\d+(?:\.\d+)?)", text)
        return float(match[1]) if match else None
    channel = one.channels.get("temperature")
    return None if channel is None else float(channel.mean())
