"""Results that draw themselves, and write their page: a function of `ematwin.plots`, by its name.

The import is by name and at the call, so that no result depends on the figures of it: they stand
above the results (docs/architecture.md), and plotly loads only where something is drawn.
"""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from ematwin.errors import InputError


def drawn(result: Any, kind: str, functions: Mapping[str, str], *settings: Any) -> Any:
    """The figure of a result.

    Parameters
    ----------
    result : to be drawn
    kind : which of its figures
    functions : kind to the name of a function of `ematwin.plots`
    settings : further arguments of the function

    Raises
    ------
    InputError
        If there is no such figure.
    """
    if kind not in functions:
        raise InputError(f"There is no figure {kind!r}; choose {' or '.join(functions)}.")
    return getattr(import_module("ematwin.plots"), functions[kind])(result, *settings)


def page_written(result: Any, path: str | Path, function: str) -> None:
    """Write the page of a result; ``function`` of `ematwin.report`, by name, as "module:name"."""
    import_module("ematwin.report.page").write_page(result, path, function)
