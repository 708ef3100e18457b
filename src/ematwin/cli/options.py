"""Options that several commands share, and how their texts become values."""

import json
import os
import shutil
import sys
from collections.abc import Callable, Collection, Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ematwin.cli import complete
from ematwin.cli.wording import for_shell
from ematwin.errors import InputError
from ematwin.files import check_target
from ematwin.quantities import use_units

if TYPE_CHECKING:
    from ematwin.report.page import Table
    from ematwin.showing.bars import Bar


def option(help: str, default: Any = None, *names: str, **more: Any) -> Any:
    """An option with a value; None where it is not given, or a ``default``."""
    return typer.Option(default, *names, help=help, **more)


def argument(help: str, default: Any = ..., **more: Any) -> Any:
    """An argument of a command; it has to be given unless it has a ``default``."""
    return typer.Argument(default, help=help, **more)


def flag(name: str, help: str) -> Any:
    """An option without a value."""
    return typer.Option(False, name, help=help)


ACTUATOR = option(
    "A shipped parameter set of any kind, a TOML file, or a calibrated actuator.",
    "servo48",
    autocompletion=complete.actuators,
)
SCENARIO = option(
    "A shipped scenario, or a TOML, CSV or Parquet file; the kind's default if not given.",
    autocompletion=complete.scenarios,
)
EXACT = flag("--exact", "Parameters are exactly those of the actuator: no tolerances count.")
WHERE = option("Use only recordings with this label: condition=normal. Repeatable.")
COLUMN = option('Which channel is what, e.g. i_a="Phase A [A]". Repeatable.')
MAP = option("The same in a TOML file (docs/recordings.md).", None, "--map")
NOISE = option("Sensor noise, e.g. white=0.02,bits=12.")
LOAD = option(
    'The constant load of a record that does not hold it, e.g. "10 N*m"; 0 if there was none.'
)
TABLE = option("Write all verdicts as a table (.csv or .parquet).")
REPORT = option("Write a self-contained page here (.html).")
FORCE = flag("--force", "Replace a file that exists, which you may have edited.")
RECORDED_ACTUATOR = option(
    "A shipped parameter set of any kind, a TOML file, or a calibrated actuator; if not "
    "given the default one of the kind that has such channels.",
    autocompletion=complete.actuators,
)
FAIL = option(
    "End with exit code 1 if a recording gets one of these grades: fault, changed, none; "
    "several with commas."
)
UNITS = option(
    'Show values in these units, e.g. "angle=mrad, torque=mN m"; ematwin units keeps '
    "them. Tables and JSON stay SI.",
    callback=use_units,  # without the option it takes those of the user's settings
)
JSON = flag("--json", "Answer as JSON.")
PORT = option("Port of the page on this machine; 0 takes a free one.", 0)
NO_BROWSER = flag("--no-browser", "Print the address and open nothing.")


def pairs(texts: list[str], what: str) -> dict[str, str]:
    """``["friction=0.25"]`` as a mapping; `InputError` if a name comes twice."""
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


def grades(text: str | None) -> set[str]:
    """The grades of ``--fail-on``; none where it is not given."""
    found = set() if text is None else {part.strip() for part in text.split(",")}
    if not found <= {"fault", "changed", "none", "healthy"}:
        raise InputError(f"--fail-on takes fault, changed and none, received {text!r}.")
    return found


def check_outputs(page: Path | None, *tables: Path | None) -> None:
    """Refuse a page or table that cannot be written, before any work is done."""
    if page is not None:
        check_target(page, (".html",))
    for table in filter(None, tables):
        check_target(table, (".csv", ".parquet"))


def print_json(answer: Any) -> None:
    """An answer for a program, on standard output; paths are texts."""
    typer.echo(json.dumps(answer, indent=2, allow_nan=False, default=os.fspath))


def answer(
    json: bool, plain: Callable[[], Any], tell: Callable[[], None], *written: Path | None,
    fails: bool = False,
) -> None:  # fmt: skip
    """Answer a program (`plain`) or people (`tell`, then the files that were ``written``).

    ``fails``: a grade of --fail-on was met, so that the exit code is 1.
    """
    if json:
        print_json(plain())
    else:
        tell()
        for path in filter(None, written):
            typer.echo(f"wrote {path}")
    if fails:
        raise typer.Exit(1)


def has_room() -> bool:
    """Whether the terminal has room for whole tables; a file has."""
    return not sys.stdout.isatty() or shutil.get_terminal_size().columns >= 110


def print_table(
    title: str, shown: "Table", *, whole: Collection[str] = (), width: int = 150
) -> None:
    """Print a table, but for columns that stay ``whole`` wrapped to a terminal; to a file all."""
    from rich.console import Console
    from rich.table import Table as Drawn

    # the name of a file or channel is no markup
    console = Console(markup=False, emoji=False)
    if not console.is_terminal:
        console.width = width
    table = Drawn(title=title or None, title_justify="left")
    for n, heading in enumerate(shown.header):
        table.add_column(
            heading,
            justify="left" if n == 0 or shown.is_text(n) else "right",
            no_wrap=heading in whole,
            overflow="ellipsis" if heading in whole else "fold",
        )
    for row in shown.rows:
        table.add_row(*row.cells, style="bold" if row.marked else None)
    console.print(table)


def print_notes(kind: str, notes: Iterable[str]) -> None:
    """Print notes on an answer, a line for each: ``Warning: ...``."""
    for note in notes:
        typer.echo(f"{kind}: {for_shell(note)}")


def progress_bar(title: str, shown: bool = True) -> "AbstractContextManager[Bar]":
    """A bar on standard error; gives a function that takes the share done, and words beside it."""
    from ematwin.showing.bars import in_terminal, no_bar

    return in_terminal(title) if shown else nullcontext(no_bar)


def searching(show: "Bar", what: str, best: str) -> Callable[[int, float, int], None]:
    """Show on a bar how many of ``what`` were tried and the ``best`` value so far."""
    return lambda done, value, count: show(
        done / count, f"{done}/{count} {what}, best {best} {value:.4g}"
    )


def serve_page(server: Any, what: str, no_browser: bool) -> None:
    """Show the page of a `LocalServer` until Ctrl-C; ``what`` is on it."""
    import webbrowser

    with server:
        typer.echo(f"{server.address}\n{what} is on this page. Ctrl-C ends it.")
        if not no_browser:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("Ended.")
