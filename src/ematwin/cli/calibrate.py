"""``ematwin calibrate``: healthy recordings in, a calibrated actuator out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli.motions import choice, known_fault, load_motions
from ematwin.cli.options import print_json, progress_bar

if TYPE_CHECKING:
    from ematwin.monitoring.calibrate import CalibrationReport


def calibrate(
    records: Annotated[
        list[Path], typer.Argument(help="Files with healthy motions of at least three runs.")
    ],
    out: Annotated[Path, typer.Option(help="Where to write the calibrated actuator (.toml).")],
    actuator: Annotated[
        str, typer.Option(help="Template: a shipped ball-screw set, or a TOML file.")
    ] = "rm1605",
    where: Annotated[
        list[str] | None,
        typer.Option(help="Take only motions with these labels: condition=normal. Repeatable."),
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(
            help="Motions of the same files with a known fault, to name it by: "
            '"lubrication:condition=dry;run=1,2". Repeatable.'
        ),
    ] = None,
    hold_back: Annotated[
        int | None,
        typer.Option(help="Runs, the last ones, that only set the threshold (2 of 5 or more)."),
    ] = None,
    false_alarms: Annotated[
        float, typer.Option(help="Share of healthy motions of another day that may raise an alarm.")
    ] = 0.1,
    column: Annotated[
        list[str] | None,
        typer.Option(help='Which channel is what: set_point="Demand [mm]". Repeatable.'),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Learn from healthy recordings how an actuator behaves and how far healthy runs differ."""
    from ematwin.monitoring.calibrate import calibrate as run
    from ematwin.monitoring.calibrate import sources_of
    from ematwin.plant.ball_screw import BallScrew
    from ematwin.readers.files import check_target
    from ematwin.readers.motions import fitting

    check_target(out, (".toml",))
    template = BallScrew.load(actuator)
    wanted = choice(where or [], "--where")
    taught = [(text, *known_fault(text)) for text in known or []]
    motions = load_motions(records, column, wanted, *(labels for _, _, labels in taught))
    faults = {
        f"{fault}: {text.partition(':')[2]}": fitting(motions, labels)
        for text, fault, labels in taught
    }
    with progress_bar("Calibrating", not json) as progress:
        report = run(
            fitting(motions, wanted),
            template,
            held_back=hold_back,
            false_alarm_rate=false_alarms,
            known=faults,
            name=out.stem,
            progress=progress,
        )
    report.calibration.save(out, sources_of(report))
    if json:
        print_json({**report.as_dict(), "out": str(out)})
        return
    print_calibration(report)
    typer.echo(f"wrote {out}")


def print_calibration(report: "CalibrationReport") -> None:
    """Fitted parameters, spread between runs, and the self-check, for people."""
    from rich.console import Console
    from rich.table import Table

    units = {place: unit for place, _, unit, _, _ in report.calibration.actuator.parameters()}
    table = Table(title="Parameters", title_justify="left")
    for heading in ("parameter", "value", "standard error", "template", ""):
        table.add_column(heading, justify="left" if heading in {"parameter", ""} else "right")
    for p in report.parameters:
        unit = units[p.place]
        table.add_row(
            p.place,
            f"{p.value:.4g} {unit}".rstrip(),
            f"{p.standard_error:.2g}",
            f"{p.template:.4g}",
            "" if p.determined else "not determined",
        )
    Console(width=110).print(table)
    missing = [p.place for p in report.parameters if not p.determined]
    if missing:
        typer.echo(
            f"These recordings do not determine {', '.join(missing)}: the template's values hold "
            "them. Absolute forces hang on the template's supply voltage and lead as well."
        )
    for name, (within, between) in report.run_spread.items():
        unit = "mm" if name == "backlash" else "%"
        scale = 1e3 if name == "backlash" else 100.0
        typer.echo(
            f"{name:<10} scatters by {within * scale:.3g} {unit} within a run and "
            f"{between * scale:.3g} {unit} between runs"
        )
    facts = report.calibration.facts
    typer.echo(f"taken for healthy: {facts['motions']} motions with {facts['labels']}")
    limits = report.calibration.thresholds
    typer.echo(
        f"learnt from runs {', '.join(report.learnt)}; held back {', '.join(report.held_back)}: "
        f"{100.0 * report.false_alarms:.0f} % of their motions above the threshold "
        f"({limits.motion:.2f} for a motion, {limits.run:.2f} for a run of {limits.run_size:.3g})"
    )
    for note in report.notes:
        typer.echo(f"Warning: {note}")
    for signature in report.calibration.signatures:
        typer.echo(f"known fault: {signature.fault}, from {signature.source}")
