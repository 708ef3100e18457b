"""Results as tables of pandas, imported where a table is made, and as plain values for JSON."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from typing import Any

from ematwin.errors import MissingExtraError


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
