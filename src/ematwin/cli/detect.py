"""``ematwin detect``: recordings in, a verdict on each out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli.motions import choice, load_motions
from ematwin.cli.options import print_json, print_table
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.monitoring.detect import Detection, Verdict

_EACH = ("motion", "run")


def detect(
    records: Annotated[list[Path], typer.Argument(help="Files with motions to judge.")],
    actuator: Annotated[Path, typer.Option(help="What `ematwin calibrate` wrote (.toml).")],
    each: Annotated[
        str, typer.Option(help="A row for each run (its motions together) or each motion.")
    ] = "run",
    where: Annotated[
        list[str] | None,
        typer.Option(help="Take only motions with these labels: condition=normal. Repeatable."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(help='Which channel is what: set_point="Demand [mm]". Repeatable.'),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write a self-contained page here (.html).")
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Write all verdicts as a table (.csv or .parquet).")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Judge recordings against the healthy actuator: value, interval, alarm, name of the fault."""
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.detect import detect as run
    from ematwin.readers.files import check_target, write_text

    if each not in _EACH:
        raise InputError(f"--each must be motion or run, received {each!r}.")
    if report is not None:
        check_target(report, (".html",))
    if table is not None:
        check_target(table, (".csv", ".parquet"))
    calibration = Calibration.load(actuator)
    found = run(load_motions(records, column, choice(where or [], "--where")), calibration)
    shown = found.runs if each == "run" else found.motions
    if table is not None:
        _write_table(table, shown)
    if report is not None:
        from ematwin.report.detection import detection_page

        write_text(report, detection_page(found))
    if json:
        print_json(
            {
                "actuator": calibration.actuator.name,
                "each": each,
                "verdicts": [verdict.as_dict() for verdict in shown],
                "report": None if report is None else str(report),
            }
        )
        return
    print_verdicts(found, each)
    for path in (table, report):
        if path is not None:
            typer.echo(f"wrote {path}")


def print_verdicts(found: "Detection", each: str) -> None:
    """The table for people, and what there is to say of it."""
    from rich.table import Table

    from ematwin.monitoring.detect import gathered_notes

    shown = found.runs if each == "run" else found.motions
    table = Table()
    table.add_column(each)
    for heading in ("friction", "backlash", "gain", "roughness", "load", "index", "limit"):
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for verdict in shown:
        cells = [
            f"{m.value:.2f} ({m.low:.2f} to {m.high:.2f}) {m.unit}" for m in verdict.magnitudes
        ]
        table.add_row(
            verdict.name, *cells, f"{verdict.load:.0f} N", f"{verdict.index:.2f}",
            f"{verdict.threshold:.2f}", verdict.fault if verdict.alarm else "healthy",
            style="bold" if verdict.alarm else None,
        )  # fmt: skip
    print_table(table, 200)
    for kind, verdicts in (("runs", found.runs), ("motions", found.motions)):
        alarms = sum(verdict.alarm for verdict in verdicts)
        typer.echo(f"{alarms} of {len(verdicts)} {kind} raise an alarm")
    for note in gathered_notes(shown):
        typer.echo(f"Note: {note}")


def _write_table(path: Path, verdicts: "tuple[Verdict, ...]") -> None:
    from ematwin.readers.tables import write_table

    rows = []
    for verdict in verdicts:
        row: dict[str, object] = {"name": verdict.name, **verdict.labels}
        row |= {"motions": verdict.motions, "index": verdict.index, "limit": verdict.threshold}
        row |= {"alarm": verdict.alarm, "fault": verdict.fault, "named_by": verdict.named_by}
        for m in verdict.magnitudes:
            key = f"{m.name}_{m.unit}" if m.unit != "x" else m.name
            row |= {key: m.value, f"{key}_low": m.low, f"{key}_high": m.high}
        row |= {"load_N": verdict.load, "sensor_coupling": verdict.coupling}
        rows.append(row)
    names = list(dict.fromkeys(name for row in rows for name in row))
    write_table(path, {name: [row.get(name) for row in rows] for name in names})
