"""Survey: what every channel of a file holds, before anybody says which channel is which."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import MissingExtraError, RecordError
from ematwin.recordings.formats.base import Progress, RecordedFile, last_part, open_file
from ematwin.recordings.thin import extremes
from ematwin.recordings.units import (
    is_other_unit,
    is_unit,
    says_nothing,
    unit_beside_name,
    units_behind,
)

SHOWN_POINTS = 600  # of the small plot of a channel
_TOGETHER = 64  # channels that are read at once: a text table is read through for each lot


@dataclass(frozen=True)
class Surveyed:
    """One channel of a file.

    Attributes
    ----------
    name : full name in the file
    unit : as the file or the name states it; "" where neither does
    unit_from : "file", "name" or ""
    samples, missing : how many, and how many of them are NaN or infinite
    low, high, middle : least, largest and median value, in ``unit``; NaN where there is none
    rate : samples per second, Hz, where the file itself gives times; else None
    base : key of its time base: channels of one key were sampled together
    places, shape : (P,) arrays, numbers of samples and values of a thinned trace
    text : a few values, where it holds texts or nothing that is a number
    """

    name: str
    unit: str
    unit_from: str
    samples: int
    missing: int
    low: float
    high: float
    middle: float
    rate: float | None
    base: str
    places: np.ndarray
    shape: np.ndarray
    text: str = ""

    @property
    def is_text(self) -> bool:
        """Whether it holds no numbers."""
        return bool(self.text)

    @property
    def is_constant(self) -> bool:
        """Whether all its numbers are the same."""
        return not self.is_text and self.low == self.high

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "unit": self.unit or None,
            "unit_from": self.unit_from or None,
            "samples": self.samples,
            "missing": self.missing,
            "low": _number(self.low),
            "high": _number(self.high),
            "rate": self.rate,
            "text": self.text or None,
        }


@dataclass(frozen=True)
class Survey:
    """All channels of a file, and what was assumed in reading it."""

    path: Path
    kind: str
    channels: tuple[Surveyed, ...]
    assumed: tuple[str, ...]

    def __getitem__(self, name: str) -> Surveyed:
        return next(one for one in self.channels if one.name == name)


def survey(path: Any, *, progress: Progress | None = None, **options: Any) -> Survey:
    """Look at every channel of a file.

    Parameters
    ----------
    path : a file of a known format, or a DataFrame
    progress : called with the share read, in [0, 1], now and then
    **options : of a text table, see `ematwin.recordings.channel_map.CsvOptions`

    Raises
    ------
    FileError
        If the file cannot be read.
    MissingExtraError
        If the library for this format is not installed.
    """
    with open_file(path, **options) as file:
        names = file.names
        rates: dict[str, float | None] = {}
        found: list[Surveyed] = []
        for start in range(0, len(names), _TOGETHER):
            some = names[start : start + _TOGETHER]
            values = _read(file, some)
            found += [_surveyed(file, name, values.get(name), rates) for name in some]
            if progress is not None:
                progress(min(1.0, (start + len(some)) / len(names)))
        return Survey(file.path, file.kind, tuple(found), tuple(file.assumed))


def _read(file: RecordedFile, names: Sequence[str]) -> dict[str, np.ndarray]:
    """What can be read as numbers."""
    try:
        return file.read(names)
    except MissingExtraError:
        raise
    except RecordError:  # one of them holds text: which, only reading each tells
        values: dict[str, np.ndarray] = {}
        for name in names:
            try:
                values |= file.read([name])
            except RecordError:
                continue
        return values


def _surveyed(
    file: RecordedFile, name: str, values: np.ndarray | None, rates: dict[str, float | None]
) -> Surveyed:
    unit, source = _unit(file, name)
    base = file.time_base(name)
    none = np.empty(0)
    if values is None:
        nan = float("nan")
        told = _texts(file, name)
        return Surveyed(name, unit, source, 0, 0, nan, nan, nan, None, base, none, none, told)
    if base not in rates:
        rates[base] = _rate(file.base_time(base))
    finite = values[np.isfinite(values)]
    low, high, middle = (
        (float(finite.min()), float(finite.max()), float(np.median(finite)))
        if finite.size
        else (float("nan"),) * 3
    )
    places = extremes(values, SHOWN_POINTS)
    return Surveyed(
        name, unit, source, values.size, values.size - finite.size, low, high, middle,
        rates[base], base, places, values[places],
    )  # fmt: skip


def _unit(file: RecordedFile, name: str) -> tuple[str, str]:
    """The unit of a channel and who states it: the file or the name, or nobody."""
    stated = file.unit(name)
    if stated is not None and not says_nothing(stated):
        return stated.strip(), "file"
    beside = unit_beside_name(name)
    if beside is not None and not says_nothing(beside) and _looks_like_unit(name, beside):
        return beside, "name"
    behind = next(units_behind(last_part(name), file.names), None)
    return ("", "") if behind is None else (behind, "name")


def _looks_like_unit(name: str, beside: str) -> bool:
    """Square brackets hold units; round ones hold remarks as well: ``Position (filtered)``."""
    return name.rstrip().endswith("]") or is_unit(beside) or is_other_unit(beside)


def _texts(file: RecordedFile, name: str) -> str:
    try:
        seen = list(dict.fromkeys(file.texts(name)))
    except RecordError:
        return "no numbers"
    return ", ".join(seen[:3]) + (" ..." if len(seen) > 3 else "") or "empty"


def _rate(time: np.ndarray | None) -> float | None:
    if time is None or time.size < 2:
        return None
    step = float(np.median(np.diff(time)))
    return 1.0 / step if step > 0.0 else None


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
