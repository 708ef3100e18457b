"""Messages of the library in the words of the shell.

The library names its arguments, as ``gaps="longest"``; a user of the shell has ``--gaps longest``.
Errors and warnings pass through `for_shell` before they are printed. All that it needs to know
stands in this file and in the options of the command that runs.
"""

import re
import sys
from collections.abc import Mapping
from functools import partial
from typing import Any

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
    if "--map" in there:
        text = re.sub(r"\bin the map\b", "in the file of --map", text)
    if "--column" in there:
        text = re.sub(r"\bsuch as (\w+=\")", r"such as --column \1", text)
        for entry, example in _ENTRIES.items():
            text = re.sub(rf"\bgive {entry}\b(?!\s?=)", f"give --column {entry}={example}", text)
    known = {name: option for name, option in _OTHERWISE.items() if option in there} | {**options}
    for name, option in known.items():
        word = rf"(?<![\w.=/'\"-]){re.escape(name)}"  # no part of a path, nor a name in quotes
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
    import typer

    from ematwin.cli.app import app

    commands: Any = typer.main.get_command(app)
    called = next((word for word in sys.argv[1:] if word in commands.commands), None)
    found = {}
    for parameter in commands.commands[called].params if called else ():
        long = [option for option in parameter.opts if option.startswith("--")]
        if long:
            found[parameter.name] = long[0]
    return found
