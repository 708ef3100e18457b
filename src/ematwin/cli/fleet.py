"""``ematwin fleet``: advisories of a fleet, and entries of its maintainers."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import options
from ematwin.cli.options import argument, option
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

fleet = typer.Typer(
    help="Show a fleet, record overhauls, acknowledge and silence alarms, withdraw such entries.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@fleet.command("status")
def status(
    fleet: Path = FLEET,
    report: Path | None = options.REPORT,
    table: Path | None = option("Write a row for each actuator as a table (.csv or .parquet)."),
    recordings: Path | None = option(
        "Write a row for each recording as a table (.csv or .parquet)."
    ),
    fail_on: str | None = STEP,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Say which actuator needs what, and when, from the recordings that are judged."""
    check_step(fail_on)
    options.check_outputs(report, table, recordings)
    known = ematwin.Fleet(fleet, create=False)
    if table is not None:
        known.export(table, "advisory")
    if recordings is not None:
        known.export(recordings)
    if report is not None:
        known.report(report)
    options.answer(
        json, lambda: {"actuators": plain(known.table())}, lambda: print_fleet(known), table,
        recordings, report, fails=reached(known, fail_on),
    )  # fmt: skip


@fleet.command("overhaul")
def overhaul(
    fleet: Path = FLEET,
    serial: str = SERIAL,
    on: str | None = option("Day or time, e.g. 2026-05-01; now if not given."),
    note: str = NOTE,
) -> None:
    """Record that an actuator was repaired or exchanged: its wear begins anew."""
    from ematwin.fleet.store import moment_of

    when = datetime.now(UTC) if on is None else moment_of(on)
    ematwin.Fleet(fleet, create=False)[serial].overhaul(when, note)
    typer.echo(f"{serial}: overhaul on {when:%Y-%m-%d} recorded.")


@fleet.command("acknowledge")
def acknowledge(
    fleet: Path = FLEET, serial: str = SERIAL, magnitude: str | None = MAGNITUDE, note: str = NOTE
) -> None:
    """Acknowledge alarms of an actuator: shown as such until their step changes."""
    _told(fleet, serial, "acknowledged", lambda one: one.acknowledge(magnitude, note))


@fleet.command("silence")
def silence(
    fleet: Path = FLEET,
    serial: str = SERIAL,
    until: str = option("Day or time, e.g. 2026-06-01; one that has passed ends a silence.", ...),
    magnitude: str | None = MAGNITUDE,
    note: str = NOTE,
) -> None:
    """Silence alarms of an actuator until a day."""
    _told(fleet, serial, f"silenced until {until}", lambda one: one.silence(magnitude, until, note))


@fleet.command("history")
def history(fleet: Path = FLEET, serial: str = SERIAL, json: bool = options.JSON) -> None:
    """Show alarms of an actuator and entries of its maintainers, the latest first."""
    from ematwin.fleet.pages import history as known

    unit = ematwin.Fleet(fleet, create=False)[serial]
    told = [
        one | {name: one[name].isoformat() for name in ("time", "known")}
        | {"withdrawn": one not in unit.events}
        for one in reversed(unit.history)
    ]  # fmt: skip
    options.answer(
        json, lambda: {"events": told},
        lambda: options.print_table("", known(unit), whole=("day", "entry"), width=200),
    )  # fmt: skip


@fleet.command("withdraw")
def withdraw(
    fleet: Path = FLEET,
    serial: str = SERIAL,
    entries: list[str] = argument("Entries, as `ematwin fleet history` shows them."),
    note: str = NOTE,
) -> None:
    """Withdraw wrong entries; the history shows both. Then enter the right ones."""
    for one in ematwin.Fleet(fleet, create=False)[serial].withdraw(*entries, note=note):
        typer.echo(f"{serial}: {one['what']} of {one['time']:%Y-%m-%d} withdrawn.")


def _told(folder: Path, serial: str, how: str, tell: Callable[[Any], tuple[str, ...]]) -> None:
    names = tell(ematwin.Fleet(folder, create=False)[serial])
    typer.echo(f"{serial}: {', '.join(names)} {how}.")


def check_step(fail_on: str | None) -> None:
    """Refuse a ``--fail-on`` that is neither a step of an alarm nor a fault."""
    from ematwin.fleet.alarms import STEPS

    if fail_on is not None and fail_on not in ("fault", *STEPS[1:]):
        raise InputError(f"--fail-on takes fault, watch, plan or act, received {fail_on!r}.")


def reached(fleet: "ematwin.Fleet", fail_on: str | None) -> bool:
    """Whether an actuator has reached what ``--fail-on`` names."""
    from ematwin.fleet.alarms import STEPS

    if fail_on == "fault":
        return any(row["state"] == "fault" for row in fleet.table())
    return fail_on is not None and any(
        row["advisory_level"] >= STEPS.index(fail_on) for row in fleet.table()
    )


def print_fleet(fleet: "ematwin.Fleet") -> None:
    """The actuators for people, the most urgent first."""
    from ematwin.report.page import Row, Table

    rows = fleet.table()
    if not rows:
        typer.echo("No recording is judged yet.")
        return
    shown = []
    most = 20  # the page has all
    for row in rows[:most]:
        life = fleet[row["serial_number"]].life_left()
        seen = " (acknowledged)" if row["acknowledged"] else ""
        named = (row["serial_number"], row["advisory"] + seen, life or "", row["advisory_reason"])
        shown.append(Row([str(one) for one in named], marked=row["advisory_level"] == 3))
    headings = ["actuator", "what to do", "life left", "why"]
    options.print_table("", Table(headings, shown, texts=(1, 2, 3)), width=200)
    if not fleet.limits_given:
        settings = fleet.store.folder / "fleet.toml"
        typer.echo(f"No life left without limits: state some under [limits] in {settings}.")
    if len(rows) > most:
        typer.echo(f"and {len(rows) - most} more actuators; --report shows all")
