"""``ematwin detect``: recordings in, a verdict on each out."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import options
from ematwin.cli.options import argument, option
from ematwin.cli.recordings import choice, constant_load, gathered, remarks
from ematwin.errors import InputError

# Keys that each verdict has, null where they do not apply.
_ALWAYS = dict.fromkeys(("distance", "load_N", "sensor_coupling"))


def detect(
    records: list[Path] = argument(
        "Files with recordings to judge, folders of them, or a table of runs (docs/recordings.md)."
    ),
    actuator: Path | None = option(
        "Actuator calibrated by `ematwin calibrate` (.toml); a table of runs may name one "
        "in each row."
    ),
    each: str = option(
        "What to judge: each run (its recordings together, where a healthy population "
        "judges) or each motion (recording).",
        "run",
    ),
    where: list[str] | None = options.WHERE,
    column: list[str] | None = options.COLUMN,
    map_file: Path | None = options.MAP,
    load: str | None = options.LOAD,
    report: Path | None = options.REPORT,
    table: Path | None = options.TABLE,
    fail_on: str | None = options.FAIL,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Judge recordings against the healthy actuator: the verdict of identify on each, as a table.

    healthy; changed: by no more than drift, or like no fault that can be named; fault: all faults
    by name, and an alarm; none: no verdict, with the reason.
    """
    if each not in ("motion", "run"):
        raise InputError(f"--each must be motion or run, received {each!r}.")
    options.check_outputs(report, table)
    failing = options.grades(fail_on)
    wanted = choice(where or [], "--where")

    def calibrated(given: Path | None, _: Path) -> ematwin.Calibration:
        if given is None:
            raise InputError(
                "detect needs a calibrated actuator; give the file of ematwin calibrate with "
                "--actuator, or a table of runs that names one in each row."
            )
        return ematwin.Calibration.load(given)

    choices = [wanted] if wanted else None
    recordings, known = gathered(records, actuator, column, map_file, calibrated, where=choices)
    given = constant_load(load, known.actuator)
    with options.progress_bar("Judging", not json) as progress:
        found = ematwin.detect(
            recordings, known if isinstance(recordings, list) else None, load=given,
            progress=progress,
        )  # fmt: skip
    answer(found, recordings, each, table, report, json, failing)


def answer(
    found: Any, recordings: Any, each: str, table: Path | None,
    report: Path | None, json: bool, failing: set[str],
) -> None:  # fmt: skip
    """Write table and page if they are wanted, and print the verdicts with assumptions."""
    from ematwin.recordings.tables import write_rows

    assumed, doubtful = remarks(getattr(recordings, "recordings", recordings))
    if table is not None:
        write_rows(table, found.rows(each))
    if report is not None:
        found.report(report)

    def plain() -> dict[str, object]:
        told = []
        for name, known in found.calibrations.items():
            actuator = {"actuator": known.actuator.name, "kind": known.actuator.kind}
            verdicts = [{**_ALWAYS, **one.as_dict()} for one in found[name].each(each)]
            told.append({**({"name": name} if name else {}), **actuator, "verdicts": verdicts})
        return {
            **({"actuators": told} if found.is_named else told[0]), "each": each,
            "not_judged": found.missing, "report": report, "assumed": assumed,
            "warnings": doubtful,
        }  # fmt: skip

    def tell() -> None:
        print_verdicts(found, each)
        options.print_notes("Assumed", assumed)
        options.print_notes("Warning", doubtful)

    fails = any(one.grade in failing for one in found.each(each))
    options.answer(json, plain, tell, table, report, fails=fails)


def print_verdicts(found: Any, each: str) -> None:
    """Print the table, with a column for each fault that some verdict names, and the notes."""
    from ematwin.monitoring.detection import counted, gathered_notes, gathered_reasons
    from ematwin.report.detection import verdict_table

    rows = found.each(each)
    telling: dict[str, None] = {}
    for one in (one for one in rows if one.alarm):  # its faults, or what is furthest from healthy
        named = [m.name for m in one.magnitudes if m.name in one.faults]
        furthest = max(one.magnitudes, key=lambda m: abs(m.score)).name
        telling |= dict.fromkeys(named or [furthest])
    what = each if found.by_run else "recording"
    options.print_table("", verdict_table(rows, what, list(telling)), width=200)
    if found.by_run and not found.is_named:
        for kind, verdicts in (("runs", found.runs), ("motions", found.motions)):
            typer.echo(counted(verdicts, kind))
    else:
        typer.echo(found.sentence)
    options.print_notes("Why", gathered_reasons(rows))
    options.print_notes("Note", gathered_notes(rows))
