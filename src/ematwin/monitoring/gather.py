"""Recordings as they are given: themselves, or the files, folders or globs that hold them."""

import re
from collections.abc import Collection, Iterable
from glob import glob
from pathlib import Path
from typing import Any

from ematwin.errors import InputError
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.reading import actuator_for, read
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.channel import Columns
from ematwin.recordings.formats.base import known_suffixes
from ematwin.recordings.recording import Recording
from ematwin.showing.results import is_frame

Given = Recording | str | Path | Iterable[Recording | str | Path]  # or a DataFrame, or several
_GLOB = re.compile(r"[*?\[]")


def recordings_of(
    given: Given, actuator: ParameterSet, columns: Columns = None, *, averaged: bool = True
) -> list[Recording]:
    """Recordings at the rate at which they are compared; files are read as the actuator's kind.

    A table of several motions gives each of them. ``averaged`` False keeps the recorded rate.

    Raises
    ------
    InputError
        If nothing is given, or something that is no recording.
    FileError, RecordError
        If a file cannot be read.
    """
    single = _is_single(given)
    if not (single or isinstance(given, Iterable)):
        raise InputError(f"Give recordings, DataFrames or the paths of files, received {given!r}.")
    items: Iterable[Any] = [given] if single else given  # type: ignore[assignment]
    found: list[Recording] = []
    for n, one in enumerate(items, 1):
        if isinstance(one, Recording):
            if columns is not None:
                raise InputError("A Recording has its channels already; leave columns out.")
            own = [one]
        elif isinstance(one, str | Path):
            own = read(files_of(one), columns, actuator=actuator, split=True)
        elif is_frame(one):
            own = read(one, columns, actuator=actuator, split=True)
        else:
            raise InputError(
                f"Give recordings, DataFrames or the paths of files, received {type(one).__name__}."
            )
        # what comes from no file is a run of its own
        if not (single or isinstance(one, str | Path) or Path(own[-1].source).suffix):
            own = [
                each.changed(labels={**each.labels, "run": each.labels.get("run", str(n))})
                for each in own
            ]
        found += own
    if not found:
        raise InputError("No recording was given; give at least one.")
    return [model_of(actuator).averaged(one) for one in found] if averaged else found


def actuator_of(given: Given, columns: Columns = None) -> ParameterSet:
    """The actuator that is meant where none is named, by the first recording that is given."""
    # an iterator is not looked into: its first recording would be gone
    several = isinstance(given, Collection) and not _is_single(given)
    first = next(iter(given), None) if several else given  # type: ignore[arg-type]
    if isinstance(first, str | Path):
        first = files_of(first)[0]
    if first is None or not (isinstance(first, Recording | Path) or is_frame(first)):
        return load_actuator()  # what is wrong with it is said where it is read
    return actuator_for(first, columns)


def is_one(given: Any) -> bool:
    """Whether a recording, a DataFrame, or the path of one file is given."""
    if isinstance(given, str | Path):
        return not (Path(given).is_dir() or _is_glob(given))
    return _is_single(given)


def _is_single(given: Any) -> bool:
    return isinstance(given, Recording | str | Path) or is_frame(given)


def files_of(path: str | Path) -> list[Path]:
    """The files of recordings that a path, a folder or a glob means, day2 before day10.

    Raises
    ------
    InputError
        If a folder or a glob holds none.
    """
    path = Path(path)
    if not (path.is_dir() or _is_glob(path)):
        return [path]
    inside = path.iterdir() if path.is_dir() else map(Path, glob(str(path)))
    known = set(known_suffixes())
    found = [one for one in inside if one.suffix.lower() in known and one.is_file()]
    if not found:
        raise InputError(f"{path} holds no recording: no file ends in {', '.join(sorted(known))}.")
    return sorted(found, key=_in_order)


def _is_glob(path: str | Path) -> bool:
    return bool(_GLOB.search(str(path))) and not Path(path).exists()


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Numbers within a name count as numbers."""
    return [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", str(path))]
