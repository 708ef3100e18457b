"""The application: its commands, and how it ends.

Exit codes: 0 done; 2 the input cannot be used (one sentence on standard error); 130 interrupted.
"""

import sys

import typer

from ematwin.cli import actuators, bench, simulate

app = typer.Typer(
    name="ematwin",
    help="Find the faults of an electromechanical actuator from a recording of how it moved.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("simulate")(simulate.simulate)
app.command("actuators")(actuators.actuators)
app.command("scenarios")(actuators.scenarios)
app.command("bench")(bench.bench)


def _version(asked: bool) -> None:
    if asked:
        from ematwin import __version__

        typer.echo(f"ematwin {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and end."
    ),
) -> None:
    """Find the faults of an electromechanical actuator from a recording of how it moved."""


def main() -> None:
    """Entry point of the command ``ematwin``."""
    from ematwin.errors import EmatwinError

    try:
        app()
    except EmatwinError as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("Interrupted; nothing was left half-written.", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
