"""``ematwin watch``: recordings of a fleet in, who needs what when out."""

import time
from functools import partial
from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import options
from ematwin.cli.fleet import STEP, check_step, print_fleet, reached
from ematwin.cli.options import argument, option
from ematwin.cli.recordings import map_of
from ematwin.errors import InputError
from ematwin.showing.results import plain


def watch(
    recordings: list[Path] = argument(
        "Folders or files with recordings: recordings/EMA-17/2026-05-01T08-30.csv, a "
        "table with a column serial_number, or a table of runs with columns path, serial, time."
    ),
    fleet: Path = option("Folder of the fleet; made where it is missing.", ...),
    actuator: str | None = option(
        "Twin of actuators without a file calibrations/<serial number>.toml in the fleet."
    ),
    serial_number: str | None = option(
        r"Regular expression for paths, e.g. '(?P<serial>EMA-\d+)'; a group time is "
        "the date."
    ),
    column: list[str] | None = options.COLUMN,
    map_file: Path | None = options.MAP,
    every: float | None = option("Look again every so many seconds, until Ctrl-C; else once."),
    scheduler: str | None = option(
        "Judge on the workers of a Dask scheduler, e.g. tcp://host:8786, which see the "
        "same folders."
    ),
    report: Path | None = options.REPORT,
    table: Path | None = options.TABLE,
    fail_on: str | None = STEP,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Judge new recordings of a fleet, and say which actuator needs what, and when.

    Each recording is judged once, and its estimate is kept in the folder of the fleet. Ctrl-C
    or a crash loses nothing: the same command goes on.
    """
    from ematwin.fleet.watch import Paths

    check_step(fail_on)
    if every is not None and not every > 0.0:
        raise InputError(f"--every needs seconds above 0, received {every:g}.")
    options.check_outputs(report, table)
    columns = None
    if column or map_file:
        columns = map_of(column, map_file, ematwin.load_actuator(actuator))
    Paths(recordings, serial_number)  # refuses what is not there before a fleet is made
    known = ematwin.Fleet(fleet)
    while True:
        with options.progress_bar("Judging", not json) as progress:
            found = known.watch(
                recordings, actuator=actuator, columns=columns, progress=progress,
                pattern=serial_number, scheduler=scheduler,
            )  # fmt: skip
        if table is not None and len(known):
            known.export(table, "advisory")
        if report is not None:
            known.report(report)
        fails = every is None and reached(known, fail_on)
        told = partial(_plain, known, found), partial(_tell, known, found)
        options.answer(json, *told, table, report, fails=fails)
        if every is None:
            break
        time.sleep(every)


def _plain(fleet: "ematwin.Fleet", found: Any) -> dict[str, object]:
    return {
        "judged": found.judged, "known": found.known, "duplicates": found.duplicates,
        "set_aside": [{"source": a, "reason": b} for a, b in found.set_aside],
        "actuators": plain(fleet.table()),
    }  # fmt: skip


def _tell(fleet: "ematwin.Fleet", found: Any) -> None:
    typer.echo(str(found))
    options.print_notes("Set aside", [f"{path}: {reason}" for path, reason in found.set_aside])
    print_fleet(fleet)
