"""A table of pandas as if it were a file: found by name, with units and maps, like any other."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings.formats.base import Progress, RecordedFile

_TIMES = ("time", "t", "timestamp")  # of an index, in lower case, that it is one of time


class FrameFile(RecordedFile):
    """A DataFrame; its index counts as a channel where it is one of times or is called so.

    Units stand in the names of columns, or in ``frame.attrs["units"]``.
    """

    kind: ClassVar[str] = "DataFrame"

    def __init__(self, frame: Any) -> None:
        super().__init__(Path(str(frame.attrs.get("source", "") or "DataFrame")))
        self._columns: dict[str, Any] = {}
        name = frame.index.name
        dated = frame.index.dtype.kind in "mM"
        if dated or (name is not None and str(name).strip().casefold() in _TIMES):
            self._columns["time" if name is None else str(name)] = frame.index
        for place, column in enumerate(frame.columns):
            key = str(column)
            if key in self._columns:
                raise RecordError(f"The DataFrame has two columns {key!r}; rename one of them.")
            self._columns[key] = frame.iloc[:, place]
        self._units = {str(key): str(unit) for key, unit in frame.attrs.get("units", {}).items()}

    @property
    def names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(self._columns)

    def unit(self, name: str) -> str | None:  # noqa: D102
        return "s" if self._columns[name].dtype.kind in "mM" else self._units.get(name)

    def read(  # noqa: D102
        self, names: Sequence[str], progress: Progress | None = None
    ) -> dict[str, np.ndarray]:
        return self.each(names, lambda name: self._columns[name].to_numpy(), progress)

    def texts(self, name: str) -> list[str]:  # noqa: D102
        values = self._columns[name]
        if values.dtype.kind in "biufmM":
            return super().texts(name)
        return [str(value) for value in values.tolist()]
