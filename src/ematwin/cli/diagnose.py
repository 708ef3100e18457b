"""``ematwin calibrate``, ``identify`` and ``detect``: recordings in, actuator or verdicts out."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, option
from ematwin.errors import InputError
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
    gaps: str = options.GAPS,
    report: Path | None = options.REPORT,
    force: bool = options.FORCE,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Learn from healthy recordings how an actuator behaves and how far healthy runs differ."""
    from ematwin.models.registry import shipped_actuators
    from ematwin.monitoring.calibration import is_as_written
    from ematwin.recordings.read import fitting
    from ematwin.report import calibration as page

    check_target(out, (".toml",), replace=force or is_as_written(out))
    before = None if add is None else ematwin.Calibration.load(add)
    if before is not None:
        template = before.actuator
    else:
        template = ematwin.load_actuator(actuator or options.meant(records, column, map_file))
    wanted = options.choice(where or [], "--where")
    taught = {
        f"{fault}: {text.partition(':')[2]}": labels
        for text in known or [] for fault, labels in [options.known_fault(text)]
    }  # fmt: skip
    columns = options.map_of(column, map_file, template)
    chosen = [wanted, *taught.values()]
    recordings = options.load(records, columns, template, where=chosen, gaps=gaps)
    faults = {name: fitting(recordings, labels) for name, labels in taught.items()}
    name = out.stem if template.name in shipped_actuators() else None  # its own stays
    found = ematwin.calibrate(
        fitting(recordings, wanted), template, known=faults or None, name=name,
        progress=not json, add_to=before,
    )  # fmt: skip
    assumed, doubtful = options.remarks(recordings)

    def tell() -> None:
        shown = page.parameter_table(found)
        if not answers.has_room():  # what is not determined is also said below the table
            shown = shown.first(3)
        if shown.rows:
            answers.print_table("Parameters", shown, width=110)
        sentences = [*page.forms_sentences(found), *page.open_sentences(found, str(out))]
        sentences += [page.misfit_sentence(found), *page.spread_sentences(found)]
        for sentence in filter(None, sentences):
            typer.echo(sentence)
        answers.print_notes("Warning", found.notes)
        answers.print_notes("Assumed", assumed)
        answers.print_notes("Warning", doubtful)

    more = {"out": out, "assumed": assumed, "warnings": doubtful}
    files = (out, found.save), (report, found.report)
    answers.give(json, lambda: {**found.as_dict(), **more}, tell, *files)


def identify(
    records: list[Path] = argument(
        "A recording (docs/formats.md). Of several, of a folder, or of a table of runs "
        "(docs/recordings.md), a table of verdicts."
    ),
    actuator: str | None = options.RECORDED_ACTUATOR,
    algorithm: str | None = option(
        "A name from `ematwin algorithms`; the default method of the kind if not given.",
        autocompletion=options.ALGORITHMS,
    ),
    budget: int | None = option("Simulations: a maximum for multistart, else exact."),
    population: int = option("Size, for a population method.", 50),
    iterations: int = option("Number, for a population method.", 200),
    seed: int = option("Seed of the search.", 1),
    only: str | None = option(
        "Search only these: faults, e.g. friction,backlash, or parameters by their place, "
        "e.g. motor.emf_constant."
    ),
    hold: list[str] | None = option("Hold a fault at a value and do not search it, e.g. gain=0.6."),
    column: list[str] | None = options.COLUMN,
    map_file: Path | None = options.MAP,
    resample_to: str | None = option('Bring the record to this rate first, e.g. "20 kHz".'),
    gaps: str = options.GAPS,
    load: str | None = options.LOAD,
    exact: bool = options.EXACT,
    uncertainty: str | None = option(
        "How sure the answer is: laplace, profile or posterior (docs/certainty.md)."
    ),
    threshold: list[str] | None = option(
        'Size from which a fault matters, e.g. friction=0.2 or friction="0.04 N*m": '
        "adds the probability that the fault is larger. Repeatable."
    ),
    checkpoint: Path | None = option("Keep a population method's state here; resume from it."),
    report: Path | None = options.REPORT,
    table: Path | None = options.TABLE,
    fail_on: str | None = options.FAIL,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Find the faults with which the digital twin behaves like the recorded actuator."""
    from ematwin.monitoring.runs import is_one

    failing = options.grades(fail_on)

    def twin(given: Any, first: Path) -> ematwin.Calibration:
        return ematwin.Calibration.of(given or options.meant([first], column, map_file))

    with answers.progress_bar(f"Reading {records[0].name}", not json) as progress:
        recordings, known = options.gathered(
            records, actuator, column, map_file, twin, resample_to=resample_to, gaps=gaps,
            progress=progress,
        )  # fmt: skip
    settings: dict[str, Any] = {
        "budget": budget, "population": population, "iterations": iterations, "seed": seed,
        "only": None if only is None else [name.strip() for name in only.split(",")],
        "held": options.numbers(hold or [], "--hold"), "checkpoint": checkpoint,
        "load": options.constant_load(load, known.actuator), "exact": exact,
        "thresholds": options.pairs(threshold or [], "--threshold"), "uncertainty": uncertainty,
        "progress": not json,
    }  # fmt: skip
    alone = isinstance(recordings, list) and len(records) == len(recordings) == 1
    if not (alone and is_one(records[0])):
        judged = ematwin.identify(recordings, known, algorithm, **settings)
        _give_verdicts(judged, recordings, "motion", table, report, json, failing)
        return
    if table is not None:
        raise InputError("--table is of several recordings; give more, or a folder.")
    # given away, so that what was sampled faster than it is compared can be freed
    found = ematwin.identify(recordings.pop(), known, algorithm, **settings)

    def tell() -> None:
        print_findings(found)
        if not found.calibrated:
            typer.echo(
                f"Not calibrated: {found.actuator.name} is known as far as its tolerances go. "
                "ematwin calibrate learns your actuator from healthy recordings."
            )

    fails = found.verdict.grade in failing
    plain, file = (lambda: {**found.as_dict(), "report": report}), (report, found.report)
    answers.give(json, plain, tell, file, fails=fails)


def print_findings(found: "ematwin.Identification") -> None:
    """The verdict, then the table for people."""
    from ematwin.estimation.identification import fault_cells
    from ematwin.report.identification import uncertainty_table
    from ematwin.report.page import Row, Table

    typer.echo(f"{answers.for_shell(found.verdict.sentence)}\n")
    header = ["fault", "value", "95 % interval", "healthy", "k", "meaning"]
    rows = [
        Row([r.name, r.value, r.interval, r.healthy, r.k, r.meaning], r.name in found.present)
        for r in fault_cells(found)
    ]
    shown = Table(header, rows, texts=(-1,))
    title, values = f"Faults of {found.actuator.name}", shown.first(5)
    answers.print_table(title, shown if answers.has_room() else values, whole=values.header)
    for one in found.model.contrasts(found.actuator):
        if one.name in found.contrasts:
            value, ends = found.contrasts[one.name]
            number, between = one.said(found.actuator, value, *ends)
            typer.echo(f"{one.meaning}: {number} ({between})")
    misfit = f"misfit {100.0 * found.relative_misfit:.2f} % ({found.cost:.4g})"
    typer.echo(f"{misfit}, {found.effort}, seed {found.seed}; stopped: {found.stopped}")
    if found.stopped == "interrupted":
        typer.echo("Interrupted: this is the best found so far.")
    if (sure := found.uncertainty) is not None:
        answers.print_table(f"95 % by {sure.method}", uncertainty_table(sure))
        for sentence in sure.sentences:
            typer.echo(answers.for_shell(sentence))
        answers.print_notes("Doubt", sure.doubts)
    answers.print_notes("Assumed", found.assumed)
    answers.print_notes("Warning", found.warnings)


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
    gaps: str = options.GAPS,
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
    failing = options.grades(fail_on)
    wanted = options.choice(where or [], "--where")

    def calibrated(given: Path | None, _: Path) -> ematwin.Calibration:
        if given is None:
            raise InputError(
                "detect needs a calibrated actuator; give the file of ematwin calibrate with "
                "--actuator, or a table of runs that names one in each row."
            )
        return ematwin.Calibration.load(given)

    recordings, known = options.gathered(
        records, actuator, column, map_file, calibrated, where=[wanted] if wanted else None,
        gaps=gaps,
    )  # fmt: skip
    given = options.constant_load(load, known.actuator)
    judge = known if isinstance(recordings, list) else None  # else each run's own
    found = ematwin.detect(recordings, judge, load=given, progress=not json)
    _give_verdicts(found, recordings, each, table, report, json, failing)


def _give_verdicts(
    found: Any, recordings: Any, each: str, table: Path | None,
    report: Path | None, json: bool, failing: set[str],
) -> None:  # fmt: skip
    """Write table and page if they are wanted, and print the verdicts with assumptions."""
    from ematwin.recordings.tables import write_rows

    assumed, doubtful = options.remarks(getattr(recordings, "recordings", recordings))

    def plain() -> dict[str, object]:
        told, always = [], dict.fromkeys(("distance", "load_N", "sensor_coupling"))
        for name, known in found.calibrations.items():
            actuator = {"actuator": known.actuator.name, "kind": known.actuator.kind}
            verdicts = [{**always, **one.as_dict()} for one in found[name].each(each)]
            told.append({**({"name": name} if name else {}), **actuator, "verdicts": verdicts})
        more = {"each": each, "not_judged": found.missing, "report": report}
        more |= {"assumed": assumed, "warnings": doubtful}
        return ({"actuators": told} if found.is_named else told[0]) | more

    def tell() -> None:
        _print_verdicts(found, each)
        answers.print_notes("Assumed", assumed)
        answers.print_notes("Warning", doubtful)

    fails = any(one.grade in failing for one in found.each(each))
    files = (table, lambda path: write_rows(path, found.rows(each))), (report, found.report)
    answers.give(json, plain, tell, *files, fails=fails)


def _print_verdicts(found: Any, each: str) -> None:
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
    answers.print_table("", verdict_table(rows, what, list(telling)), width=200)
    if found.by_run and not found.is_named:
        typer.echo(counted(found.motions, "motions"))
    typer.echo(answers.for_shell(found.sentence))
    answers.print_notes("Why", gathered_reasons(rows))
    answers.print_notes("Note", gathered_notes(rows))
