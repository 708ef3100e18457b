"""Help texts keep every character; the shell completes commands, options and names."""

import inspect
import re
import typing

import pytest

from commands import inside, loaded
from ematwin.cli import main
from ematwin.cli.app import app
from own_model import installed, on_path

COMMANDS = [info.name for info in app.registered_commands]
GROUPS = [info.name for info in app.registered_groups]


def texts(function) -> list[str]:
    """The sentence of a command and the help of its options, as they were written."""
    hints = typing.get_type_hints(function, include_extras=True)
    found = [inspect.getdoc(function).splitlines()[0]]
    for name, one in inspect.signature(function).parameters.items():
        options = (*getattr(hints[name], "__metadata__", ()), one.default)
        found += [option.help for option in options if getattr(option, "help", None)]
    return found


def words(text: str) -> str:
    """Without the line breaks and columns of a help page, which part words at hyphens too."""
    return re.sub(r"\s+", "", text)


@pytest.mark.parametrize("command", app.registered_commands, ids=COMMANDS)
def test_help_shows_every_character_of_every_text(ematwin, command):
    answer = ematwin(command.name, "--help", COLUMNS="200")
    assert (answer.code, answer.err) == (0, "")
    shown = words(answer.out)
    assert [text for text in texts(command.callback) if words(text) not in shown] == []


def completed(*line: str) -> list[str]:
    """What bash is offered for the last word of a command line."""
    asked = {
        "_EMATWIN_COMPLETE": "complete_bash",
        "COMP_WORDS": " ".join(("ematwin", *line)),
        "COMP_CWORD": str(len(line)),
    }
    done = inside(main, "ematwin", **asked)
    assert (done.code, done.err) == (0, "")
    return done.out.split()


def test_bash_completes_the_names_of_commands():
    assert sorted(completed("")) == sorted(COMMANDS + GROUPS)
    assert completed("ca") == ["calibrate"]
    assert completed("zzz") == []


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        (("identify", "--actuator", ""), {"servo48", "rm1605"}),
        (("simulate", "--actuator", "se"), {"servo48"}),
        (("calibrate", "--actuator", "rm"), {"rm1605"}),
        (("compare", "--actuator", "se"), {"servo48"}),
        (("actuators", "rm"), {"rm1605"}),
        (("simulate", "--scenario", "ra"), {"ramp"}),
        (("compare", "--scenario", "ra"), {"ramp"}),
        (
            ("identify", "--algorithm", "pso-"),
            {"pso-1995", "pso-global", "pso-inertia", "pso-plain", "pso-ring", "pso-tuned"},
        ),
        (("compare", "--algorithms", "ga,pso-r"), {"ga,pso-ring"}),
        (("compare", "--algorithms", "cma,imp"), {"cma,improved"}),
    ],
    ids=lambda value: " ".join(sorted(value) if isinstance(value, set) else value),
)
def test_bash_completes_names(line, offered):
    assert offered <= set(completed(*line))
    assert all(name.startswith(line[-1]) for name in completed(*line))


def test_a_broken_package_does_not_disturb_the_prompt(tmp_path):
    installed(tmp_path, "broken", models="broken = no_such_module:MODEL")
    with on_path(tmp_path):
        assert "servo48" in completed("simulate", "--actuator", "")


def test_completing_loads_nothing_heavy():
    """The prompt waits for it."""
    heavy = {"numba", "numpy", "scipy", "pyarrow", "plotly"}
    asked = {"COMP_WORDS": "ematwin identify --a", "COMP_CWORD": "2"}
    done = loaded(heavy, _EMATWIN_COMPLETE="complete_bash", **asked)
    assert done.out.splitlines() == ["--actuator", "--algorithm"]
    assert done.err.strip() == ""
