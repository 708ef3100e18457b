"""``ematwin watch``: recordings of a fleet in, who needs what when out."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli import options
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.fleet.fleet import Fleet
    from ematwin.fleet.watch import Watched

_MOST = 20  # actuators in the terminal; the page has all


def watch(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="Folders or files with recordings: recordings/EMA-17/2026-05-01T08-30.csv, or a "
            "table with a column serial_number."
        ),
    ],
    fleet: Annotated[Path, typer.Option(help="Folder of the fleet; made where it is missing.")],
    actuator: Annotated[
        str | None,
        typer.Option(
            help="Twin of actuators without a file calibrations/<serial number>.toml in the fleet."
        ),
    ] = None,
    serial_number: Annotated[
        str | None,
        typer.Option(
            help=r"Regular expression for paths, e.g. '(?P<serial>EMA-\d+)'; a group time is "
            "the date."
        ),
    ] = None,
    column: options.ColumnOption = None,
    map_file: options.MapOption = None,
    every: Annotated[
        float | None,
        typer.Option(help="Look again every so many seconds, until Ctrl-C; else once."),
    ] = None,
    report: options.ReportOption = None,
    table: options.TableOption = None,
    fail_on: Annotated[
        str | None,
        typer.Option(
            help="End with exit code 1 if an actuator has reached this step: watch, plan or act."
        ),
    ] = None,
    units: options.UnitsOption = None,
    json: options.JsonOption = False,
) -> None:
    """Judge new recordings of a fleet, and say which actuator needs what, and when.

    Each recording is judged once, and its estimate is kept in the folder of the fleet. Ctrl-C
    or a crash loses nothing: the same command goes on.
    """
    from ematwin.cli.channels import map_of
    from ematwin.fleet.alarms import STEPS
    from ematwin.fleet.fleet import Fleet
    from ematwin.fleet.watch import watch as run
    from ematwin.models.registry import load_actuator

    if fail_on is not None and fail_on not in STEPS[1:]:
        raise InputError(f"--fail-on takes watch, plan or act, received {fail_on!r}.")
    if every is not None and not every > 0.0:
        raise InputError(f"--every needs seconds above 0, received {every:g}.")
    options.check_outputs(report, table)
    columns = None
    if column or map_file:
        columns = map_of(column, map_file, load_actuator(actuator))
    known = Fleet(fleet)
    while True:
        with options.progress_bar("Judging", not json) as progress:
            found = run(
                known.store, recordings, actuator, columns=columns, progress=progress,
                pattern=serial_number or known.pattern,
            )  # fmt: skip
        known.refresh()
        known.update()
        if table is not None and len(known):
            known.export(table, "advisory")
        if report is not None:
            known.report(report)
        _answer(known, found, json)
        if not json:
            options.print_written(table, report)
        if every is None:
            break
        time.sleep(every)
    if fail_on is not None and any(
        row["advisory_level"] >= STEPS.index(fail_on) for row in known.table()
    ):
        raise typer.Exit(1)


def _answer(fleet: "Fleet", found: "Watched", json: bool) -> None:
    import math

    rows = fleet.table()
    if json:
        plain = [
            {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in r.items()}
            for r in rows
        ]
        options.print_json(
            {
                "judged": found.judged, "known": found.known, "duplicates": found.duplicates,
                "set_aside": [{"source": a, "reason": b} for a, b in found.set_aside],
                "actuators": plain,
            }
        )  # fmt: skip
        return
    typer.echo(str(found))
    options.print_notes("Set aside", [f"{path}: {reason}" for path, reason in found.set_aside])
    print_fleet(fleet, rows)


def print_fleet(fleet: "Fleet", rows: list[dict[str, object]] | None = None) -> None:
    """The actuators for people, the most urgent first."""
    rows = fleet.table() if rows is None else rows
    if not rows:
        return
    cells = []
    for row in rows[:_MOST]:
        life = fleet[str(row["serial_number"])].life_left()
        named = (row["serial_number"], row["advisory"], life or "", row["advisory_reason"])
        cells.append([str(one) for one in named])
    headings = ("actuator", "what to do", "life left", "why")
    bold = [n for n, row in enumerate(rows[:_MOST]) if row["advisory_level"] == 3]
    options.print_table("", headings, cells, texts=headings, bold=bold, width=200)
    if len(rows) > _MOST:
        typer.echo(f"and {len(rows) - _MOST} more actuators; --report shows all")
