"""Options that several commands share, and how their texts become values."""

import json
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from ematwin.cli import complete
from ematwin.cli.wording import for_shell
from ematwin.errors import InputError

# Options that several commands have.
ActuatorOption = Annotated[
    str,
    typer.Option(
        help="A shipped parameter set of any kind, a TOML file, or a calibrated actuator.",
        autocompletion=complete.actuators,
    ),
]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(help='Which channel is what, e.g. i_a="Phase A [A]". Repeatable.'),
]
MapOption = Annotated[
    Path | None, typer.Option("--map", help="The same in a TOML file (docs/recordings.md).")
]
NoiseOption = Annotated[str | None, typer.Option(help="Sensor noise, e.g. white=0.02,bits=12.")]
LoadOption = Annotated[
    str | None,
    typer.Option(
        help='The constant load of a record that does not hold it, e.g. "10 N*m"; 0 if there '
        "was none."
    ),
]
TableOption = Annotated[
    Path | None, typer.Option(help="Write all verdicts as a table (.csv or .parquet).")
]
ReportOption = Annotated[
    Path | None, typer.Option(help="Write a self-contained page here (.html).")
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Replace a file that exists, which you may have edited.")
]
RecordedActuatorOption = Annotated[
    str | None,
    typer.Option(
        "--actuator",
        help="A shipped parameter set of any kind, a TOML file, or a calibrated actuator; if not "
        "given the default one of the kind that has such channels.",
        autocompletion=complete.actuators,
    ),
]
FailOption = Annotated[
    str | None,
    typer.Option(
        help="End with exit code 1 if a recording gets one of these grades: fault, changed, none; "
        "several with commas."
    ),
]


def _use_units(text: str | None) -> str | None:
    from ematwin.quantities import use_units

    use_units(text)  # without the option those of the user's settings
    return text


UnitsOption = Annotated[
    str | None,
    typer.Option(
        "--units",
        callback=_use_units,
        help='Show values in these units, e.g. "angle=mrad, torque=mN m"; ematwin units keeps '
        "them. Tables and JSON stay SI.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Answer as JSON.")]
PortOption = Annotated[
    int, typer.Option(help="Port of the page on this machine; 0 takes a free one.")
]
NoBrowserOption = Annotated[
    bool, typer.Option("--no-browser", help="Print the address and open nothing.")
]

_FILE = 200  # columns where the answer goes to a file


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


def grades(text: str | None) -> set[str]:
    """The grades of ``--fail-on``; none where it is not given."""
    found = set() if text is None else {part.strip() for part in text.split(",")}
    if not found <= {"fault", "changed", "none", "healthy"}:
        raise InputError(f"--fail-on takes fault, changed and none, received {text!r}.")
    return found


def print_json(answer: Any) -> None:
    """An answer for a program, on standard output."""
    typer.echo(json.dumps(answer, indent=2, allow_nan=False))


def terminal_width() -> int:
    """Columns of the terminal; a file has room for whole tables."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else _FILE


def print_table(table: Any, width: int) -> None:
    """A table of rich: a terminal wraps it to its own width, a file gets all of it."""
    from rich.console import Console

    # the name of a file or channel is no markup
    console = Console(markup=False, emoji=False)
    if not console.is_terminal:
        console.width = width
    console.print(table)


def print_notes(kind: str, notes: Iterable[str]) -> None:
    """What there is to say of an answer, each on a line of its own: ``Warning: ...``."""
    for note in notes:
        typer.echo(f"{kind}: {for_shell(note)}")


@contextmanager
def progress_bar(title: str, shown: bool = True) -> Iterator[Callable[[float], None]]:
    """A bar on standard error; gives a function that takes the share done."""
    if not (shown and sys.stderr.isatty()):
        yield lambda share: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape(title), total=1.0)  # the name of a file is no markup
        yield lambda share: bar.update(task, completed=share)


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
