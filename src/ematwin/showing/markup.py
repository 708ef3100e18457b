"""Short HTML for notebooks: a verdict first, then a table. Everything given is escaped."""

from collections.abc import Iterable, Sequence
from html import escape

# Colours that are read on a white page and on a black one.
_GRADES = {"healthy": "#00936e", "changed": "#c17f00", "fault": "#d55e00", "none": "#7d8590"}
_MOST_ROWS = 30


def result(
    title: str, header: Sequence[str], rows: Iterable[Sequence[object]], notes: Iterable[str] = (),
    *, grade: str = "", marked: Iterable[int] = (),
) -> str:  # fmt: skip
    """A heading, or a verdict if it has a ``grade``; a table, and notes below it."""
    head = verdict(title, grade) if grade else heading(title)
    return head + table(header, rows, marked) + "".join(map(note, notes))


def verdict(sentence: str, grade: str = "none") -> str:
    """A verdict, large, in the colour of its grade."""
    color = _GRADES.get(grade, _GRADES["none"])
    return (
        f'<div style="border-left:5px solid {color};padding:.2em .7em;margin:.3em 0;'
        f'font-size:1.15em;font-weight:600">{escape(sentence)}</div>'
    )


def heading(text: str) -> str:
    """A heading."""
    return f'<div style="font-weight:600;margin:.3em 0">{escape(text)}</div>'


def note(text: str) -> str:
    """A line of small print."""
    return f'<div style="opacity:.75;font-size:.9em">{escape(text)}</div>'


def table(
    header: Sequence[str], rows: Iterable[Sequence[object]], marked: Iterable[int] = ()
) -> str:
    """A table; rows whose numbers are ``marked`` are bold. Long ones are cut and say so."""
    every = [[str(cell) for cell in row] for row in rows]
    strong = set(marked)
    head = "".join(f'<th style="text-align:left">{escape(cell)}</th>' for cell in header)
    lines = []
    for n, row in enumerate(every[:_MOST_ROWS]):
        weight = "font-weight:700;" if n in strong else ""
        cells = (f'<td style="text-align:left;{weight}">{escape(cell)}</td>' for cell in row)
        lines.append(f"<tr>{''.join(cells)}</tr>")
    left = len(every) - _MOST_ROWS
    more = note(f"and {left} more rows; to_frame() has all") if left > 0 else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>{more}"
