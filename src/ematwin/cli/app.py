"""The application: its commands, and how it ends.

Exit codes: 0 done; 1 a recording has a grade of --fail-on; 2 the input cannot be used (one sentence
on standard error); 130 interrupted.
"""

import errno
import os
import sys
from functools import partial
from typing import Any

import typer

from ematwin.cli.answers import for_shell
from ematwin.cli.diagnose import calibrate, detect, identify
from ematwin.cli.experiments import design, identifiability
from ematwin.cli.fleet import fleet, serve, watch
from ematwin.cli.lists import actuators, algorithms, channels, scenarios, units
from ematwin.cli.simulate import demo, explore, export_fmu, simulate
from ematwin.cli.study import compare, report, store

app = typer.Typer(
    name="ematwin",
    help="Find the faults of an electromechanical actuator from a recording of how it moved.",
    # plain help: rich takes the [mm] of a channel's name for markup and leaves it out
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
# what typer raises on a wrong option; it has no public name
_UsageError: Any = next(x for x in typer.BadParameter.__mro__ if x.__name__ == "ClickException")

for command in (
    compare, demo, identify, calibrate, detect, watch, serve, explore, identifiability, design,
    simulate, export_fmu, channels, actuators, scenarios, algorithms, units, report,
):  # fmt: skip
    # else the list of commands has 45 characters of it
    sentence = (command.__doc__ or "").split("\n\n")[0]
    app.command(command.__name__.replace("_", "-"), short_help=sentence)(command)
app.add_typer(fleet, name="fleet", short_help=fleet.info.help)
app.add_typer(store, name="store", short_help=store.info.help)


def _version(asked: bool) -> None:
    if asked:
        from ematwin import __version__

        typer.echo(f"ematwin {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and exit."
    ),
) -> None:
    """Find the faults of an electromechanical actuator from a recording of how it moved."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run() -> int:
    """Run the command that the process was called with; gives its exit code."""
    from ematwin import numerics
    from ematwin.errors import EmatwinError

    if sys.stderr.isatty():
        said = "Compiling the twin (first run only, up to half a minute) ..."
        numerics.compile_listener = partial(print, said, file=sys.stderr)
    try:
        answer = app(prog_name="ematwin", standalone_mode=False)
        sys.stdout.flush()
    except _UsageError as error:
        return _refused(_usage_sentence(error))
    except EmatwinError as error:
        return _refused(for_shell(str(error)))
    except MemoryError:
        return _refused("Not enough memory. Shorten the scenario or lower the sample rate.")
    except typer.Abort:
        return 130
    except BrokenPipeError:  # whoever read the answer has seen enough
        _drop_answer()
        return 0
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EIO, errno.EBADF):
            raise
        _drop_answer()
        return _refused(f"Cannot write the answer: {error.strerror}.")
    return answer if isinstance(answer, int) else 0


def _drop_answer() -> None:
    """Keep the interpreter from flushing into a standard output that takes no more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refused(sentence: str) -> int:
    print(f"Error: {sentence}", file=sys.stderr)
    return 2


def _usage_sentence(error: Any) -> str:
    """The error in the options, the text received, and where help is."""
    text = error.format_message().strip().rstrip(".")
    options = getattr(getattr(error, "param", None), "opts", ())
    for n, argument in enumerate(sys.argv):
        option, equals, received = argument.partition("=")
        received = received if equals else "".join(sys.argv[n + 1 : n + 2])
        if option in options and received and received not in text:
            text += f", received {received!r}"
            break
    context = getattr(error, "ctx", None)
    return f"{text}. See {context.command_path if context else 'ematwin'} --help."
