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


def frame(columns: Mapping[str, Any], index: str | None = None) -> Any:
    """A pandas DataFrame of columns by name.

    Parameters
    ----------
    columns : name to (N,) values
    index : name of the column that labels the rows

    Raises
    ------
    MissingExtraError
        If pandas is not installed; the message names the command that installs it.
    """
    made = _pandas().DataFrame(dict(columns))
    return made if index is None else made.set_index(index)


def frame_of_rows(rows: Iterable[Mapping[str, Any]], index: str | None = None) -> Any:
    """A pandas DataFrame of rows; values that a row does not have are missing."""
    made = _pandas().DataFrame(list(rows))
    return made if index is None else made.set_index(index)


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


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        raise MissingExtraError("pandas", "pandas", "A table") from None
    return pandas


def drawn(result: Any, kind: str, functions: Mapping[str, str], *settings: Any) -> Any:
    """The figure of a result.

    Raises `InputError` if there is no such figure.

    Parameters
    ----------
    result : to be drawn
    kind : which of its figures
    functions : kind to the name of a function of `ematwin.plots`
    settings : further arguments of the function
    """
    if kind not in functions:
        raise InputError(f"There is no figure {kind!r}; choose {' or '.join(functions)}.")
    return getattr(import_module("ematwin.plots"), functions[kind])(result, *settings)


def page_written(result: Any, path: str | Path, function: str) -> None:
    """Write the page of a result; ``function`` of `ematwin.report`, by name, as "module:name"."""
    import_module("ematwin.report.page").write_page(result, path, function)
