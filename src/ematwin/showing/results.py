"""Results as tables of pandas, plain values for JSON, figures, pages, and in notebooks.

All is imported where it is asked for: no result depends on its figures, which stand above the
results (docs/architecture.md), and plotly and pandas load only where something is made.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, MissingExtraError
from ematwin.files import check_target, write_text


def frame(columns: Any, index: str | None = None) -> Any:
    """A pandas DataFrame of columns (N,) by name, or of rows; a column may be its ``index``.

    Values that a row does not have are missing.
    """
    try:
        from pandas import DataFrame
    except ImportError:
        raise MissingExtraError("pandas", "pandas", "A table") from None
    made = DataFrame(columns)
    return made if index is None else made.set_index(index)


def is_frame(value: Any) -> bool:
    """Whether something is a table of pandas, or of another library with that interface."""
    return hasattr(value, "columns") and hasattr(value, "to_numpy") and hasattr(value, "index")


def plain(value: Any) -> Any:
    """Values for JSON: None for NaN and infinity, text for keys, lists for arrays."""
    if isinstance(value, float):  # first: traces are long
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        keys = (" -> ".join(key) if isinstance(key, tuple) else str(key) for key in value)
        return dict(zip(keys, map(plain, value.values()), strict=True))
    if hasattr(value, "model_dump"):  # of pydantic
        return value.model_dump(mode="json", exclude_none=True)
    if is_dataclass(value):
        return plain(vars(value))
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def drawn(result: Any, kind: str, functions: Mapping[str, str], *settings: Any) -> Any:
    """The figure ``kind`` of a result, drawn by one of the ``functions`` of `ematwin.plots`."""
    if kind not in functions:
        raise InputError(f"There is no figure {kind!r}; choose {' or '.join(functions)}.")
    return getattr(import_module("ematwin.plots"), functions[kind])(result, *settings)


def page_written(result: Any, path: str | Path, function: str) -> None:
    """Write the page of a result, by the ``function`` "module:name" of this package."""
    check_target(Path(path), (".html",))
    module, _, name = function.partition(":")
    write_text(path, getattr(import_module(f"ematwin.{module}"), name)(result))


# Colours that are read on a white page and on a black one.
_GRADES = {"healthy": "#00936e", "changed": "#c17f00", "fault": "#d55e00", "none": "#7d8590"}
_MOST_ROWS = 30


def html(
    title: str = "", header: Sequence[str] = (), rows: Iterable[Sequence[object]] = (),
    notes: Iterable[str] = (), *, grade: str = "", marked: Iterable[int] = (),
) -> str:  # fmt: skip
    """A result in a notebook: a heading, or a verdict if it has a ``grade``; a table; small print.

    Everything given is escaped. Rows whose numbers are ``marked`` are bold; long tables are cut and
    say so.
    """
    style = "font-weight:600;margin:.3em 0"
    if grade:
        style += f";border-left:5px solid {_GRADES[grade]};padding:.2em .7em;font-size:1.15em"
    parts = [f'<div style="{style}">{escape(title)}</div>'] if title else []
    every, strong, small = list(rows), set(marked), list(notes)
    if header:
        head = "".join(f'<th style="text-align:left">{escape(cell)}</th>' for cell in header)
        lines = []
        for n, row in enumerate(every[:_MOST_ROWS]):
            weight = "font-weight:700;" if n in strong else ""
            cells = (f'<td style="text-align:left;{weight}">{escape(str(x))}</td>' for x in row)
            lines.append(f"<tr>{''.join(cells)}</tr>")
        body = "".join(lines)
        parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
    if (left := len(every) - _MOST_ROWS) > 0:
        small.insert(0, f"and {left} more rows; to_frame() has all")
    parts += [f'<div style="opacity:.75;font-size:.9em">{escape(text)}</div>' for text in small]
    return "".join(parts)
