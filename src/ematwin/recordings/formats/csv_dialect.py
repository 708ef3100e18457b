"""How a text table is written: encoding, delimiter, decimal sign, header, units, first row.

Looked for in the first lines and in a piece from the middle: the first rows may hold zeros only,
which show no decimal sign. clevercsv finds delimiters only, csv.Sniffer took a carriage return for
one, and charset-normalizer took Windows-1252 for a code page of DOS.

Clock times are ``2026-11-21 08:00:00.001``, ``03.03.2026 09:14:02,000``, ``11/21/2026 8:00:00 PM``,
or ``09:14:02.000050`` without a date. Dates with dots begin with the day; those with slashes with
the month, if the time is of a.m. or p.m. or a number shows it.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import FileError, RecordError
from ematwin.recordings.tables import MARK, NAT, checked, without_apostrophe
from ematwin.recordings.words import is_unit, unbracketed

ROUTINE = "table read with "  # begins the sentence that is said of each table
PLACEHOLDERS = ["-", "--", "---"]  # what programs write for a missing value, beside NaN and kin
_SAMPLE = 1 << 16  # bytes looked at, at the head and in the middle
_MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "inf", "-inf", *PLACEHOLDERS}
_UNITS_OF_A_LETTER = frozenset("smghACFHJKNTVW%°Ω1")
_NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?"),
}
_CLOCK = re.compile(
    r"(?:(\d{4})-(\d\d?)-(\d\d?)[T ]\s*|(\d\d?)([./])(\d\d?)[./](\d{4}),? \s*)?"
    r"(\d\d?):(\d\d):(\d\d)(?:[.,](\d{1,9}))?\s*(?:([AaPp])\.?[Mm]\.?)?\s*(Z|[+-]\d\d:?\d\d)?"
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class Clock:
    """How the clock times of a column are written."""

    is_dated: bool  # whether dates stand before the times
    is_utc: bool  # whether they state a time zone, and are brought to UTC
    month_first: bool | None = None  # of dates with slashes; None where there are none

    @classmethod
    def of(cls, texts: Sequence[str]) -> "Clock | None":
        """The clock of a column with these cells; None if none of them is a clock time."""
        found = [match for text in texts if (match := _CLOCK.fullmatch(text.strip()))]
        if not found:
            return None
        slashed = [match for match in found if match[5] == "/"]
        day_first = any(int(match[4]) > 12 for match in slashed)
        month_first = any(match[12] or int(match[6]) > 12 for match in slashed) and not day_first
        is_dated = any(match[1] or match[4] for match in found)
        is_utc = any(match[13] for match in found)
        return cls(is_dated, is_utc, month_first if slashed else None)

    @property
    def zone(self) -> tzinfo | None:
        """Time zone of its times; None if they state none."""
        return UTC if self.is_utc else None

    def times(self, texts: Sequence[str | None]) -> np.ndarray:
        """Times (S,), datetime64, on the first of 1970 if without a date; NaT for empty cells."""
        ticks = np.array([self._one(text) for text in texts], dtype=np.int64)
        return ticks.view("datetime64[ns]")

    def _one(self, text: str | None) -> int:
        if text is None or not text.strip():
            return NAT
        match = _CLOCK.fullmatch(text.strip())
        try:
            if match is None:
                raise ValueError
            year, month, day, first, _, second, later_year = match.groups()[:7]
            if first is not None:
                year, day, month = later_year, first, second
                if self.month_first:
                    day, month = month, day
            hour, minute, second, fraction, half, zone = match.groups()[7:]
            hours = int(hour) % 12 + 12 * (half in "pP") if half else int(hour)
            if hours > 23 or int(second) > 60:  # 60 is a leap second
                raise ValueError
            date = f"{year or 1970}-{month or 1:0>2}-{day or 1:0>2}"
            began = datetime.fromisoformat(f"{date}T{hours:02}:{minute}{zone or 'Z'}")
        except ValueError:
            raise RecordError(f"{text!r} is no clock time such as 09:14:02.5") from None
        seconds = (began - _EPOCH) // timedelta(seconds=1) + int(second)
        return seconds * 10**9 + int((fraction or "").ljust(9, "0"))


def over_midnight(seconds: np.ndarray) -> np.ndarray:
    """Times of day (S,), s, counted on where midnight lies between two of them."""
    steps = np.diff(seconds, prepend=seconds[:1])
    past = (steps < 0.0) & (steps + 86_400.0 < 60.0)  # a longer step is none of one recording
    return seconds + 86_400.0 * np.cumsum(past) if past.any() else seconds


@dataclass
class CsvDialect:
    """How a text table is written."""

    names: list[str]  # of the columns, unique
    units: list[str]  # of the columns, "" where the file states none
    delimiter: str  # as written
    decimal: str
    encoding: str
    start: int  # bytes before the first row of numbers
    # positions of columns with numbers such as ``+1.5``
    signed: set[int] = field(default_factory=set)
    # `Clock` of columns with clock times, by position
    clocks: dict[int, Clock] = field(default_factory=dict)
    text: set[int] = field(default_factory=set)  # positions of columns that hold neither
    # what ematwin wrote into the first line, else empty
    metadata: dict[str, Any] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)  # sentences for the provenance


def sniff(
    path: Path, delimiter: str | None = None, decimal: str | None = None,
    skip_rows: int | None = None,
) -> CsvDialect:  # fmt: skip
    """Recognise the dialect of a text table; options that are given are not guessed.

    Raises `FileError` if it is empty or no text; `RecordError` without rows of numbers.
    """
    head, middle, encoding, mark = _samples(path)
    lines = head.splitlines(keepends=True)
    if not head.strip():
        raise FileError(f"{path} is empty; nothing was recorded or it was cut off.")
    ours = lines[0].startswith(MARK)
    metadata = checked(lines[0][len(MARK) :] if ours else None, path, lines[0])
    hint = re.fullmatch(r"sep=(.)\s*", lines[0])
    if delimiter is None and hint:
        delimiter = hint[1]
    first = (skip_rows or 0) + (1 if hint and not skip_rows else 0)
    rows = [line for line in lines[first:] if not _is_comment(line)] or lines[first:]
    probe = [line for line in rows[-40:] + middle.splitlines()[1:-1][:40] if line.strip()]
    delimiter, decimal = _signs(probe, delimiter, decimal)

    split = [_fields(line, delimiter) for line in lines]
    probed = [_fields(line, delimiter) for line in probe]
    width = Counter(len(row) for row in probed).most_common(1)[0][0]
    numeric = max((_numbers(row, decimal) for row in probed), default=0)

    def is_row(n: int) -> bool:
        fits = len(split[n]) == width and 2 * _numbers(split[n], decimal) > numeric > 0
        return fits and not _is_comment(lines[n])

    data = next(filter(is_row, range(first, len(lines))), None)
    if data is None:
        if len(lines) - first <= 1:
            raise FileError(f"{path} holds a header and no rows.")
        raise RecordError(
            f"{path} has no rows of numbers that could be recognised; its line {first + 1} is "
            f"{lines[first].strip()[:60]!r}. Give delimiter, decimal and skip_rows in the map."
        )
    names, units, header_lines = _header(lines, split, first, data, width)
    columns = [[row[n].strip() for row in probed if len(row) == width] for n in range(width)]
    clocks = {n: clock for n, cells in enumerate(columns) if (clock := Clock.of(cells))}
    text = {
        n for n, cells in enumerate(columns)
        if n not in clocks and not _numbers(cells, decimal)
        and any(cell.casefold() not in _MISSING for cell in cells)
    }  # fmt: skip
    signed = {n for n, cells in enumerate(columns) if any(x.startswith("+") for x in cells)}
    start = mark + len("".join(lines[:data]).encode(encoding.removesuffix("-sig")))
    signs = (delimiter, decimal, encoding)
    dialect = CsvDialect(names, units, *signs, start, signed, clocks, text, metadata)
    if not metadata:
        dialect.assumed += _assumed(dialect, first, header_lines)
    return dialect


def _samples(path: Path) -> tuple[str, str, str, int]:
    """Text of the head and of the middle, the encoding, and the bytes of the byte order mark."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_SAMPLE)
        while head and b"\n" not in head[-_SAMPLE:] and len(head) < size and len(head) < 1 << 24:
            head += file.read(_SAMPLE)  # the metadata line of ematwin may be long
        head += file.read(_SAMPLE) if len(head) < size else b""
        middle = b""
        if size > 4 * _SAMPLE:
            file.seek(size // 4 * 2)
            middle = file.read(_SAMPLE)
    marks = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
    mark = next(filter(head.startswith, marks), b"")
    encoding = marks.get(mark, "utf-8")
    if not mark:
        if b"\x00" in head:
            said = "it holds binary data. Give it the ending of its format."
            raise FileError(f"Cannot read {path} as text: {said}")
        try:
            (head[: head.rfind(b"\n") + 1] or head).decode("utf-8")
        except UnicodeDecodeError:  # what Windows programs write in western countries
            encoding = "cp1252"
    code = encoding.removesuffix("-sig")
    text = head[len(mark) :].decode(code, "replace")
    if size > len(head):
        text = text[: text.rfind("\n") + 1]
    return text, middle.decode(code, "replace"), encoding, len(mark)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%", "//"))


def _fields(line: str, delimiter: str) -> list[str]:
    return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter), [""])


def _numbers(fields: Sequence[str], decimal: str) -> int:
    return sum(_NUMBER[decimal].fullmatch(text.strip()) is not None for text in fields)


def _signs(lines: Sequence[str], delimiter: str | None, decimal: str | None) -> tuple[str, str]:
    """The delimiter and the decimal sign with which most fields are numbers or clock times."""
    best: tuple[tuple[float, float, int], str, str] | None = None
    for sign in [delimiter] if delimiter else (",", ";", "\t", "|"):
        rows = [_fields(line, sign) for line in lines]
        width, votes = Counter(len(row) for row in rows).most_common(1)[0]
        filled = sum(text.strip().casefold() not in _MISSING for row in rows for text in row)
        clocks = sum(_CLOCK.fullmatch(text.strip()) is not None for row in rows for text in row)
        for mark in [decimal] if decimal else [".", ","]:
            if mark == sign and not any('"' in line for line in lines):
                continue
            share = (clocks + sum(_numbers(row, mark) for row in rows)) / max(filled, 1)
            # a file of one column tells no delimiter: more columns win between equals
            score = (round(share, 3) if width > 1 else share / 2, votes / len(rows), width)
            if best is None or score > best[0]:
                best = (score, sign, mark)
    if best is None:
        return delimiter or ",", decimal or "."
    return best[1], best[2]


def _header(
    lines: Sequence[str], split: Sequence[list[str]], first: int, data: int, width: int
) -> tuple[list[str], list[str], int]:
    """Names, units and number of header lines, from the lines right above the first row."""
    above: list[list[str]] = []
    for n in range(data - 1, first - 1, -1):
        if not lines[n].strip():
            continue
        row = [text.strip() for text in split[n]]
        if _is_comment(lines[n]):
            if above or lines[n].startswith(MARK):
                break
            row[0] = row[0].lstrip("#%/ ")  # the header of numpy.savetxt is a comment
        row = row[:width] + [""] * (width - len(row))
        if not any(row) or len(split[n]) < max(2, width // 2) or len(above) == 3:
            break
        above.insert(0, row)
    if not above:
        return [str(n + 1) for n in range(width)], [""] * width, 0
    units = [""] * width
    for n in range(len(above) - 1, 0, -1):
        texts = [unbracketed(text) for text in above[n]]
        filled = [text for text in texts if text and text != "-"]
        if any(is_unit(text) for text in filled) and not _is_header(texts, above[n - 1]):
            units = texts
            above = above[:n]
            break
    given = list(map(without_apostrophe, above[-1]))
    names = [
        f"{name} ({n})" if name and given.count(name) > 1 else name or f"column {n}"
        for n, name in enumerate(given, 1)
    ]
    return names, units, len(above)


def _is_header(texts: Sequence[str], above: Sequence[str]) -> bool:
    """Whether single letters are names, ``t;A;v``, and no units, ``s;A;m/s``, of the line above."""
    letters = [n for n, text in enumerate(texts) if text and text != "-"]
    if any(len(texts[n]) > 1 for n in letters):
        return False
    named = all(above[n] and not _NUMBER["."].fullmatch(above[n]) for n in letters)
    return not (named and all(texts[n] in _UNITS_OF_A_LETTER for n in letters))


def _assumed(dialect: CsvDialect, skipped: int, header_lines: int) -> list[str]:
    signs = f"delimiter {dialect.delimiter!r}, decimal sign {dialect.decimal!r}"
    said = [f"{ROUTINE}{signs}, encoding {dialect.encoding}"]
    if skipped:
        said.append(f"{skipped} lines before the header were skipped")
    if header_lines == 0:
        said.append("no header was found: columns are named 1, 2, 3 in their order")
    if any(dialect.units):
        said.append("the line below the header was read as units")
    for position, clock in dialect.clocks.items():
        if clock.month_first is not None:
            order = "month/day" if clock.month_first else "day/month"
            said.append(f"dates in {dialect.names[position]} were read as {order}/year")
    return said
