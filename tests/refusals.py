"""How bad input is refused: one sentence, and nothing is written."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from commands import Answer, inside
from ematwin.cli import main
from ematwin.errors import EmatwinError


def refusal_of(call: Callable[[], object], kind: type[EmatwinError] = EmatwinError) -> str:
    """The sentence with which Python is refused."""
    with pytest.raises(kind) as caught:
        call()
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    assert not text.endswith("..")
    return text


def refused(answer: Answer, said: str) -> None:
    """A command that ended with exit code 2 and one sentence with a text or pattern.

    A sentence may close with the command that would help.
    """
    assert answer.code == 2, answer.out + answer.err
    assert answer.out == ""
    assert re.fullmatch(r"Error: [^\n]*([.?]|: ematwin [^\n]+)\n", answer.err), answer.err
    assert said in answer.err or re.search(said, answer.err), answer.err


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file of a folder, hidden ones included."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def untouched(folder: Path, *words: object, said: str) -> None:
    """A command in a folder is refused, and leaves it as it was."""
    before = contents(folder)
    refused(inside(main, "ematwin", *words, folder=folder), said)
    assert contents(folder) == before
