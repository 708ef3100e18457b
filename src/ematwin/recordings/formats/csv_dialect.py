"""How a text table is written: encoding, delimiter, decimal sign, header, units, first row.

Looked for in the first lines and in a piece from the middle, because the first rows may hold
zeros only and so show no decimal sign. What was recognised is said in the provenance.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ematwin.errors import FileError, RecordError
from ematwin.recordings.sealed import damaged, looks_sealed, unsealed
from ematwin.recordings.spreadsheets import without_apostrophe
from ematwin.recordings.units import is_unit, unbracketed

METADATA_MARK = "# ematwin "
ROUTINE = "table read with "  # begins the sentence that is said of each table
_SAMPLE = 1 << 16  # bytes looked at, at the head and in the middle
_DELIMITERS = (",", ";", "\t", "|")
_COMMENT = ("#", "%", "//")
PLACEHOLDERS = ["-", "--", "---"]  # what programs write for a missing value, beside NaN and kin
_MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "inf", "-inf", *PLACEHOLDERS}
_CLOCK = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?Z?")
_UNITS_OF_A_LETTER = frozenset("smghACFHJKNTVW%°Ω1")
_NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?"),
}


@dataclass
class CsvDialect:
    """What `sniff` found.

    Attributes
    ----------
    names : of the columns, unique
    units : of the columns, "" where the file states none
    delimiter, decimal, encoding : as written
    start : bytes before the first row of numbers
    signed : positions of columns with numbers such as ``+1.5``
    clock : positions of columns with clock times such as ``2026-11-21 08:00:00.001``
    utc : positions of those whose clock times end in Z
    text : positions of columns that hold neither
    metadata : what ematwin wrote into the first line, else empty
    assumed : sentences for the provenance
    """

    names: list[str]
    units: list[str]
    delimiter: str
    decimal: str
    encoding: str
    start: int
    signed: set[int] = field(default_factory=set)
    clock: set[int] = field(default_factory=set)
    utc: set[int] = field(default_factory=set)
    text: set[int] = field(default_factory=set)
    metadata: dict[str, Any] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)


def sniff(
    path: Path,
    delimiter: str | None = None,
    decimal: str | None = None,
    skip_rows: int | None = None,
) -> CsvDialect:
    """Recognise how a text table is written; what is given is not guessed.

    Raises
    ------
    FileError
        If the file is empty, holds a header only, or is no text.
    RecordError
        If no rows of numbers can be recognised.
    """
    head, middle, encoding, mark = _samples(path)
    lines = head.splitlines(keepends=True)
    if not lines:
        raise FileError(f"{path} is empty; nothing was recorded or it was cut off.")
    metadata = _metadata(lines[0], path)
    hint = re.fullmatch(r"sep=(.)\s*", lines[0])
    if delimiter is None and hint:
        delimiter = hint[1]
    first = (skip_rows or 0) + (1 if hint and not skip_rows else 0)
    rows = [line for line in lines[first:] if not _is_comment(line)] or lines[first:]
    probe = [line for line in rows[-40:] + middle.splitlines()[1:-1][:40] if line.strip()]
    delimiter, decimal = _signs(probe, delimiter, decimal)

    split = [_fields(line, delimiter) for line in lines]
    width = Counter(len(_fields(line, delimiter)) for line in probe).most_common(1)[0][0]
    numeric = max((_numbers(_fields(line, delimiter), decimal) for line in probe), default=0)
    data = next(
        (
            n
            for n in range(first, len(lines))
            if not _is_comment(lines[n])
            and len(split[n]) == width
            and numeric > 0
            and 2 * _numbers(split[n], decimal) > numeric
        ),
        None,
    )
    if data is None:
        if len(lines) - first <= 1:
            raise FileError(f"{path} holds a header and no rows.")
        raise RecordError(
            f"{path} has no rows of numbers that could be recognised; its line {first + 1} is "
            f"{lines[first].strip()[:60]!r}. Give delimiter, decimal and skip_rows in the map."
        )
    names, units, header_lines = _header(lines, split, first, data, width)
    body = [row for row in (_fields(line, delimiter) for line in probe) if len(row) == width]
    code = "utf-8" if encoding == "utf-8-sig" else encoding
    clock = {n for n in range(width) if any(_CLOCK.fullmatch(row[n].strip()) for row in body)}
    dialect = CsvDialect(
        names=names,
        units=units,
        delimiter=delimiter,
        decimal=decimal,
        encoding=encoding,
        start=mark + len("".join(lines[:data]).encode(code)),
        signed={n for n in range(width) if any(row[n].strip().startswith("+") for row in body)},
        clock=clock,
        utc={n for n in clock if any(row[n].strip().endswith("Z") for row in body)},
        text={
            n
            for n in range(width)
            if not any(_is_number(row[n], decimal) for row in body)
            and any(row[n].strip().casefold() not in _MISSING for row in body)
        }
        - clock,
        metadata=metadata,
    )
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
    for mark, encoding, skipped in (
        (b"\xef\xbb\xbf", "utf-8-sig", 3),
        (b"\xff\xfe", "utf-16-le", 2),
        (b"\xfe\xff", "utf-16-be", 2),
    ):
        if head.startswith(mark):
            code = "utf-8" if encoding == "utf-8-sig" else encoding
            text = head[skipped:].decode(code, errors="ignore")
            return (
                _whole_lines(text, size > len(head)),
                middle.decode(code, "ignore"),
                encoding,
                skipped,
            )
    if b"\x00" in head:
        raise FileError(
            f"Cannot read {path} as text: it holds binary data. Give it the ending of its format."
        )
    complete = head[: head.rfind(b"\n") + 1] or head
    try:
        complete.decode("utf-8")
        encoding = "utf-8"
    except UnicodeDecodeError:
        encoding = "cp1252"  # what Windows programs write in western countries
    text = head.decode(encoding, errors="replace" if encoding == "cp1252" else "ignore")
    return _whole_lines(text, size > len(head)), middle.decode("latin-1"), encoding, 0


def _whole_lines(text: str, cut: bool) -> str:
    return text[: text.rfind("\n") + 1] if cut else text


def _metadata(line: str, path: Path) -> dict[str, Any]:
    if line.startswith(METADATA_MARK):
        return unsealed(line[len(METADATA_MARK) :], path)
    if looks_sealed(line):
        raise damaged(path, "its first line has lost its mark")
    return {}


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENT)


def _fields(line: str, delimiter: str) -> list[str]:
    line = line.rstrip("\r\n")
    if '"' not in line:
        return line.split(delimiter)
    return next(csv.reader([line], delimiter=delimiter), [""])


def _is_number(text: str, decimal: str) -> bool:
    return _NUMBER[decimal].fullmatch(text.strip()) is not None


def _numbers(fields: Sequence[str], decimal: str) -> int:
    return sum(_is_number(text, decimal) for text in fields)


def _signs(lines: Sequence[str], delimiter: str | None, decimal: str | None) -> tuple[str, str]:
    """The delimiter and the decimal sign with which most fields are numbers."""
    best: tuple[tuple[float, float, int], str, str] | None = None
    for sign in [delimiter] if delimiter else _DELIMITERS:
        rows = [_fields(line, sign) for line in lines]
        if not rows:
            break
        width, votes = Counter(len(row) for row in rows).most_common(1)[0]
        for mark in [decimal] if decimal else [".", ","]:
            if mark == sign and not any('"' in line for line in lines):
                continue
            filled = sum(text.strip().casefold() not in _MISSING for row in rows for text in row)
            share = sum(_numbers(row, mark) for row in rows) / max(filled, 1)
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
            if above or lines[n].startswith(METADATA_MARK):
                break
            row[0] = row[0].lstrip("#%/ ")  # the header of numpy.savetxt is a comment
        row = row[:width] + [""] * (width - len(row))
        filled = sum(bool(text) for text in row)
        if filled == 0 or len(split[n]) < max(2, width // 2) or len(above) == 3:
            break
        above.append(row)
    above.reverse()
    if not above:
        return [str(n + 1) for n in range(width)], [""] * width, 0
    units = [""] * width
    for n in range(len(above) - 1, 0, -1):
        texts = [unbracketed(text) for text in above[n]]
        filled_texts = [text for text in texts if text and text != "-"]
        if any(is_unit(text) for text in filled_texts) and not _is_header(texts, above[n - 1]):
            units = texts
            above = above[:n]
            break
    names: list[str] = []
    for n, name in enumerate(map(without_apostrophe, above[-1])):
        name = name or f"column {n + 1}"
        names.append(name if name not in names else f"{name} ({n + 1})")
    return names, units, len(above)


def _is_header(texts: Sequence[str], above: Sequence[str]) -> bool:
    """Whether single letters are names, ``t;A;v``, and no units, ``s;A;m/s``, of the line above.

    A letter is both. Units are units throughout, and each belongs to a name.
    """
    letters = [n for n, text in enumerate(texts) if text and text != "-"]
    if any(len(texts[n]) > 1 for n in letters):
        return False
    named = all(above[n] and not _NUMBER["."].fullmatch(above[n]) for n in letters)
    return not (named and all(texts[n] in _UNITS_OF_A_LETTER for n in letters))


def _assumed(dialect: CsvDialect, skipped: int, header_lines: int) -> list[str]:
    said = [
        f"{ROUTINE}delimiter {dialect.delimiter!r}, decimal sign {dialect.decimal!r}, "
        f"encoding {dialect.encoding}"
    ]
    if skipped:
        said.append(f"{skipped} lines before the header were skipped")
    if header_lines == 0:
        said.append("no header was found: columns are named 1, 2, 3 in their order")
    if any(dialect.units):
        said.append("the line below the header was read as units")
    return said
