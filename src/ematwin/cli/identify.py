"""``ematwin identify``: a recording in, eight fault magnitudes out."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ematwin.cli.options import numbers, print_json, print_table, progress_bar

if TYPE_CHECKING:
    from ematwin.identification.identify import Identification


def identify(
    record: Annotated[
        Path, typer.Argument(help="A recording: Parquet, CSV, MAT, MDF4, TDMS or HDF5.")
    ],
    actuator: Annotated[
        str, typer.Option(help="A shipped parameter set, or a TOML file.")
    ] = "servo48",
    algorithm: Annotated[
        str, typer.Option(help="multistart, or a name of `ematwin algorithms`.")
    ] = "multistart",
    budget: Annotated[
        int | None, typer.Option(help="Simulations: the most for multistart, else exactly.")
    ] = None,
    population: Annotated[int, typer.Option(help="Of a population method.")] = 50,
    iterations: Annotated[int, typer.Option(help="Of a population method.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of the search.")] = 1,
    only: Annotated[
        str | None, typer.Option(help="Search these faults only, e.g. friction,backlash.")
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
        Path | None, typer.Option("--map", help="The same as a TOML file (docs/recordings.md).")
    ] = None,
    resample_to: Annotated[
        str | None, typer.Option(help='Bring the record to this rate first, e.g. "20 kHz".')
    ] = None,
    gaps: Annotated[
        str, typer.Option(help="Holes in the record: refuse, longest or mask.")
    ] = "refuse",
    checkpoint: Annotated[
        Path | None, typer.Option(help="Keep a population method's state here, and go on from it.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write a self-contained page here (.html).")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Find the faults with which the digital twin answers as the recorded actuator did."""
    from ematwin.errors import InputError
    from ematwin.identification.identify import identify as run
    from ematwin.plant.kinds import kind_of
    from ematwin.plant.parameters import Actuator
    from ematwin.readers.column_map import ColumnMap
    from ematwin.readers.files import check_target, write_text
    from ematwin.readers.records import read

    if report is not None:
        check_target(report, (".html",))
    if kind_of(actuator) == "ball-screw":
        given = (algorithm, budget, population, iterations, seed, gaps)
        others = (only, hold, map_file, checkpoint, resample_to)
        if given != ("multistart", None, 50, 200, 1, "refuse") or any(others):
            raise InputError(
                f"{actuator} is a ball-screw actuator, whose magnitudes are fitted to each motion; "
                "of the options only --column, --report and --json apply."
            )
        if not actuator.endswith(".toml"):
            raise InputError(
                f"{actuator} is a template; its healthy actuator has to be learnt first. Run "
                f"ematwin calibrate with --actuator {actuator}, and give what it writes."
            )
        from ematwin.cli.detect import detect

        detect([record], Path(actuator), "motion", None, column, report, None, json)
        return
    chosen = Actuator.load(actuator)
    columns: Any = None
    if map_file is not None or column:
        base = None if map_file is None else ColumnMap.of(map_file)
        columns = ColumnMap.parse(column or [], base)
    with progress_bar(f"Reading {record.name}") as progress:
        recording = read(record, columns, resample_to=resample_to, gaps=gaps, progress=progress)  # type: ignore[arg-type]
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
    if report is not None:
        from ematwin.report.identification import identification_page

        write_text(report, identification_page(found, recording))
    if json:
        print_json({**found.as_dict(), "report": None if report is None else str(report)})
        return
    print_findings(found)
    if report is not None:
        typer.echo(f"wrote {report}")


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
            bar.update(task, completed=evaluations, total=budget, cost=f"{cost:.4g} A s")

        yield update


def print_findings(found: "Identification") -> None:
    """The table for people."""
    from rich.table import Table

    from ematwin.faults import FAULTS, HEALTHY

    table = Table(title=f"Faults of {found.actuator.name}", title_justify="left")
    table.add_column("fault")
    for heading in ("k", "standard error", "value", "healthy"):
        table.add_column(heading, justify="right")
    table.add_column("meaning")
    for row in found.faults.physical(found.actuator):
        searched = row.name in found.searched
        error = found.standard_error.get(row.name, math.inf)
        spread = f"{error:.4f}" if math.isfinite(error) else "undetermined"
        away = abs(row.normalised - HEALTHY[FAULTS.index(row.name)]) >= 0.02
        table.add_row(
            row.name,
            f"{row.normalised:.4f}",
            spread if searched else "held",
            f"{row.value:.4g} {row.unit}".rstrip(),
            f"{row.healthy:.4g} {row.unit}".rstrip(),
            row.meaning,
            style="bold" if away else None,
        )
    print_table(table, 140)
    typer.echo(
        f"misfit {100.0 * found.relative_misfit:.2f} % of the current ({found.cost:.4g} A s), "
        f"{found.evaluations} simulations in {found.seconds:.2f} s with {found.algorithm}, "
        f"seed {found.seed}; stopped: {found.stopped}"
    )
    if found.stopped == "interrupted":
        typer.echo("Interrupted: this is the best found until then.")
    for warning in found.warnings:
        typer.echo(f"Warning: {warning}")
