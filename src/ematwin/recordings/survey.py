"""Survey: every channel of a file with its unit, range and shape, and which it may be."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import RecordError
from ematwin.recordings import words
from ematwin.recordings.channel import Channel
from ematwin.recordings.formats.base import Progress, RecordedFile, open_file


@dataclass(frozen=True)
class Surveyed:
    """One channel of a file."""

    name: str  # full name in the file
    unit: str  # as the file or the name states it; "" where neither does
    unit_from: str  # "file", "name" or ""
    stem: str  # the last part of the name without a unit
    samples: int = 0
    missing: int = 0  # of them, NaN or infinite
    low: float = float("nan")  # least value, in ``unit``; NaN where there is none
    high: float = float("nan")  # largest value
    # samples per second, Hz, where the file itself gives times; else None
    rate: float | None = None
    # (P,) arrays, numbers of samples and values of a thinned trace
    places: np.ndarray = field(default_factory=lambda: np.empty(0))
    shape: np.ndarray = field(default_factory=lambda: np.empty(0))
    text: str = ""  # a few values, where it holds texts or nothing that is a number

    @property
    def is_text(self) -> bool:
        """Whether it holds no numbers."""
        return bool(self.text)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        told = ["name", "unit", "unit_from", "samples", "missing", "low", "high", "rate", "text"]
        found = {key: getattr(self, key) for key in told}
        return {key: None if x == "" or x != x else x for key, x in found.items()}


@dataclass(frozen=True)
class Survey:
    """All channels of a file, and the assumptions made in reading it."""

    path: Path
    kind: str
    channels: tuple[Surveyed, ...]
    assumed: tuple[str, ...]

    def __getitem__(self, name: str) -> Surveyed:
        return next(one for one in self.channels if one.name == name)

    @property
    def has_times(self) -> bool:
        """Whether the format itself gives times."""
        return any(one.rate is not None for one in self.channels)


def survey(path: Any, *, progress: Progress | None = None) -> Survey:
    """Look at every channel of a file of a known format, or of a DataFrame."""
    with open_file(path) as file:
        names = file.names
        rates: dict[str, float | None] = {}
        found: list[Surveyed] = []
        together = 64  # channels: a text table is read through for each lot
        for start in range(0, len(names), together):
            some = names[start : start + together]
            values = _numbers(file, some)
            found += [_surveyed(file, name, values.get(name), rates) for name in some]
            if progress is not None:
                progress(min(1.0, (start + len(some)) / len(names)))
        return Survey(file.given, file.kind, tuple(found), tuple(file.assumed))


def _numbers(file: RecordedFile, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The channels that can be read as numbers."""
    try:
        return file.read(names)
    except RecordError:  # one of them holds text; reading each shows which
        if len(names) == 1:
            return {}
        return {key: one for name in names for key, one in _numbers(file, [name]).items()}


def _surveyed(
    file: RecordedFile, name: str, values: np.ndarray | None, rates: dict[str, float | None]
) -> Surveyed:
    stated = unit_and_stem(file, name)
    if values is None:
        try:
            seen = list(dict.fromkeys(file.texts(name)))
            text = ", ".join(seen[:3]) + (" ..." if len(seen) > 3 else "") or "empty"
        except RecordError:
            text = "no numbers"
        return Surveyed(name, *stated, text=text)
    base = file.time_base(name)
    if base not in rates:
        time = file.base_time(base)
        step = 0.0 if time is None or time.size < 2 else float(np.median(np.diff(time)))
        rates[base] = 1.0 / step if step > 0.0 else None
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (np.nan, np.nan)
    places = extremes(values, 600)  # points of a small plot
    missing = values.size - finite.size
    return Surveyed(
        name, *stated, values.size, missing, low, high, rates[base], places, values[places]
    )


def unit_and_stem(file: RecordedFile, name: str) -> tuple[str, str, str]:
    """The unit of a channel, who states it (the file or the name, or nobody), and the stem."""
    stem, unit = words.beside(name)
    stem, stated = words.bare(words.last_part(stem)), file.stated_unit(name)
    if stated:
        return stated, "file", stem
    # square brackets hold units; round ones hold remarks as well: "Position (filtered)"
    is_bracketed = name.rstrip().endswith("]") and not words.says_nothing(unit)
    if is_bracketed or words.is_unit(unit):
        return unit, "name", stem
    for before, unit in words.suffixes(stem, file.names):
        if unit == "A" or (len(unit) > 1 and words.is_unit(unit)):  # other letters are of a series
            return unit, "name", before
    return "", "", stem


def extremes(values: np.ndarray, points: int) -> np.ndarray:
    """Indices (P,), increasing, P <= ``points``, of a trace (S,) whose line looks like the whole.

    Each of ``points / 2`` stretches gives its least and its largest value, so that no spike is
    lost; the first and the last sample stay. NaN counts as missing.

    Jugel, Jerzak, Hackenbroich and Markl (2014), Proc. VLDB Endow. 7(10), 797-808: what min and max
    of a column of pixels keep.
    """
    count = values.size
    if count <= points:
        return np.arange(count)
    width = -(-count // max(points // 2 - 1, 1))
    start = np.arange(0, count, width)
    ends = (0, start.size * width - count)
    whole = np.pad(values, ends, constant_values=np.nan).reshape(start.size, width)
    known = np.isfinite(whole)
    least = start + np.where(known, whole, np.inf).argmin(1)
    largest = start + np.where(known, whole, -np.inf).argmax(1)
    some = known.any(1)
    return np.unique(np.concatenate([[0], least[some], largest[some], [count - 1]]))


@dataclass(frozen=True)
class Candidate:
    """A channel of the file that may be one of the recording."""

    name: str  # in the file
    score: float  # how strongly name and unit speak for it
    reason: str = ""  # a part of a sentence


def _is_of_a_probe(one: Surveyed) -> bool:
    """Whether a voltage of unknown meaning is so small that a probe makes it of a current."""
    size = max(abs(one.low), abs(one.high)) * words.unit_factor(one.unit, "V", one.name)
    return size < 1.0 and not words.said_by(one.stem).quantities


def candidates(
    channel: Channel, surveyed: Sequence[Surveyed], channels: Sequence[Channel]
) -> list[Candidate]:
    """The channels of a file that may be ``channel``, the likeliest first."""
    names = [one.name for one in surveyed]
    found = []
    for one in surveyed:
        if one.is_text or not one.samples or (one.unit and not words.fits(one.unit, channel.unit)):
            continue
        own, score = words.named(one.name, channels, names)
        is_own = score == words.OWN_NAME
        if own == channel.name:
            said = "it has that name" if is_own else "its name is one that files use for it"
            found.append(Candidate(one.name, score, said))
        elif not own and not (channel.unit == "V" and one.unit and _is_of_a_probe(one)):
            by_words = words.by_words(one.stem, one.unit, channel)
            found += [Candidate(one.name, *by_words)] if by_words else []
    return sorted(found, key=lambda one: -one.score)
