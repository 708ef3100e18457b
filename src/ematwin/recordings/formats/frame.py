"""A table of pandas as if it were a file: found by name, with units and maps, like any other."""

from pathlib import Path
from typing import Any, ClassVar

from ematwin.errors import RecordError
from ematwin.recordings.formats.base import RecordedFile


class FrameFile(RecordedFile):
    """A DataFrame; its index counts as a channel where it is one of times or is called so.

    Units stand in the names of columns, or in ``frame.attrs["units"]``.
    """

    kind: ClassVar[str] = "DataFrame"

    def __init__(self, frame: Any) -> None:
        super().__init__(Path(str(frame.attrs.get("source", "") or "DataFrame")))
        name = frame.index.name
        dated = frame.index.dtype.kind in "mM"
        if dated or (
            name is not None and str(name).strip().casefold() in ("time", "t", "timestamp")
        ):
            self.channels["time" if name is None else str(name)] = frame.index
        for place, column in enumerate(frame.columns):
            key = str(column)
            if key in self.channels:
                raise RecordError(f"The DataFrame has two columns {key!r}; rename one of them.")
            self.channels[key] = frame.iloc[:, place]
        self._units = {str(key): str(unit) for key, unit in frame.attrs.get("units", {}).items()}

    def unit(self, name: str) -> str | None:  # noqa: D102
        return "s" if self.channels[name].dtype.kind in "mM" else self._units.get(name)

    def values(self, name: str) -> Any:  # noqa: D102
        return self.channels[name].to_numpy()
