"""``ematwin calibrate``: healthy recordings in, a calibrated actuator out."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli import complete
from ematwin.cli.options import (
    ForceOption,
    JsonOption,
    MapOption,
    print_json,
    print_notes,
    print_table,
    progress_bar,
)
from ematwin.cli.recordings import choice, known_fault, load, remarks

if TYPE_CHECKING:
    from ematwin.monitoring.calibrate import CalibrationReport
    from ematwin.monitoring.calibration import PopulationCalibration


def calibrate(
    records: Annotated[
        list[Path],
        typer.Argument(
            help="Files with healthy recordings, or folders of them: one for the twin, three runs "
            "for a healthy population as well."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Where to write the calibrated actuator (.toml).")],
    actuator: Annotated[
        str,
        typer.Option(
            help="Template: a shipped set of any kind, or a TOML file.",
            autocompletion=complete.actuators,
        ),
    ] = "rm1605",
    where: Annotated[
        list[str] | None,
        typer.Option(help="Use only recordings with this label: condition=normal. Repeatable."),
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(
            help="Recordings of a known fault in the same files, to name later alarms by, e.g. "
            '"lubrication:condition=dry;run=1,2". Repeatable.'
        ),
    ] = None,
    hold_back: Annotated[
        int | None,
        typer.Option(
            help="How many of the last runs only set the threshold; else all runs learn and set it."
        ),
    ] = None,
    false_alarms: Annotated[
        float | None,
        typer.Option(
            help="Share of healthy recordings on another day that may raise an alarm, of a healthy "
            "population; 0.1 if not given."
        ),
    ] = None,
    add: Annotated[
        Path | None,
        typer.Option(
            help="Calibrated actuator (.toml) whose healthy runs these join, such as runs of a "
            "later occasion; one run is enough. Actuator and known faults stay as in it."
        ),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(help='Which channel is what, e.g. set_point="Demand [mm]". Repeatable.'),
    ] = None,
    map_file: MapOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Learn from healthy recordings how an actuator behaves and how far healthy runs differ."""
    from ematwin.files import check_target
    from ematwin.models.registry import load_actuator
    from ematwin.monitoring.calibrate import calibrate as run
    from ematwin.monitoring.calibration import Calibration, is_as_written
    from ematwin.recordings.motions import fitting

    check_target(out, (".toml",), replace=force or is_as_written(out))
    before = None if add is None else Calibration.load(add)
    template = load_actuator(actuator) if before is None else before.actuator
    wanted = choice(where or [], "--where")
    taught = [(text, *known_fault(text)) for text in known or []]
    recordings = load(
        records, column, map_file, template, wanted, *(labels for _, _, labels in taught)
    )
    faults = {
        f"{fault}: {text.partition(':')[2]}": fitting(recordings, labels)
        for text, fault, labels in taught
    }
    with progress_bar("Calibrating", not json) as progress:
        report = run(
            fitting(recordings, wanted),
            template,
            held_back=hold_back,
            false_alarm_rate=false_alarms,
            known=faults or None,
            name=out.stem,
            progress=progress,
            add_to=before,
        )
    report.save(out)
    assumed, doubtful = remarks(recordings)
    if json:
        print_json({**report.as_dict(), "out": str(out), "assumed": assumed, "warnings": doubtful})
        return
    print_calibration(report)
    print_notes("Assumed", assumed)
    print_notes("Warning", doubtful)
    typer.echo(f"wrote {out}")


def print_calibration(report: "CalibrationReport") -> None:
    """Fitted parameters, spread between runs, and the self-check, for people."""
    from rich.table import Table

    from ematwin.monitoring.calibration import PopulationCalibration

    actuator = report.actuator
    units = {place: unit for place, _, unit, _, _ in actuator.parameters()}
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
    if report.parameters:
        print_table(table, 110)
    missing = [p.place for p in report.parameters if not p.determined]
    if missing:
        typer.echo(
            f"These recordings do not determine {', '.join(missing)}: they stay within the "
            "tolerances of the template."
        )
    for group in report.tied:
        typer.echo(
            f"Only ratios or products of {', '.join(group)} are known; a common factor stays "
            "uncertain."
        )
    fitted = {p.place for p in report.parameters}
    fixed = [place for place in units if place not in fitted]
    if report.parameters:
        typer.echo(f"Not fitted, as in the template: {', '.join(fixed)}.")
    baseline = report.baseline
    if math.isfinite(baseline.misfit):
        floor = (
            f" (noise and known errors of the twin: {100.0 * baseline.expected_misfit:.2f} %)"
            if math.isfinite(baseline.expected_misfit)
            else ""
        )
        typer.echo(
            f"The twin leaves {100.0 * baseline.misfit:.2f} % of healthy recordings "
            f"unexplained{floor}."
        )
    if isinstance(report.calibration, PopulationCalibration):
        _print_population(report, report.calibration)
    elif baseline.scatter:
        said = ", ".join(f"{name} {value:.2g}" for name, value in baseline.scatter.items())
        typer.echo(f"Healthy recordings are found off healthy by (one standard deviation): {said}.")
    print_notes("Warning", report.notes)


def _print_population(report: "CalibrationReport", calibration: "PopulationCalibration") -> None:
    """Spread between runs, thresholds, and known faults."""
    for one in calibration.model.reported(calibration.actuator):
        within, between = report.run_spread[one.name]
        unit, scale = ("%", 100.0) if one.logarithmic else (one.unit, one.scale)
        typer.echo(
            f"{one.name:<10} scatters by {f'{within * scale:.3g} {unit}'.rstrip()} within a run "
            f"and {f'{between * scale:.3g} {unit}'.rstrip()} between runs"
        )
    facts = calibration.facts
    said = "" if facts["labels"] == "none" else f" with {facts['labels']}"
    typer.echo(f"healthy reference: {facts['motions']} recordings{said}")
    limits = calibration.thresholds
    back = ", ".join(report.held_back)
    judged = f"held back {back}" if back else "each judged by the others"
    typer.echo(
        f"learnt from runs {', '.join(report.learnt)}; {judged}: "
        f"{100.0 * report.false_alarms:.0f} % of their recordings above the threshold "
        f"({limits.motion:.2f} for a motion, {limits.run:.2f} for a run of {limits.run_size:.3g})"
    )
    for signature in calibration.signatures:
        typer.echo(f"known fault: {signature.fault}, from {signature.source}")
