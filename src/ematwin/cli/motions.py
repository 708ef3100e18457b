"""Options of the commands that take motions: which files, channels and labels."""

from pathlib import Path
from typing import TYPE_CHECKING

from ematwin.cli.options import pairs
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.signals.motion import Motion


def load_motions(
    files: list[Path], column: list[str] | None, *choices: dict[str, list[str]]
) -> "list[Motion]":
    """Motions of files that fit one of the choices, with ``--column role="channel"``."""
    from ematwin.readers.motions import read_motions

    columns = {k: v.strip("\"'") for k, v in pairs(column or [], "--column").items()}
    return read_motions(files, columns, choices or None)


def choice(texts: list[str], what: str) -> dict[str, list[str]]:
    """``["run=1,2"]`` as ``{"run": ["1", "2"]}``."""
    return {
        name: [value.strip() for value in values.split(",") if value.strip()]
        for name, values in pairs(texts, what).items()
    }


def known_fault(text: str) -> tuple[str, dict[str, list[str]]]:
    """``"lubrication:condition=dry;run=1,2"`` as fault and choice."""
    fault, colon, rest = text.partition(":")
    if not (fault.strip() and colon and rest.strip()):
        raise InputError(
            f"--known needs fault:label=value, received {text!r}. Write for example "
            "--known lubrication:condition=dry."
        )
    return fault.strip(), choice([part for part in rest.split(";") if part.strip()], "--known")
