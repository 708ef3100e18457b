"""``ematwin compare``: many searches, compared fairly."""

from typing import TYPE_CHECKING

import typer

import ematwin
from ematwin.cli import complete, options
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.benchmarking.engines.base import Engine
    from ematwin.benchmarking.study import Tally


def compare(
    cases: str = typer.Option(
        "own",
        help="own: the cases of the kind (bldc: Table 1 of the paper, also called paper); "
        "multi: several random faults at once; or a TOML file.",
    ),
    count: int | None = typer.Option(
        None, help="Number of cases of --cases multi; 50 if not given."
    ),
    algorithms: str = typer.Option(
        "paper",
        help="Names from `ematwin algorithms`, separated by commas; paper (the paper's six as "
        "first published), improved (the six, tuned alike) and best stand for several.",
        autocompletion=complete.several_algorithms,
    ),
    runs: int = typer.Option(10, help="Repetitions of each case and algorithm."),
    population: int = typer.Option(50, help="Size of the population."),
    iterations: int = typer.Option(200, help="The budget is population times this."),
    seed: int = typer.Option(1, help="Seed of the study; all others follow from it."),
    noise: str | None = options.NOISE,
    box: str = typer.Option("plain", help="plain; or remapped, where healthy is not in a corner."),
    actuator: str = options.ACTUATOR,
    scenario: str | None = options.SCENARIO,
    store: str = typer.Option("study.db", help="SQLite file, or postgresql://user@host/name."),
    workers: int | None = typer.Option(
        None, min=1, help="Processes on this machine, all cores if not given."
    ),
    engine: str | None = typer.Option(None, help="local (default) or dask."),
    scheduler: str | None = typer.Option(
        None, help="Address of a Dask scheduler, e.g. tcp://host:8786."
    ),
    time_limit: float | None = typer.Option(None, help="Seconds after which a run is stopped."),
    patience: float = typer.Option(
        60.0,
        min=0.0,
        help="Seconds to wait for workers or a scheduler that are gone, or keep dying.",
    ),
    retry_failed: bool = typer.Option(
        False, "--retry-failed", help="Repeat failed and timed-out runs."
    ),
    json: bool = options.JSON,
) -> None:
    """Compare search algorithms over fault cases; continue where an earlier call stopped."""
    from ematwin.benchmarking.plan import Plan
    from ematwin.benchmarking.store import Store
    from ematwin.benchmarking.study import run_study
    from ematwin.benchmarking.subject import cases_of

    chosen = ematwin.load_actuator(actuator)
    plan = Plan(
        cases=cases_of(cases, chosen, count=count, seed=seed),
        algorithms=tuple(name.strip() for name in algorithms.split(",") if name.strip()),
        runs=runs, population=population, iterations=iterations, seed=seed,
        noise=ematwin.Noise.of(noise), box=box, actuator=chosen, scenario=scenario,
    )  # fmt: skip
    carrier = _engine(engine, scheduler, workers, time_limit, patience)
    with Store(store) as opened, options.progress_bar("Runs", not json) as show:
        tally = run_study(
            plan, opened, carrier, retry_failed=retry_failed,
            progress=lambda now: show(now.complete / now.planned, f"{now.complete}/{now.planned}"),
        )  # fmt: skip
        where = opened.name
    options.answer(json, lambda: {"store": where, **vars(tally)}, lambda: _print(tally, where))


def _engine(
    name: str | None, scheduler: str | None, workers: int | None, time_limit: float | None,
    patience: float,
) -> "Engine":  # fmt: skip
    from ematwin.numerics.side_by_side import cores

    if time_limit is not None and not 0.0 < time_limit < float("inf"):
        raise InputError(f"--time-limit must be a positive number of s, received {time_limit:g}.")
    name = name or ("local" if scheduler is None else "dask")
    if name == "local" and scheduler is not None:
        raise InputError("--scheduler belongs to --engine dask; leave one of the two out.")
    if name == "local":
        from ematwin.benchmarking.engines.local import LocalEngine

        return LocalEngine(workers or cores(), time_limit, patience)
    if name == "dask":
        from ematwin.benchmarking.engines.dask import DaskEngine

        if scheduler is not None and workers is not None:
            raise InputError("A scheduler has its own workers; leave --workers out.")
        return DaskEngine(scheduler, workers or cores(), time_limit, patience)
    raise InputError(f"There is no engine {name!r}; choose local or dask.")


def _print(tally: "Tally", where: str) -> None:
    ended = ", ".join(f"{n} {status}" for status, n in sorted(tally.counts.items()))
    typer.echo(f"{tally.planned} runs in {where}: {ended}.")
    typer.echo(
        f"{tally.finished} of them now, in {tally.seconds:.1f} s; {tally.found} were done before"
        + (f", {tally.elsewhere} came from other processes." if tally.elsewhere else ".")
    )
    if tally.counts.get("done", 0) < tally.planned:
        typer.echo("To repeat failed runs, give the same command with --retry-failed.")
    typer.echo(f"Next: ematwin report {where}")
