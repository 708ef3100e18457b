"""``ematwin detect``: recordings in, a verdict on each out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli.options import (
    JsonOption,
    MapOption,
    ReportOption,
    print_json,
    print_notes,
    print_table,
)
from ematwin.cli.recordings import choice, load, remarks
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.monitoring.detect import Detection, Verdict
    from ematwin.recordings.recording import Recording

_EACH = ("motion", "run")
_OF_BALL_SCREWS = {"load_N": None, "sensor_coupling": None}  # keys that each verdict has had


def detect(
    records: Annotated[list[Path], typer.Argument(help="Files with recordings to judge.")],
    actuator: Annotated[
        Path, typer.Option(help="Actuator calibrated by `ematwin calibrate` (.toml).")
    ],
    each: Annotated[
        str,
        typer.Option(
            help="What to judge: each run (its recordings together) or each motion (recording)."
        ),
    ] = "run",
    where: Annotated[
        list[str] | None,
        typer.Option(help="Use only recordings with this label: condition=normal. Repeatable."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(help='Which channel is what, e.g. set_point="Demand [mm]". Repeatable.'),
    ] = None,
    map_file: MapOption = None,
    report: ReportOption = None,
    table: Annotated[
        Path | None, typer.Option(help="Write all verdicts as a table (.csv or .parquet).")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Judge recordings against the healthy actuator: value, interval, alarm, name of the fault.

    healthy; changed: unlike healthy runs, but like no fault that can be named; fault: named, and an
    alarm; none: no verdict. A change raises an alarm where it is clearly more than what may drift.
    """
    from ematwin.files import check_target
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.detect import detect as run

    if each not in _EACH:
        raise InputError(f"--each must be motion or run, received {each!r}.")
    if report is not None:
        check_target(report, (".html",))
    if table is not None:
        check_target(table, (".csv", ".parquet"))
    calibration = Calibration.load(actuator)
    wanted = choice(where or [], "--where")
    recordings = load(
        records, column, map_file, calibration.actuator, *([wanted] if wanted else [])
    )
    answer(run(recordings, calibration), recordings, each, table, report, json)


def answer(
    found: "Detection",
    recordings: "list[Recording]",
    each: str,
    table: Path | None,
    report: Path | None,
    json: bool,
) -> None:
    """Write table and page if they are wanted, and print the verdicts with what was assumed."""
    from ematwin.files import write_text

    actuator = found.calibration.actuator
    assumed, doubtful = remarks(recordings)
    shown = found.runs if each == "run" else found.motions
    if table is not None:
        _write_table(table, shown)
    if report is not None:
        from ematwin.report.detection import detection_page

        write_text(report, detection_page(found))
    if json:
        print_json(
            {
                "actuator": actuator.name,
                "kind": actuator.kind,
                "each": each,
                "verdicts": [{**_OF_BALL_SCREWS, **verdict.as_dict()} for verdict in shown],
                "report": None if report is None else str(report),
                "assumed": assumed,
                "warnings": doubtful,
            }
        )
        return
    print_verdicts(found, each)
    print_notes("Assumed", assumed)
    print_notes("Warning", doubtful)
    for path in (table, report):
        if path is not None:
            typer.echo(f"wrote {path}")


def print_verdicts(found: "Detection", each: str) -> None:
    """The table for people, and what there is to say of it."""
    from rich.table import Table

    from ematwin.monitoring.detect import counted, gathered_notes, gathered_reasons

    shown = found.runs if each == "run" else found.motions
    reported = [m.name for m in shown[0].magnitudes]
    covariate = shown[0].covariate
    table = Table()
    table.add_column(each)
    for heading in (*reported, *([covariate.name] if covariate else []), "index", "limit"):
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for verdict in shown:
        cells = [
            f"{m.value:.2f} ({m.low:.2f} to {m.high:.2f}) {m.unit}".rstrip()
            for m in verdict.magnitudes
        ]
        table.add_row(
            verdict.name, *cells, *([str(verdict.covariate)] if covariate else []),
            f"{verdict.index:.2f}", f"{verdict.threshold:.2f}", verdict.said,
            style="bold" if verdict.alarm else None,
        )  # fmt: skip
    print_table(table, 200)
    for kind, verdicts in (("runs", found.runs), ("motions", found.motions)):
        typer.echo(counted(verdicts, kind))
    print_notes("Why", gathered_reasons(shown))
    print_notes("Note", gathered_notes(shown))


def _write_table(path: Path, verdicts: "tuple[Verdict, ...]") -> None:
    from ematwin.recordings.tables import write_table

    rows = [verdict.row for verdict in verdicts]
    names = list(dict.fromkeys(name for row in rows for name in row))
    write_table(path, {name: [row.get(name) for row in rows] for name in names})
