"""Options that several commands share, and how their texts become values."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

from ematwin.errors import InputError


def pairs(texts: list[str], what: str) -> dict[str, str]:
    """``["friction=0.25"]`` as a mapping.

    Raises
    ------
    InputError
        If a text is not name=value, or a name comes twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise InputError(
                f"{what} needs name=value, received {text!r}. Write for example {what} "
                "friction=0.25."
            )
        if name.strip() in found:
            raise InputError(f"{what} gives {name.strip()} twice; give it once.")
        found[name.strip()] = value.strip()
    return found


def numbers(texts: list[str], what: str) -> dict[str, float]:
    """`pairs` with numbers as values."""
    values = {}
    for name, text in pairs(texts, what).items():
        try:
            values[name] = float(text)
        except ValueError:
            raise InputError(f"{what} {name} must be a number, received {text!r}.") from None
    return values


def print_json(answer: Any) -> None:
    """An answer for a program, on standard output."""
    typer.echo(json.dumps(answer, indent=2, allow_nan=False))


def print_table(table: Any, width: int) -> None:
    """A table of rich: a terminal wraps it to its own width, a file gets all of it."""
    from rich.console import Console

    console = Console()
    console.print(table) if console.is_terminal else Console(width=width).print(table)


@contextmanager
def progress_bar(title: str, shown: bool = True) -> Iterator[Callable[[float], None]]:
    """A bar on standard error; gives a function that takes the share done."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(
        console=console, transient=True, disable=not (shown and console.is_terminal)
    ) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)
