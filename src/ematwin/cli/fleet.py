"""``ematwin watch``, ``fleet`` and ``serve``: who in a fleet needs what when, and its entries."""

import time
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, file_to_write, option
from ematwin.errors import InputError
from ematwin.showing.results import plain

FLEET = argument("The folder of `ematwin watch --fleet`.")
SERIAL = argument("Serial number of the actuator.")
MAGNITUDE = argument("The magnitude of the alarm, e.g. friction; else all of them.", None)
NOTE = option("A remark that is kept, e.g. who and why.", "")
STEP = option(
    "End with exit code 1 if an actuator has reached this step (watch, plan, act), or if "
    "its latest recording has a fault (fault)."
)

_MOST = 20  # rows in the shell; the page has more

fleet = typer.Typer(
    help="Show a fleet, record overhauls, acknowledge and silence alarms, withdraw such entries.",
    no_args_is_help=True, rich_markup_mode=None,
)  # fmt: skip


@fleet.command()
def status(
    fleet: Path = FLEET,
    report: Path | None = options.REPORT,
    table: Path | None = file_to_write(
        "Write a row for each actuator as a table (.csv or .parquet).", ".csv", ".parquet"
    ),
    recordings: Path | None = file_to_write(
        "Write a row for each recording as a table (.csv or .parquet).", ".csv", ".parquet"
    ),
    fail_on: str | None = STEP,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Say which actuator needs what, and when, from the recordings that are judged."""
    _check_step(fail_on)
    known = ematwin.Fleet(fleet, create=False)
    aside = [(str(row["source"]), str(row["reason"])) for row in known.set_aside]

    def tell() -> None:
        print_fleet(known)
        _print_aside(aside[:_MOST])
        if len(aside) > _MOST:
            typer.echo(f"and {len(aside) - _MOST} more set aside; --json shows all")

    told = {"actuators": plain(known.table()), "set_aside": _listed(aside)}
    fails = _reached(known, fail_on)
    files = (table, partial(known.export, what="advisory")), (recordings, known.export)
    answers.give(json, lambda: told, tell, *files, (report, known.report), fails=fails)


@fleet.command()
def overhaul(
    fleet: Path = FLEET,
    serial: str = SERIAL,
    on: str | None = option("Day or time, e.g. 2026-05-01; now if not given."),
    note: str = NOTE,
) -> None:
    """Record that an actuator was repaired or exchanged: its wear begins anew."""
    from ematwin.fleet.store import moment_of

    when = datetime.now(UTC) if on is None else moment_of(on)
    _unit(fleet, serial).overhaul(when, note)
    typer.echo(f"{serial}: overhaul on {when:%Y-%m-%d} recorded.")


@fleet.command()
def acknowledge(
    fleet: Path = FLEET, serial: str = SERIAL, magnitude: str | None = MAGNITUDE, note: str = NOTE
) -> None:
    """Acknowledge alarms of an actuator: shown as such until their step changes."""
    names = _unit(fleet, serial).acknowledge(magnitude, note)
    typer.echo(f"{serial}: {', '.join(names)} acknowledged.")


@fleet.command()
def silence(
    fleet: Path = FLEET,
    serial: str = SERIAL,
    until: str = option("Day or time, e.g. 2026-06-01; one that has passed ends a silence.", ...),
    magnitude: str | None = MAGNITUDE,
    note: str = NOTE,
) -> None:
    """Silence alarms of an actuator until a day."""
    names = _unit(fleet, serial).silence(magnitude, until, note)
    typer.echo(f"{serial}: {', '.join(names)} silenced until {until}.")


@fleet.command()
def history(fleet: Path = FLEET, serial: str = SERIAL, json: bool = options.JSON) -> None:
    """Show alarms of an actuator and entries of its maintainers, the latest first."""
    from ematwin.fleet.pages import history as known

    unit = _unit(fleet, serial)
    told = [
        one | {name: one[name].isoformat() for name in ("time", "known")}
        | {"withdrawn": one not in unit.events}
        for one in reversed(unit.history)
    ]  # fmt: skip
    shown = partial(answers.print_table, "", known(unit), whole=("day", "entry"), width=200)
    answers.give(json, lambda: {"events": told}, shown)


@fleet.command()
def withdraw(
    fleet: Path = FLEET,
    serial: str = SERIAL,
    entries: list[str] = argument("Entries, as `ematwin fleet history` shows them."),
    note: str = NOTE,
) -> None:
    """Withdraw wrong entries; the history shows both. Then enter the right ones."""
    for one in _unit(fleet, serial).withdraw(*entries, note=note):
        typer.echo(f"{serial}: {one['what']} of {one['time']:%Y-%m-%d} withdrawn.")


def _unit(folder: Path, serial: str) -> Any:
    return ematwin.Fleet(folder, create=False)[serial]


def _check_step(fail_on: str | None) -> None:
    """Refuse a ``--fail-on`` that is neither a step of an alarm nor a fault."""
    from ematwin.fleet.alarms import STEPS

    if fail_on is not None and fail_on not in ("fault", *STEPS[1:]):
        raise InputError(f"--fail-on takes fault, watch, plan or act, received {fail_on!r}.")


def _reached(fleet: "ematwin.Fleet", fail_on: str | None) -> bool:
    """Whether an actuator has reached what ``--fail-on`` names."""
    from ematwin.fleet.alarms import STEPS

    if fail_on is None:
        return False
    if fail_on == "fault":
        return any(row["state"] == "fault" for row in fleet.table())
    return any(row["advisory_level"] >= STEPS.index(fail_on) for row in fleet.table())


def print_fleet(fleet: "ematwin.Fleet") -> None:
    """The actuators for people, the most urgent first."""
    from ematwin.report.page import Row, Table

    rows = fleet.table()
    if not rows:
        typer.echo("No recording is judged yet.")
        return
    shown = []
    for row in rows[:_MOST]:
        life = fleet[row["serial_number"]].life_left()
        seen = " (acknowledged)" if row["acknowledged"] else ""
        named = (row["serial_number"], row["advisory"] + seen, life or "", row["advisory_reason"])
        shown.append(Row([str(one) for one in named], marked=row["advisory_level"] == 3))
    header = ["actuator", "what to do", "life left", "why"]
    answers.print_table("", Table(header, shown, texts=(1, 2, 3)), width=200)
    if not fleet.limits_given:
        settings = fleet.store.folder / "fleet.toml"
        typer.echo(f"No life left without limits: state some under [limits] in {settings}.")
    if len(rows) > _MOST:
        typer.echo(f"and {len(rows) - _MOST} more actuators; --report shows all")


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

    _check_step(fail_on)
    if every is not None and not every > 0.0:
        raise InputError(f"--every needs seconds above 0, received {every:g}.")
    columns = None
    if column or map_file:
        columns = options.map_of(column, map_file, ematwin.load_actuator(actuator))
    Paths(recordings, serial_number)  # refuses what is not there before a fleet is made
    known = ematwin.Fleet(fleet)

    def look() -> None:
        found = known.watch(
            recordings, actuator=actuator, columns=columns, progress=not json,
            pattern=serial_number, scheduler=scheduler,
        )  # fmt: skip

        def told() -> dict[str, object]:
            counts = ("judged", "known", "duplicates", "still_aside")
            aside = {"set_aside": _listed(found.set_aside), "actuators": plain(known.table())}
            return {name: getattr(found, name) for name in counts} | aside

        def tell() -> None:
            typer.echo(str(found))
            _print_aside(found.set_aside)
            print_fleet(known)

        advisory = table if len(known) else None  # without a recording there is no table
        files = (advisory, partial(known.export, what="advisory")), (report, known.report)
        fails = every is None and _reached(known, fail_on)
        answers.give(json, told, tell, *files, fails=fails)

    look()
    while every is not None:
        time.sleep(every)
        look()


def _listed(aside: list[tuple[str, str]]) -> list[dict[str, str]]:
    return [{"source": source, "reason": reason} for source, reason in aside]


def _print_aside(aside: list[tuple[str, str]]) -> None:
    answers.print_notes("Set aside", [f"{source}: {reason}" for source, reason in aside])


def serve(
    fleet: Path = argument("The folder of `ematwin watch --fleet`."),
    port: int = options.PORT,
    units: str | None = options.UNITS,
    no_browser: bool = options.NO_BROWSER,
) -> None:
    """Show a fleet in the browser, as it is at each moment: read only, on this machine only."""
    from ematwin.fleet.serve import FleetServer

    known = ematwin.Fleet(fleet, create=False)
    answers.serve_page(FleetServer(known, port), "The fleet", no_browser)
