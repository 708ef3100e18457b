"""``ematwin calibrate``: healthy recordings in, a calibrated actuator out."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import options
from ematwin.cli.options import argument, option
from ematwin.cli.recordings import choice, known_fault, load, meant, remarks
from ematwin.files import check_target


def calibrate(
    records: list[Path] = argument(
        "Files with healthy recordings, or folders of them: one for the twin, three runs "
        "for a healthy population as well."
    ),
    out: Path = option("Where to write the calibrated actuator (.toml).", ...),
    actuator: str | None = options.RECORDED_ACTUATOR,
    where: list[str] | None = options.WHERE,
    known: list[str] | None = option(
        "Recordings of a known fault in the same files, to name later alarms by, e.g. "
        '"lubrication:condition=dry;run=1,2". Repeatable.'
    ),
    add: Path | None = option(
        "Calibrated actuator (.toml) whose healthy runs these join, such as runs of a "
        "later occasion; one run is enough. Actuator and known faults stay as in it."
    ),
    column: list[str] | None = options.COLUMN,
    map_file: Path | None = options.MAP,
    report: Path | None = options.REPORT,
    force: bool = options.FORCE,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Learn from healthy recordings how an actuator behaves and how far healthy runs differ."""
    from ematwin.models.registry import shipped_actuators
    from ematwin.monitoring.calibration import is_as_written
    from ematwin.recordings.motions import fitting

    check_target(out, (".toml",), replace=force or is_as_written(out))
    options.check_outputs(report)
    before = None if add is None else ematwin.Calibration.load(add)
    template = before.actuator if before is not None else (
        ematwin.load_actuator(actuator or meant(records, column, map_file))
    )  # fmt: skip
    wanted = choice(where or [], "--where")
    taught = [(text, *known_fault(text)) for text in known or []]
    choices = [wanted, *(labels for _, _, labels in taught)]
    recordings = load(records, column, map_file, template, where=choices)
    faults = {
        f"{fault}: {text.partition(':')[2]}": fitting(recordings, labels)
        for text, fault, labels in taught
    }
    with options.progress_bar("Calibrating", not json) as progress:
        found = ematwin.calibrate(
            fitting(recordings, wanted),
            template,
            known=faults or None,
            name=out.stem if template.name in shipped_actuators() else None,  # its own stays
            progress=progress,
            add_to=before,
        )
    found.save(out)
    if report is not None:
        found.report(report)
    assumed, doubtful = remarks(recordings)

    def tell() -> None:
        print_calibration(found, out)
        options.print_notes("Assumed", assumed)
        options.print_notes("Warning", doubtful)

    more = {"out": out, "assumed": assumed, "warnings": doubtful}
    options.answer(json, lambda: {**found.as_dict(), **more}, tell, out, report)


def print_calibration(report: Any, out: Path) -> None:
    """Print fitted parameters, undetermined ones, and the spread of runs; ``out`` was written."""
    from ematwin.report import calibration as page

    shown = page.parameter_table(report)
    if not options.has_room():  # what is not determined is also said below the table
        shown = shown.first(3)
    if shown.rows:
        options.print_table("Parameters", shown, width=110)
    for sentence in (
        *page.forms_sentences(report), *page.open_sentences(report, str(out)),
        page.misfit_sentence(report), *page.spread_sentences(report),
    ):  # fmt: skip
        if sentence:
            typer.echo(sentence)
    options.print_notes("Warning", report.notes)
