"""Results as tables of pandas, plain values for JSON, figures, and pages.

All is imported where it is asked for: no result depends on its figures, which stand above the
results (docs/architecture.md), and plotly and pandas load only where something is made.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, MissingExtraError
from ematwin.files import check_target, write_text


def frame(columns: Any, index: str | None = None) -> Any:
    """A pandas DataFrame of columns (N,) by name or of rows; a column may be its ``index``."""
    try:
        from pandas import DataFrame
    except ImportError:
        raise MissingExtraError("pandas", "pandas", "A table") from None
    made = DataFrame(columns)
    return made if index is None else made.set_index(index)


def frame_of_rows(rows: Iterable[Mapping[str, Any]], index: str | None = None) -> Any:
    """A pandas DataFrame of rows; values that a row does not have are missing."""
    return frame(list(rows), index)


def is_frame(value: Any) -> bool:
    """Whether something is a table of pandas, or of another library with that interface."""
    return hasattr(value, "columns") and hasattr(value, "to_numpy") and hasattr(value, "index")


def plain(value: Any) -> Any:
    """Values for JSON: None for NaN and infinity, text for keys, lists for arrays."""
    if isinstance(value, Mapping):
        return {
            " -> ".join(key) if isinstance(key, tuple) else str(key): plain(item)
            for key, item in value.items()
        }
    if hasattr(value, "model_dump"):  # of pydantic
        return value.model_dump(mode="json", exclude_none=True)
    if is_dataclass(value):
        return plain(vars(value))
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def drawn(result: Any, kind: str, functions: Mapping[str, str], *settings: Any) -> Any:
    """The figure ``kind`` of a result, drawn by one of the ``functions`` of `ematwin.plots`."""
    if kind not in functions:
        raise InputError(f"There is no figure {kind!r}; choose {' or '.join(functions)}.")
    return getattr(import_module("ematwin.plots"), functions[kind])(result, *settings)


def page_written(result: Any, path: str | Path, function: str) -> None:
    """Write the page of a result, by the ``function`` "module:name" of `ematwin.report`."""
    check_target(Path(path), (".html",))
    module, _, name = function.partition(":")
    write_text(path, getattr(import_module(f"ematwin.report.{module}"), name)(result))
