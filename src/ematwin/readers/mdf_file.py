"""MDF files (version 3 and 4), through asammdf, channel by channel.

A name that stands in several channel groups is told apart as ``group 2/speed``.
"""

import gc
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import FileError
from ematwin.readers.recording import Progress, Recording, as_float, load_library, refusing


class MdfRecording(Recording):
    """An MDF file: each channel group has a time base of its own."""

    kind: ClassVar[str] = "MDF"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        library = load_library("asammdf", "asammdf", "Reading MDF files")
        self._file = _open(library, path)
        places = [
            (channel.name, group, index)
            for group, content in enumerate(self._file.groups)
            for index, channel in enumerate(content.channels)
            if index != self._file.masters_db.get(group)
        ]
        times = Counter(name for name, _, _ in places)
        self._places: dict[str, tuple[int, int]] = {}
        for name, group, index in places:
            full = name if times[name] == 1 else f"group {group}/{name}"
            self._places.setdefault(full, (group, index))

    @property
    def names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(self._places)

    def unit(self, name: str) -> str | None:  # noqa: D102
        group, index = self._places[name]
        return self._file.get_channel_unit(group=group, index=index) or None

    def time_base(self, name: str) -> str:  # noqa: D102
        return f"group {self._places[name][0]}"

    def base_time(self, key: str) -> np.ndarray | None:  # noqa: D102
        group = int(key.removeprefix("group "))
        if group not in self._file.masters_db:
            return None
        with refusing(self.path, self.kind):
            return as_float(self._file.get_master(group), f"time of {key}", self.path)

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        columns: dict[str, np.ndarray] = {}
        with refusing(self.path, self.kind):
            for done, name in enumerate(names, start=1):
                columns[name] = self._values(name)
                if progress is not None:
                    progress(done / len(names))
        return columns

    def close(self) -> None:  # noqa: D102
        if self._file is not None:
            self._file.close()
            self._file = None

    def _values(self, name: str) -> np.ndarray:
        group, index = self._places[name]
        samples, invalid = self._file.get(
            group=group, index=index, samples_only=True, ignore_invalidation_bits=True
        )
        promised = self._file.groups[group].channel_group.cycles_nr
        if len(samples) != promised:
            raise FileError(
                f"{self.path} promises {promised} samples of {name!r} and holds {len(samples)}. "
                "It was truncated; copy it again."
            )
        values = as_float(samples, name, self.path)
        if invalid is not None:
            values[np.asarray(invalid, dtype=bool)] = np.nan
        return values


def _open(library: Any, path: Path) -> Any:
    """An `asammdf.MDF`; quiet where it cannot be opened.

    The destructor of the half-made object complains on stderr. The object dies with the
    exception that refers to it, so both are let go while such complaints are switched off.
    """

    def ignore(_: Any) -> None:
        return None

    before = sys.unraisablehook
    sys.unraisablehook = ignore
    try:
        try:
            return library.MDF(path)
        except Exception as error:
            reason = str(error) or type(error).__name__
        gc.collect()  # it may be part of a cycle
    finally:
        sys.unraisablehook = before
    raise ValueError(reason)
