"""``ematwin identify``: recordings in, faults of their actuator out."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import complete, options
from ematwin.cli.detect import answer
from ematwin.cli.options import argument, option
from ematwin.cli.recordings import constant_load, gathered, meant
from ematwin.errors import InputError
from ematwin.showing.text import with_interval


def identify(
    records: list[Path] = argument(
        "A recording (docs/formats.md). Of several, of a folder, or of a table of runs "
        "(docs/recordings.md), a table of verdicts."
    ),
    actuator: str | None = options.RECORDED_ACTUATOR,
    algorithm: str | None = option(
        "A name from `ematwin algorithms`; the default method of the kind if not given.",
        autocompletion=complete.algorithms,
    ),
    budget: int | None = option("Simulations: a maximum for multistart, else exact."),
    population: int = option("Size, for a population method.", 50),
    iterations: int = option("Number, for a population method.", 200),
    seed: int = option("Seed of the search.", 1),
    only: str | None = option(
        "Search only these: faults, e.g. friction,backlash, or parameters by their place, "
        "e.g. motor.emf_constant."
    ),
    hold: list[str] | None = option("Hold a fault that is not searched at a value, e.g. gain=0.6."),
    column: list[str] | None = options.COLUMN,
    map_file: Path | None = options.MAP,
    resample_to: str | None = option('Bring the record to this rate first, e.g. "20 kHz".'),
    gaps: str = option("Holes in the record: refuse, longest or mask.", "refuse"),
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

    options.check_outputs(report, table)
    failing = options.grades(fail_on)

    def twin(given: Any, first: Path) -> ematwin.Calibration:
        return ematwin.Calibration.of(given or meant([first], column, map_file))

    with options.progress_bar(f"Reading {records[0].name}", not json) as progress:
        recordings, known = gathered(
            records, actuator, column, map_file, twin, resample_to=resample_to, gaps=gaps,
            progress=progress,
        )  # fmt: skip
    settings: dict[str, Any] = {
        "budget": budget, "population": population, "iterations": iterations, "seed": seed,
        "only": None if only is None else [name.strip() for name in only.split(",")],
        "held": options.numbers(hold or [], "--hold"), "checkpoint": checkpoint,
        "load": constant_load(load, known.actuator), "exact": exact, "uncertainty": uncertainty,
        "thresholds": options.pairs(threshold or [], "--threshold"),
    }  # fmt: skip
    alone = isinstance(recordings, list) and len(records) == len(recordings) == 1
    if not (alone and is_one(records[0])):
        with options.progress_bar("Judging", not json) as show:
            judged = ematwin.identify(
                recordings, known, algorithm, **settings,
                progress=lambda done, cost, count: show(done / count),
            )  # fmt: skip
        answer(judged, recordings, "motion", table, report, json, failing)
        return
    if table is not None:
        raise InputError("--table is of several recordings; give more, or a folder.")
    with options.progress_bar("searching", not json) as show:
        # given away, so that what was sampled faster than it is compared can be freed
        found = ematwin.identify(
            recordings.pop(), known, algorithm, **settings,
            progress=options.searching(show, "simulations", "misfit"),
        )  # fmt: skip
    if report is not None:
        found.report(report)

    def tell() -> None:
        print_findings(found)
        if not found.calibrated:
            typer.echo(
                f"Not calibrated: {found.actuator.name} is known as far as its tolerances go. "
                "ematwin calibrate learns your actuator from healthy recordings."
            )

    options.answer(
        json, lambda: {**found.as_dict(), "report": report}, tell, report,
        fails=found.verdict.grade in failing,
    )  # fmt: skip


def print_findings(found: "ematwin.Identification") -> None:
    """The verdict, then the table for people."""
    from ematwin.estimation.identification import fault_cells
    from ematwin.report.identification import uncertainty_table
    from ematwin.report.page import Row, Table

    typer.echo(f"{found.verdict.sentence}\n")
    header = ["fault", "value", "95 % interval", "healthy", "k", "meaning"]
    rows = [
        Row([r.name, r.value, r.interval, r.healthy, r.k, r.meaning], r.name in found.present)
        for r in fault_cells(found)
    ]
    shown = Table(header, rows, texts=(-1,))
    title, values = f"Faults of {found.actuator.name}", shown.first(5)
    options.print_table(title, shown if options.has_room() else values, whole=values.header)
    for one in found.model.contrasts(found.actuator):
        if one.name in found.contrasts:
            value, (low, high) = found.contrasts[one.name]
            number, between = with_interval(value, low, high)
            typer.echo(f"{one.meaning}: {number} ({between})")
    typer.echo(
        f"misfit {100.0 * found.relative_misfit:.2f} % ({found.cost:.4g}), "
        f"{found.effort}, seed {found.seed}; stopped: {found.stopped}"
    )
    if found.stopped == "interrupted":
        typer.echo("Interrupted: this is the best found so far.")
    if (sure := found.uncertainty) is not None:
        options.print_table(f"95 % by {sure.method}", uncertainty_table(sure))
        for sentence in sure.sentences:
            typer.echo(sentence)
        options.print_notes("Doubt", sure.doubts)
    options.print_notes("Assumed", found.assumed)
    options.print_notes("Warning", found.warnings)
