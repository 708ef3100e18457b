"""``ematwin compare``: many searches, compared fairly."""

from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli import complete, options

if TYPE_CHECKING:
    from ematwin.benchmarking.engines.base import Engine
    from ematwin.benchmarking.study import Tally


def compare(
    cases: Annotated[
        str,
        typer.Option(
            help="own: the cases of the kind (bldc: Table 1 of the paper, also called paper); "
            "multi: several random faults at once; or a TOML file."
        ),
    ] = "own",
    count: Annotated[
        int | None, typer.Option(help="Number of cases of --cases multi; 50 if not given.")
    ] = None,
    algorithms: Annotated[
        str,
        typer.Option(
            help="Names from `ematwin algorithms`, separated by commas; paper (the paper's six as "
            "first published), improved (the six, tuned alike) and best stand for several.",
            autocompletion=complete.several_algorithms,
        ),
    ] = "paper",
    runs: Annotated[int, typer.Option(help="Repetitions of each case and algorithm.")] = 10,
    population: Annotated[int, typer.Option(help="Size of the population.")] = 50,
    iterations: Annotated[int, typer.Option(help="The budget is population times this.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of the study; all others follow from it.")] = 1,
    noise: options.NoiseOption = None,
    box: Annotated[
        str, typer.Option(help="plain; or remapped, where healthy is not in a corner.")
    ] = "plain",
    actuator: options.ActuatorOption = "servo48",
    scenario: options.ScenarioOption = None,
    store: Annotated[
        str, typer.Option(help="SQLite file, or postgresql://user@host/name.")
    ] = "study.db",
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes on this machine, all cores if not given.",
        ),
    ] = None,
    engine: Annotated[
        str | None,
        typer.Option(help="local (default) or dask."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, e.g. tcp://host:8786.")
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds after which a run is stopped.")
    ] = None,
    patience: Annotated[
        float,
        typer.Option(
            min=0.0, help="Seconds to wait for workers or a scheduler that are gone, or keep dying."
        ),
    ] = 60.0,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Repeat failed and timed-out runs.")
    ] = False,
    json: options.JsonOption = False,
) -> None:
    """Compare search algorithms over fault cases; continue where an earlier call stopped."""
    from ematwin import Noise, load_actuator
    from ematwin.benchmarking.plan import Plan
    from ematwin.benchmarking.store import Store
    from ematwin.benchmarking.study import run_study
    from ematwin.benchmarking.subject import cases_of

    chosen = load_actuator(actuator)
    plan = Plan(
        cases=cases_of(cases, chosen, count=count, seed=seed),
        algorithms=tuple(name.strip() for name in algorithms.split(",") if name.strip()),
        runs=runs,
        population=population,
        iterations=iterations,
        seed=seed,
        noise=None if noise is None else Noise.parse(noise),
        box=box,
        actuator=chosen,
        scenario=scenario,
    )
    carrier = _engine(engine, scheduler, workers, time_limit, patience)
    with Store(store) as opened, options.progress_bar("Runs", not json) as show:
        tally = run_study(
            plan, opened, carrier, retry_failed=retry_failed,
            progress=lambda now: show(now.complete / now.planned, f"{now.complete}/{now.planned}"),
        )  # fmt: skip
        where = opened.name
    options.answer(json, lambda: {"store": where, **vars(tally)}, lambda: _print(tally, where))


def _engine(
    name: str | None,
    scheduler: str | None,
    workers: int | None,
    time_limit: float | None,
    patience: float,
) -> "Engine":
    from ematwin.errors import InputError
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
