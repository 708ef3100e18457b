"""Files of recordings: which there are, what paths or tables say of them, and their hashes."""

import re
from collections.abc import Iterable
from datetime import datetime
from functools import cache
from pathlib import Path

from ematwin.errors import InputError
from ematwin.fleet.store import content_of, moment_of
from ematwin.monitoring.runs import is_table_of_runs, listed
from ematwin.recordings.formats.base import known_suffixes

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}(?:[T_ ]\d{2}[-:]?\d{2}(?:[-:]?\d{2})?)?")


def hash_of(path: Path) -> str:
    """The hash of a file, which is read again only where its size or time has changed."""
    try:
        now = path.stat()
    except OSError:
        return content_of(path)  # which says why
    return _hash_of(path, now.st_size, now.st_mtime_ns)


@cache
def _hash_of(path: Path, size: int, time: int) -> str:
    return content_of(path)


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
        except (re.error, TypeError) as error:
            raise InputError(
                f"The pattern {pattern!r} is no regular expression: {error}."
            ) from None
        if self._pattern is not None and "serial" not in self._pattern.groupindex:
            raise InputError(
                f"The pattern {pattern!r} has no group serial. Write for example "
                r"(?P<serial>EMA-\d+)."
            )

    def serial(self, path: Path) -> str:
        """Serial number that its table or its path says; "" for none."""
        if (said := self._listed.get(path)) and said[0]:
            return said[0]
        if self._pattern is not None:
            match = self._pattern.search(str(path))
            return match["serial"] if match else ""
        for root in self.roots:
            if path.is_relative_to(root):
                inside = path.relative_to(root).parts[:-1]
                return inside[0] if inside else ""
        return ""

    def time(self, path: Path) -> datetime | None:
        """Time that its table or its path says, UTC."""
        if (said := self._listed.get(path)) and said[1]:
            return said[1]
        match = _DATE.search(path.name)
        text = match and match[0]
        if self._pattern is not None and "time" in self._pattern.groupindex:
            match = self._pattern.search(str(path))
            text = match and match["time"]
        if text is None:
            return None
        day, clock = text[:10], re.sub(r"\D", "", text[10:])
        parts = ":".join(clock[n : n + 2] for n in range(0, len(clock), 2))
        try:
            return moment_of(f"{day}T{parts}" if parts else day)
        except InputError:
            return None
