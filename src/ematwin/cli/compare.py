"""``ematwin compare``: many searches, compared fairly."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli.options import print_json

if TYPE_CHECKING:
    from ematwin.study.compare import Progress, Tally
    from ematwin.study.engines.base import Engine


def compare(
    cases: Annotated[
        str, typer.Option(help="paper (Table 1), multi (several random faults), or a TOML file.")
    ] = "paper",
    count: Annotated[
        int | None, typer.Option(help="Cases of --cases multi; 50 if not given.")
    ] = None,
    algorithms: Annotated[
        str, typer.Option(help="multistart, or names of `ematwin algorithms`, with commas.")
    ] = "ga,pso,de,gwo,da,woa",
    runs: Annotated[int, typer.Option(help="Repetitions of each case and algorithm.")] = 10,
    population: Annotated[int, typer.Option(help="Of the population methods.")] = 50,
    iterations: Annotated[int, typer.Option(help="Population times iterations: budget.")] = 200,
    seed: Annotated[int, typer.Option(help="Of the study; all other seeds follow from it.")] = 1,
    noise: Annotated[
        str | None, typer.Option(help="Current sensor of the records, e.g. white=0.02,bits=12.")
    ] = None,
    box: Annotated[
        str, typer.Option(help="plain; or remapped, where healthy lies nowhere special.")
    ] = "plain",
    actuator: Annotated[
        str, typer.Option(help="A shipped parameter set, or a TOML file.")
    ] = "servo48",
    scenario: Annotated[
        str, typer.Option(help="A shipped scenario, or a TOML, CSV or Parquet file.")
    ] = "default",
    store: Annotated[
        str, typer.Option(help="SQLite file, or postgresql://user@host/name.")
    ] = "study.db",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; all cores if not given.")
    ] = None,
    engine: Annotated[str | None, typer.Option(help="local or dask.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Of a Dask cluster, e.g. tcp://host:8786.")
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds after which a run is given up.")
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Do failed and timed-out runs again.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Compare search algorithms over fault cases; go on where an earlier call was stopped."""
    from ematwin import Actuator, Noise, Scenario
    from ematwin.study.cases import cases_of
    from ematwin.study.compare import compare as run
    from ematwin.study.plan import Plan
    from ematwin.study.store import Store

    plan = Plan(
        cases=cases_of(cases, count=count, seed=seed),
        algorithms=tuple(name.strip() for name in algorithms.split(",") if name.strip()),
        runs=runs,
        population=population,
        iterations=iterations,
        seed=seed,
        noise=None if noise is None else Noise.parse(noise),
        box=box,
        actuator=Actuator.load(actuator),
        scenario=Scenario.load_file(scenario),
    )
    carrier = _engine(engine, scheduler, workers, time_limit)
    with Store(store) as opened, _shown(not json) as progress:
        tally = run(plan, opened, carrier, retry_failed=retry_failed, progress=progress)
        where = opened.name
    if json:
        print_json({"store": where, **vars(tally)})
        return
    _print(tally, where)


def _engine(
    name: str | None, scheduler: str | None, workers: int | None, time_limit: float | None
) -> "Engine":
    from ematwin.errors import InputError

    if time_limit is not None and not 0.0 < time_limit < float("inf"):
        raise InputError(f"--time-limit must be a positive number of s, received {time_limit:g}.")
    name = name or ("local" if scheduler is None else "dask")
    if name == "local":
        from ematwin.study.engines.local import LocalEngine

        if scheduler is not None:
            raise InputError("--scheduler belongs to --engine dask; leave one of the two out.")
        return LocalEngine(workers or os.cpu_count() or 1, time_limit)
    if name == "dask":
        from ematwin.study.engines.dask import DaskEngine

        if scheduler is not None and workers is not None:
            raise InputError("A scheduler has its own workers; leave --workers out.")
        return DaskEngine(scheduler, workers or os.cpu_count() or 1, time_limit)
    raise InputError(f"There is no engine {name!r}; choose local or dask.")


@contextmanager
def _shown(shown: bool) -> Iterator["Progress"]:
    """A bar on standard error with the time left."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("left"), TimeRemainingColumn(elapsed_when_finished=False),
    )  # fmt: skip
    with Progress(
        *columns,
        console=console,
        transient=True,
        disable=not (shown and console.is_terminal),
        speed_estimate_period=600.0,
    ) as bar:
        task = bar.add_task("Runs", total=None)

        def update(tally: "Tally") -> None:
            bar.update(task, completed=tally.complete, total=tally.planned)

        yield update


def _print(tally: "Tally", where: str) -> None:
    ended = ", ".join(f"{n} {status}" for status, n in sorted(tally.counts.items()))
    typer.echo(f"{tally.planned} runs in {where}: {ended}.")
    typer.echo(
        f"{tally.finished} of them now, in {tally.seconds:.1f} s; {tally.found} were there before"
        + (f", {tally.elsewhere} came from other processes." if tally.elsewhere else ".")
    )
    if tally.counts.get("done", 0) < tally.planned:
        typer.echo("To do again those that did not end well: the same command and --retry-failed")
    typer.echo(f"Next: ematwin report {where}")
