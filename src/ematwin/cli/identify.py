"""``ematwin identify``: a recording in, what it says of its actuator out."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from ematwin.cli import complete
from ematwin.cli.options import numbers, print_json, print_notes, print_table, progress_bar

if TYPE_CHECKING:
    from ematwin.estimation.identify import Identification
    from ematwin.models.parameter_set import ParameterSet
    from ematwin.monitoring.calibration import Calibration
    from ematwin.recordings.gaps import Policy


def identify(
    record: Annotated[
        Path, typer.Argument(help="A recording: Parquet, CSV, MAT, MDF4, TDMS or HDF5.")
    ],
    actuator: Annotated[
        str,
        typer.Option(
            help="A shipped parameter set of any kind, a TOML file, or a calibrated actuator.",
            autocompletion=complete.actuators,
        ),
    ] = "servo48",
    algorithm: Annotated[
        str | None,
        typer.Option(
            help="A name from `ematwin algorithms`; the default method of the kind if not given.",
            autocompletion=complete.algorithms,
        ),
    ] = None,
    budget: Annotated[
        int | None,
        typer.Option(help="Simulations: a maximum for multistart, else exact."),
    ] = None,
    population: Annotated[int, typer.Option(help="Size, for a population method.")] = 50,
    iterations: Annotated[int, typer.Option(help="Number, for a population method.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of the search.")] = 1,
    only: Annotated[
        str | None,
        typer.Option(
            help="Search only these: faults, e.g. friction,backlash, or parameters by their place, "
            "e.g. motor.emf_constant."
        ),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option(help="Hold a fault that is not searched at a value, e.g. gain=0.6."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(help='Which channel is what, e.g. i_a="Phase A [A]". Repeatable.'),
    ] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="The same in a TOML file (docs/recordings.md).")
    ] = None,
    resample_to: Annotated[
        str | None, typer.Option(help='Bring the record to this rate first, e.g. "20 kHz".')
    ] = None,
    gaps: Annotated[
        str, typer.Option(help="Holes in the record: refuse, longest or mask.")
    ] = "refuse",
    checkpoint: Annotated[
        Path | None, typer.Option(help="Keep a population method's state here; resume from it.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write a self-contained page here (.html).")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Find the faults with which the digital twin behaves like the recorded actuator."""
    from ematwin.cli.channels import map_of
    from ematwin.estimation.identify import identify as run
    from ematwin.files import check_target, write_text
    from ematwin.models.reading import read
    from ematwin.monitoring.detect import detect

    if report is not None:
        check_target(report, (".html",))
    chosen, calibration = _loaded(actuator)
    columns = map_of(column, map_file, chosen)
    with progress_bar(f"Reading {record.name}", not json) as progress:
        recordings = read(
            [record], columns, actuator=chosen, resample_to=resample_to, gaps=cast("Policy", gaps),
            split=calibration is not None, progress=progress,
        )  # fmt: skip
    if calibration is not None and len(recordings) > 1:
        from ematwin.cli.detect import answer

        answer(detect(recordings, calibration), recordings, "motion", None, report, json)
        return
    recording = recordings[0]
    with search_bar(not json) as progress_of_search:
        found = run(
            recording,
            chosen,
            algorithm,
            budget=budget,
            population=population,
            iterations=iterations,
            seed=seed,
            only=None if only is None else [name.strip() for name in only.split(",")],
            held=numbers(hold or [], "--hold"),
            checkpoint=checkpoint,
            progress=progress_of_search,
        )
    judged = None if calibration is None else detect([recording], calibration)
    if report is not None:
        from ematwin.report.identification import identification_page

        write_text(report, identification_page(found, recording, judged))
    if json:
        told = {**found.as_dict(), "report": None if report is None else str(report)}
        if judged is not None:
            verdicts = [verdict.as_dict() for verdict in judged.motions]
            told |= {"each": "motion", "verdicts": verdicts}
        print_json(told)
        return
    print_findings(found)
    if judged is not None:
        from ematwin.cli.detect import print_verdicts

        print_verdicts(judged, "motion")
    else:
        typer.echo(
            f"Not calibrated: values are relative to the parameters of {found.actuator.name}. "
            "ematwin calibrate learns those of your actuator from healthy recordings."
        )
    if report is not None:
        typer.echo(f"wrote {report}")


def _loaded(name: str) -> "tuple[ParameterSet, Calibration | None]":
    """The actuator that a name or file means, and its calibration if the file holds one."""
    from ematwin.models.registry import load_actuator
    from ematwin.monitoring.calibration import Calibration
    from ematwin.validation import load_toml

    if name.endswith(".toml") and "calibration" in load_toml(Path(name), "actuator"):
        calibration = Calibration.load(name)
        return calibration.actuator, calibration
    return load_actuator(name), None


@contextmanager
def search_bar(shown: bool) -> Iterator[Callable[[int, float, int], None]]:
    """A live line on standard error: evaluations, best cost, time left."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    with Progress(
        TextColumn("searching"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} simulations"),
        TextColumn("best misfit {task.fields[cost]}"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not (shown and console.is_terminal),
    ) as bar:
        task = bar.add_task("", total=1.0, cost="-")

        def update(evaluations: int, cost: float, budget: int) -> None:
            bar.update(task, completed=evaluations, total=budget, cost=f"{cost:.4g}")

        yield update


def print_findings(found: "Identification") -> None:
    """The table for people."""
    from rich.table import Table

    table = Table(title=f"Faults of {found.actuator.name}", title_justify="left")
    table.add_column("fault")
    for heading in ("k", "standard error", "value", "healthy"):
        table.add_column(heading, justify="right")
    table.add_column("meaning")
    errors = found.standard_error
    for row in found.physical:
        error = errors.get(row.name, math.inf)
        spread = f"{error:.2g}" if math.isfinite(error) else "undetermined"
        table.add_row(
            row.name,
            f"{row.normalised:.4g}",
            spread if row.name in found.searched else "held",
            f"{row.value:.4g} {row.unit}".rstrip(),
            f"{row.healthy:.4g} {row.unit}".rstrip(),
            row.meaning,
            style="bold" if row.name in found.present else None,
        )
    print_table(table, 140)
    typer.echo(
        f"misfit {100.0 * found.relative_misfit:.2f} % ({found.cost:.4g}), "
        f"{found.evaluations} simulations in {found.seconds:.2f} s with {found.algorithm}, "
        f"seed {found.seed}; stopped: {found.stopped}"
    )
    if found.stopped == "interrupted":
        typer.echo("Interrupted: this is the best found so far.")
    print_notes("Assumed", found.assumed)
    print_notes("Warning", found.warnings)
