"""``ematwin detect``: recordings in, a verdict on each out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli.options import (
    FailOption,
    JsonOption,
    LoadOption,
    MapOption,
    ReportOption,
    TableOption,
    grades,
    print_json,
    print_notes,
    print_table,
    progress_bar,
)
from ematwin.cli.recordings import choice, constant_load, remarks
from ematwin.cli.recordings import load as loaded
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.monitoring.diagnosis import Detection, Diagnosis
    from ematwin.recordings.recording import Recording

_EACH = ("motion", "run")
# Keys that each verdict has, null where they do not apply.
_ALWAYS = dict.fromkeys(
    ("index", "threshold", "clear_threshold", "named_by", "load_N", "sensor_coupling")
)


def detect(
    records: Annotated[
        list[Path], typer.Argument(help="Files with recordings to judge, or folders of them.")
    ],
    actuator: Annotated[
        Path, typer.Option(help="Actuator calibrated by `ematwin calibrate` (.toml).")
    ],
    each: Annotated[
        str,
        typer.Option(
            help="What to judge: each run (its recordings together, where a healthy population "
            "judges) or each motion (recording)."
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
    load: LoadOption = None,
    report: ReportOption = None,
    table: TableOption = None,
    fail_on: FailOption = None,
    json: JsonOption = False,
) -> None:
    """Judge recordings against the healthy actuator: what identify says of each, as a table.

    healthy; changed: by no more than drift, or like no fault that can be named; fault: all faults
    by name, and an alarm; none: no verdict, with the reason.
    """
    from ematwin.monitoring.calibration import Calibration
    from ematwin.monitoring.identify import detect as run

    if each not in _EACH:
        raise InputError(f"--each must be motion or run, received {each!r}.")
    check_targets(table, report)
    failing = grades(fail_on)
    calibration = Calibration.load(actuator)
    wanted = choice(where or [], "--where")
    recordings = loaded(
        records, column, map_file, calibration.actuator, *([wanted] if wanted else [])
    )
    given = constant_load(load, calibration.actuator)
    with progress_bar("Judging", not json) as progress:
        found = run(recordings, calibration, load=given, progress=progress)
    answer(found, recordings, each, table, report, json)
    if any(one.grade in failing for one in found.each(each)):
        raise typer.Exit(1)


def check_targets(table: Path | None, report: Path | None) -> None:
    """Refuse a table or page that cannot be written, before any work is done."""
    from ematwin.files import check_target

    if report is not None:
        check_target(report, (".html",))
    if table is not None:
        check_target(table, (".csv", ".parquet"))


def answer(
    found: "Detection",
    recordings: "list[Recording]",
    each: str,
    table: Path | None,
    report: Path | None,
    json: bool,
) -> None:
    """Write table and page if they are wanted, and print the verdicts with what was assumed."""
    actuator = found.calibration.actuator
    assumed, doubtful = remarks(recordings)
    shown = found.each(each)
    if table is not None:
        _write_table(table, shown)
    if report is not None:
        found.report(report)
    if json:
        print_json(
            {
                "actuator": actuator.name,
                "kind": actuator.kind,
                "each": each,
                "verdicts": [{**_ALWAYS, **one.as_dict()} for one in shown],
                "not_judged": found.missing,
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
    """The table for people, with the faults that some verdict names, and what is to be said."""
    from rich.table import Table

    from ematwin.monitoring.diagnosis import counted, gathered_notes, gathered_reasons

    shown = found.each(each)
    telling = {name for one in shown if one.alarm for name in _telling(one)}
    columns = [m.name for m in shown[0].magnitudes if m.name in telling]
    at = shown[0].standing
    covariate = None if at is None else at.covariate
    table = Table()
    table.add_column(each if found.by_run else "recording")
    table.add_column("verdict")
    beside = [] if covariate is None else [covariate.name]
    for heading in (*columns, *beside, *(() if at is None else ("index / limit",))):
        table.add_column(heading, justify="right")
    for one in shown:
        cells = [str(m) for m in one.magnitudes if m.name in columns]
        if one.standing is not None:
            cells += [str(one.standing.covariate)] if covariate else []
            cells.append(f"{one.standing.index:.2f} / {one.standing.threshold:.2f}")
        table.add_row(one.name, one.said, *cells, style="bold" if one.alarm else None)
    print_table(table, 200)
    if found.by_run:
        for kind, rows in (("runs", found.runs), ("motions", found.motions)):
            typer.echo(counted(rows, kind))
    else:
        typer.echo(found.sentence)
    print_notes("Why", gathered_reasons(shown))
    print_notes("Note", gathered_notes(shown))


def _telling(one: "Diagnosis") -> list[str]:
    """The magnitudes that a fault is named by, or else the one that is furthest from healthy."""
    named = [m.name for m in one.magnitudes if m.name in one.faults]
    return named or [max(one.magnitudes, key=lambda m: abs(m.score)).name]


def _write_table(path: Path, shown: "tuple[Diagnosis, ...]") -> None:
    from ematwin.recordings.tables import write_table

    rows = [one.row for one in shown]
    names = list(dict.fromkeys(name for row in rows for name in row))
    write_table(path, {name: [row.get(name) for row in rows] for name in names})
