"""How commands answer: tables, notes and bars for people, JSON for programs.

The library names its arguments, as ``gaps="longest"``; a user of the shell has ``--gaps longest``.
Errors and warnings pass through `for_shell` before they are printed. All that it needs to know
stands here and in the options of the command that runs.
"""

import json
import os
import re
import shutil
import signal
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from ematwin.report.page import Table
    from ematwin.showing.bars import Bar


def print_json(answer: Any) -> None:
    """An answer for a program, on standard output; paths are texts."""
    typer.echo(json.dumps(answer, indent=2, allow_nan=False, default=os.fspath))


def give(
    json: bool, plain: Callable[[], Any], tell: Callable[[], None],
    *files: Path | tuple[Path | None, Callable[[Path], Any]] | None, fails: bool = False,
) -> None:  # fmt: skip
    """Write files, then answer a program (`plain`) or people (`tell`, then what was written).

    ``files`` are paths, None for what was not asked for, each with the function that writes there;
    alone where it is written already. ``fails``: a grade of --fail-on was met, so that the exit
    code is 1.
    """
    written = []
    for path, write in (one if isinstance(one, tuple) else (one, None) for one in files):
        if path is not None:
            written.append(path)
            if write is not None:
                write(path)
    if json:
        print_json(plain())
    else:
        tell()
        for path in written:
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
    said = f"{what}, best {best}"
    return lambda done, value, count: show(done / count, f"{done}/{count} {said} {value:.4g}")


def serve_page(server: Any, what: str, no_browser: bool) -> None:
    """Show the page of a `LocalServer` until Ctrl-C; ``what`` is on it."""
    import webbrowser

    with server:
        typer.echo(f"{server.address}\n{what} is on this page. Ctrl-C ends it.")
        if not no_browser:
            webbrowser.open(server.address)
        signal.signal(signal.SIGINT, signal.default_int_handler)  # its end, no interruption
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("Ended.")


# Arguments whose options have another name.
_OTHERWISE = {"columns": "--column", "held": "--hold", "where": "--where"}
# Entries of a channel map that --column takes as well, beside the channels, and an example of each.
_ENTRIES = {"sample_rate": '"20 kHz"', "gear_ratio": "100", "phase_order": "acb"}
# Advice that has another form here.
_SINGLE = "Give a file with one motion; ematwin identify and ematwin detect take many."
SENTENCES = {
    "Read it with split=True, which gives a recording for each.": _SINGLE,
    "Narrow it to one, or read them with split=True, which gives a recording for each.": _SINGLE,
    "leave step and initial_position out": "leave --step out",
}

_VALUE = r"""\s?=\s?("[^"]*"|[\w.+-]*\w)"""


def for_shell(text: str, options: Mapping[str, str] | None = None) -> str:
    """Replace the names of arguments in a sentence of the library by names of options.

    ``options`` are options by the names of their arguments, ``{"map_file": "--map"}``; None takes
    those of the running command.
    """
    options = _called() if options is None else options
    there = set(options.values())
    for sentence, here in SENTENCES.items():
        text = text.replace(sentence, here)
    if "--gaps" not in there:
        text = text.partition(" Take the longest sound stretch")[0]
    if "--map" in there:
        text = re.sub(r"\bin the map\b", "in the file of --map", text)
    if "--column" in there:
        text = re.sub(r"\bsuch as (\w+=\")", r"such as --column \1", text)
        for entry, example in _ENTRIES.items():
            text = re.sub(rf"\bgive {entry}\b(?!\s?=)", f"give --column {entry}={example}", text)
    known = {name: option for name, option in _OTHERWISE.items() if option in there} | {**options}
    for name, option in known.items():
        # no part of a path, no name in quotes, and no channel of --column
        word = rf"(?<![\w.=/'\"-])(?<!--column ){re.escape(name)}"
        text = re.sub(rf"{word}{_VALUE}", partial(_as_option, option), text)
        # a name of several words is no English: it can only be the argument
        bare = word if "_" in name else rf"^{re.escape(name)}(?= must\b)"
        text = re.sub(rf"{bare}(?![\w='\"]|\.\w)", option, text)
    return text


def _as_option(option: str, assignment: re.Match[str]) -> str:
    """``--gaps longest``, without the quotes that the shell does not need."""
    inside = assignment[1].strip('"')
    plain = re.fullmatch(r"[\w.+-]+", inside) is not None
    return f"{option} {inside if plain else assignment[1]}"


def _called() -> dict[str, str]:
    """Options of the command that this process was called with."""
    from ematwin.cli.app import app

    commands: Any = typer.main.get_command(app)
    called = next((word for word in sys.argv[1:] if word in commands.commands), None)
    parameters = commands.commands[called].params if called else ()
    return {
        one.name: next(option for option in one.opts if option.startswith("--"))
        for one in parameters if any(option.startswith("--") for option in one.opts)
    }  # fmt: skip
