"""Every block of README and docs that a reader could run is run here, page by page.

A page runs in a folder of its own, from top to bottom, with what `page_files` takes for granted.
Commands answer what the page shows; where a block is run smaller than it is shown (`run with`), its
answer is not compared. A block that is marked `not run`, and every benchmark, is read by the parser
of its command, so that an option which does not exist fails. Any other block fails.
"""

import argparse
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable
from glob import glob
from itertools import dropwhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from ematwin.benchmarking.subject import cases_of
from ematwin.cli.app import app, run
from ematwin.fleet.fleet import settings_of
from ematwin.models.registry import actuator_in, load_actuator, model_of, shipped_actuators
from ematwin.recordings.channel import ChannelMap
from page_blocks import PAGES, PLAIN, PROJECT, Block, blocks_of, words_of
from page_files import GIVEN

# Blocks that another test runs, by page and language.
ELSEWHERE = {
    ("README.md", "sh"): ".ci/run",
    ("examples/own_model/README.md", "indented"): ".ci/run",
    ("docs/fleet.md", "sql"): "tests/fleet/test_machines.py",
}
BLOCKS = {str(page.relative_to(PROJECT)): blocks_of(page) for page in PAGES}
EXTRAS = tomllib.loads((PROJECT / "pyproject.toml").read_text("utf-8"))["project"]
GROUPS = {"ematwin.models", "ematwin.optimizers", "ematwin.readers"}


@pytest.mark.parametrize("name", [name for name, found in BLOCKS.items() if found])
def test_every_block_of_a_page_runs_or_is_read_by_its_parser(
    name, tmp_path, monkeypatch, capsys, registrations
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # a terminal wide enough for what a page shows
    names = GIVEN[name]() if name in GIVEN else {}
    shell = Shell(monkeypatch, capsys)
    for block in BLOCKS[name]:
        if block.language in PLAIN:
            continue
        if other := ELSEWHERE.get((block.page, block.language)):
            assert Path(name).name in (PROJECT / other).read_text("utf-8") or other == ".ci/run"
        elif "not run" in block.said:
            shell.check(block)
        else:
            if "run with" in block.said:
                shell.check(block)  # what is shown, beside what is run
            KINDS[block.language](block, names, shell)


class Shell:
    """Commands of a page, in this process where they are ematwin's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._patch = monkeypatch
        self._capsys = capsys

    def answer(self, block: Block, words: list[str]) -> str:
        """What a command prints.

        Raises
        ------
        AssertionError
            If it fails, or is none that a test may start.
        """
        if words[0] == "ematwin":
            files = [sorted(glob(word)) or [word] for word in words]
            self._patch.setattr(sys, "argv", [word for found in files for word in found])
            self._capsys.readouterr()
            code = run()
            printed = self._capsys.readouterr()
            assert code == 0, f"{block}: {shlex.join(words)}\n{printed.out}{printed.err}"
            return printed.out
        if words[0] == "python" and words[1].startswith("benchmarks/"):
            self.parse(block, words)  # minutes to hours
            return ""
        assert words[0] == "python", f"{block}: say why this is not run: {words}"
        script = PROJECT / words[1] if (PROJECT / words[1]).exists() else Path(words[1])
        done = subprocess.run(
            [sys.executable, script, *words[2:]], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{block}: {done.stderr}"
        return done.stdout

    def check(self, block: Block) -> None:
        """A block that is not run: its commands and options exist, its Python compiles."""
        if block.language == "python":
            compile(block.text, str(block), "exec")
        elif block.language == "toml":
            tomllib.loads(block.text)
        else:
            for command, _ in block.commands:
                for words in _each_of(words_of(command)):
                    self.parse(block, words)

    def parse(self, block: Block, words: list[str]) -> None:
        """Read a command as its program would, without starting it."""
        if words[0] == "ematwin":
            found: Any = typer.main.get_command(app)
            while hasattr(found, "commands"):
                words = words[1:]
                name = words[0] if words else ""
                assert name in found.commands, f"{block}: there is no command {name!r}"
                found = found.commands[name]
            try:
                found.make_context(words[0], list(words[1:]))
            except Exception as error:
                raise AssertionError(f"{block}: {shlex.join(words)}: {error}") from error
        elif words[:3] == ["python", "-m", "pytest"]:
            for word in words[3:]:
                assert not word.endswith(".py") or (PROJECT / word).exists(), f"{block}: {word}"
        elif words[0] == "python":
            if Path(words[1]).exists() and not (PROJECT / words[1]).exists():
                return  # a script that the page itself has written
            self._parse_script(block, PROJECT / words[1], words[2:])

    def _parse_script(self, block: Block, script: Path, options: list[str]) -> None:
        """Run a script of ours as far as its options."""
        assert script.exists(), f"{block}: there is no {script.relative_to(PROJECT)}"

        class ParsedError(Exception):
            """The options are sound."""

        def stopping(parse: Callable[..., Any]) -> Callable[..., Any]:
            def parsed(parser: argparse.ArgumentParser, *given: Any, **named: Any) -> Any:
                try:
                    parse(parser, *given, **named)
                except SystemExit:
                    said = self._capsys.readouterr().err
                    raise AssertionError(f"{block}: {said}") from None
                raise ParsedError

            return parsed

        before = set(sys.modules)
        with self._patch.context() as patch:
            for name in ("parse_args", "parse_intermixed_args"):
                parse = getattr(argparse.ArgumentParser, name)
                patch.setattr(argparse.ArgumentParser, name, stopping(parse))
            patch.setattr(sys, "argv", [str(script), *options])
            patch.syspath_prepend(script.parent)
            with pytest.raises(ParsedError):
                runpy.run_path(str(script), run_name="__main__")
        for name in set(sys.modules) - before:  # other scripts have modules of the same names
            if "." not in name and (script.parent / f"{name}.py").exists():
                del sys.modules[name]


def _each_of(words: list[str]) -> list[list[str]]:
    """Commands that a line joins, without the variables that are set for them."""
    found: list[list[str]] = [[]]
    for word in words:
        if word in ("&&", "||", "|", ";", "&"):
            found.append([])
        else:
            found[-1].append(word)
    without = [list(dropwhile(re.compile(r"[A-Z_]+=").match, one)) for one in found]
    return [one for one in without if one]


def _python(block: Block, names: dict[str, Any], shell: Shell) -> None:
    if "file" in block.said:
        Path(block.said["file"]).write_text(block.smaller(), encoding="utf-8")
    else:
        exec(compile(block.smaller(), str(block), "exec"), names)


def _commands(block: Block, names: dict[str, Any], shell: Shell) -> None:
    smaller = Block(block.page, block.line, block.language, block.smaller(), {})
    for command, shown in smaller.commands:
        for words in _each_of(words_of(command)):
            answer = " ".join(shell.answer(block, words).split())
        for line in [] if "run with" in block.said else shown:
            said = " ".join(line.split())
            assert said == "..." or _says(answer, said), f"{block}: {said!r} is not in: {answer}"


def _says(answer: str, said: str) -> bool:
    """Whether an answer has these words (... for any); numbers may be 2 % off, by rounding."""
    number = r"-?\d+(?:\.\d+)?"
    words = re.split(number, said)
    given = [float(text) for text in re.findall(number, said)]
    parts = (re.escape(text).replace(re.escape("..."), ".*?") for text in words)
    for found in re.finditer(f"({number})".join(parts), answer):
        if [float(text) for text in found.groups()] == pytest.approx(given, rel=0.02):
            return True
    return False


def _toml(block: Block, names: dict[str, Any], shell: Shell) -> None:
    """What a TOML file is can be told by what it holds."""
    table = tomllib.loads(block.text)
    if "part of" in block.said:
        shipped, *sections = block.said["part of"].split()
        whole = tomllib.loads(shipped_actuators()[shipped].read_text("utf-8"))
        part = table
        for section in reversed(sections):
            part = {section: part}
        for section, entries in part.items():
            assert set(entries) <= set(whole[section]), f"{block}: {section} has not all of these"
            whole[section] |= entries
        actuator_in(whole, str(block))
        return
    file = Path(block.said.get("file", f"line{block.line}.toml"))
    file.write_text(block.text, encoding="utf-8")
    if "project" in table:
        assert set(table["project"]["entry-points"]) <= GROUPS, f"{block}: no such group"
    elif "kind" in table:
        load_actuator(file)
    elif "duration" in table:
        model_of(load_actuator()).load_scenario(file).histories(np.linspace(0.0, 0.5, 11))
    elif "cases" in table:
        assert cases_of(str(file))
    elif "limits" in table:
        assert settings_of(table, file)
    elif "columns" in table:
        assert ChannelMap.of(file, model_of(load_actuator()).channels).columns
    else:
        raise AssertionError(f"{block}: say with a comment what this is part of")


KINDS: dict[str, Callable[[Block, dict[str, Any], Shell], None]] = {
    "python": _python,
    "console": _commands,
    "indented": _commands,
    "toml": _toml,
}


def test_every_language_is_known() -> None:
    """A fence of another kind would be skipped."""
    for found in BLOCKS.values():
        for block in found:
            known = block.language in PLAIN or block.language in KINDS
            assert known or (block.page, block.language) in ELSEWHERE, (
                f"{block}: nobody runs a block of {block.language or 'no language'}"
            )


def test_every_extra_that_a_page_installs_exists() -> None:
    for page in PAGES:
        for extras in re.findall(r"ematwin\[([\w,]+)\]", page.read_text(encoding="utf-8")):
            assert set(extras.split(",")) <= set(EXTRAS["optional-dependencies"]), page.name


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("ematwin compare --wrokers 2", "No such option: --wrokers"),
        ("ematwin comapre", "there is no command 'comapre'"),
        ("python benchmarks/identification.py --paper --sedes 3", "unrecognized arguments"),
        ("python benchmarks/peers simulators --quikc", "unrecognized arguments"),
        ("python benchmarks/nothing.py", "there is no benchmarks/nothing.py"),
    ],
)
def test_a_command_that_does_not_exist_is_found_without_running_it(
    command, said, monkeypatch, capsys
):
    block = Block("page.md", 1, "indented", f"{command}\n", {"not run": "hours"})
    with pytest.raises(AssertionError, match=said):
        Shell(monkeypatch, capsys).check(block)
