"""Blocks of README and docs that a reader could run, with what is said of them before they begin.

A comment directly before a block says how a test takes it; several stand one below the other:

    <!-- not run: hours -->             its options are checked, nothing is started
    <!-- run with: A => B; C => D -->   run with B in place of A, D in place of C: smaller
    <!-- file: axis.toml -->            what the reader is to save under this name
    <!-- part of: servo48 motor -->     belongs into a table of such a file

Commands may also stand indented by four spaces, without a prompt.
"""

import re
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).parents[1]
PAGES = [
    PROJECT / "README.md",
    PROJECT / "CONTRIBUTING.md",
    # the laboratory notebook keeps commands of earlier releases
    *(p for p in sorted((PROJECT / "docs").rglob("*.md")) if p.parent.name != "lab"),
    *sorted((PROJECT / "examples").rglob("*.md")),
]
# Notes that are no code: what a terminal shows, an import matrix.
PLAIN = {"text"}
_SAID = re.compile(r"<!-- (not run|run with|file|part of): (.+?) -->")
# Indented lines are commands if they begin with a program; others are formulas and answers.
_PROGRAMS = {"ematwin", "python", "pip", "dask", "sbatch", "export", "#!/bin/bash", "sudo",
             "apt-get", "docker", "podman", "git"}  # fmt: skip


@dataclass(frozen=True)
class Block:
    """A block of a page.

    Attributes
    ----------
    page : path from the project's folder
    line : of the page, where it begins
    language : as its fence says; "indented" without a fence
    text : its lines
    said : what the comments before it say, by their first words
    """

    page: str
    line: int
    language: str
    text: str
    said: dict[str, str]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def commands(self) -> list[tuple[str, list[str]]]:
        """Each command on one line, with the lines that it is shown to answer."""
        joined = re.sub(r"\\\n\s*", "", self.text)
        found: list[tuple[str, list[str]]] = []
        for line in joined.splitlines():
            if self.language != "console":
                found.append((line.strip(), []))
            elif line.startswith("$ "):
                found.append((line[2:].strip(), []))
            elif line.strip():
                found[-1][1].append(line)
        return [(command, shown) for command, shown in found if command]

    def smaller(self) -> str:
        """The text as it is run in a test."""
        text = self.text
        for change in filter(None, self.said.get("run with", "").split("; ")):
            given, taken = change.split(" => ")
            assert given in text, f"{self}: there is no {given!r} to replace"
            text = text.replace(given, taken)
        return text


def blocks_of(page: Path) -> list[Block]:
    """All blocks of a page in their order, but directives of Sphinx and cells of notebooks."""
    name = str(page.relative_to(PROJECT))
    lines = page.read_text(encoding="utf-8").splitlines()
    found: list[Block] = []
    said: dict[str, str] = {}
    n = 0
    while n < len(lines):
        line = lines[n]
        if fence := re.match(r"^(`{3,})(\S*)", line):
            start, n = n + 1, n + 1
            while not lines[n].startswith(fence[1]):
                n += 1
            body = "\n".join(lines[start:n]) + "\n"
            if not fence[2].startswith("{"):
                found.append(Block(name, start, fence[2], body, said))
            said = {}
        elif line.startswith("    ") and (n == 0 or not lines[n - 1].strip()):
            start = n
            while n < len(lines) and (lines[n].startswith("    ") or not lines[n].strip()):
                n += 1
            body = "\n".join(part[4:] for part in lines[start:n]).rstrip() + "\n"
            if _begins_with_a_program(body):
                found.append(Block(name, start + 1, "indented", body, said))
            said = {}
            continue
        elif told := _SAID.fullmatch(line.strip()):
            said = {**said, told[1]: told[2]}
        elif line.strip() and not line.startswith("<!--"):
            said = {}
        n += 1
    return found


def _begins_with_a_program(text: str) -> bool:
    first = text.split()[0]
    return first in _PROGRAMS or (first.islower() and shutil.which(first) is not None)


def words_of(command: str) -> list[str]:
    """A command as a shell splits it, without its comment."""
    return shlex.split(command, comments=True)
