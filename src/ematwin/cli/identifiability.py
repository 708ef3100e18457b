"""``ematwin identifiability``: which faults a command can reveal, before any test."""

from pathlib import Path

import typer

import ematwin
from ematwin.cli import complete, options
from ematwin.cli.options import argument, flag, option
from ematwin.files import write_text


def identifiability(
    commands: list[str] | None = argument(
        "Scenarios: shipped ones by name, TOML files, or recordings (.csv, .parquet) of "
        "which the command is taken. The kind's default if none is given.",
        None,
        autocompletion=complete.scenarios,
    ),
    actuator: str = options.ACTUATOR,
    fault: list[str] | None = option(
        "A fault at which to look, e.g. friction=0.25; each is just a fault if not given. "
        "Repeatable."
    ),
    noise: str | None = options.NOISE,
    exact: bool = options.EXACT,
    false_alarm: float | None = option(
        "Probability that a healthy value is taken for a fault; 0.00135 (3 sigma)."
    ),
    miss: float | None = option("Probability that the smallest fault is overlooked; 0.1."),
    sobol: bool = flag(
        "--sobol", "Also say how much of the answer's variance goes back to each unknown."
    ),
    report: Path | None = options.REPORT,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Say which faults a command can reveal, and the smallest that it would.

    Several commands are compared, the most telling first.
    """
    from ematwin.experiments.identifiability import FALSE_ALARM, MISS, ranked

    options.check_outputs(report)
    values = options.numbers(fault or [], "--fault")
    given: list[str | None] = [*commands] if commands else [None]
    found = ranked([
        ematwin.identifiability(
            command, actuator, faults=values, noise=ematwin.Noise.of(noise), exact=exact,
            false_alarm=FALSE_ALARM if false_alarm is None else false_alarm,
            miss=MISS if miss is None else miss,
        )
        for command in given
    ])  # fmt: skip
    parts = {}
    if sobol:
        for one in found:
            with options.progress_bar(f"Varying all of {one.scenario.name}", not json) as progress:
                parts[one.scenario.name] = ematwin.sensitivity(
                    one.scenario, actuator, exact=exact, progress=progress
                )
    if report is not None:
        from ematwin.report.experiments import identifiability_page

        write_text(report, identifiability_page(found, parts))

    def tell() -> None:
        for one in found:
            _print(one)
            if parts:
                _print_sobol(parts[one.scenario.name])
        if len(found) > 1:
            names = ", ".join(f"{one.scenario.name} ({one.weakest.name})" for one in found)
            typer.echo(f"Best command first, with its least identifiable fault: {names}")

    def plain() -> dict[str, object]:
        told = [
            one.as_dict() | ({"sobol": parts[one.scenario.name].as_dict()} if parts else {})
            for one in found
        ]
        return {"commands": told, "report": report}

    options.answer(json, plain, tell, report)


def _print(found: "ematwin.Identifiability") -> None:
    from ematwin.report.experiments import told_table

    title = f"{found.scenario.name}, {found.scenario.duration:g} s, on {found.actuator.name}"
    options.print_table(title, told_table(found))
    typer.echo(
        f"Noise and the twin's own error {100.0 * found.noise:.2f} % of the answer; found: all but "
        f"{100.0 * found.miss:.3g} %, false alarms {100.0 * found.false_alarm:.2g} %."
    )
    options.print_notes("No verdict", found.obstacles)
    typer.echo("")


def _print_sobol(parts: "ematwin.Sensitivity") -> None:
    from ematwin.report.experiments import sobol_table

    for channel, caption in parts.captions.items():
        options.print_table(f"Sobol indices: {caption}", sobol_table(parts, channel))
    typer.echo(f"From {parts.answers} answers; indices below 1 % are left out.\n")
