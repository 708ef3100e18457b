"""``ematwin compare``: many searches, compared fairly."""

from typing import Any

import typer

import ematwin
from ematwin.cli import complete, options
from ematwin.cli.options import flag, option
from ematwin.errors import InputError


def compare(
    cases: str = option(
        "own: the cases of the kind (bldc: Table 1 of the paper, also called paper); "
        "multi: several random faults at once; or a TOML file.",
        "own",
    ),
    count: int | None = option("Number of cases of --cases multi; 50 if not given."),
    algorithms: str = option(
        "Names from `ematwin algorithms`, separated by commas; paper (the paper's six as "
        "first published), improved (the six, tuned alike) and best stand for several.",
        "paper",
        autocompletion=complete.several_algorithms,
    ),
    runs: int = option("Repetitions of each case and algorithm.", 10),
    population: int = option("Size of the population.", 50),
    iterations: int = option("The budget is population times this.", 200),
    seed: int = option("Seed of the study; all others follow from it.", 1),
    noise: str | None = options.NOISE,
    box: str = option("plain; or remapped, where healthy is not in a corner.", "plain"),
    actuator: str = options.ACTUATOR,
    scenario: str | None = options.SCENARIO,
    store: str = option("SQLite file, or postgresql://user@host/name.", "study.db"),
    workers: int | None = option("Processes on this machine, all cores if not given.", min=1),
    engine: str | None = option("local (default) or dask."),
    scheduler: str | None = option("Address of a Dask scheduler, e.g. tcp://host:8786."),
    time_limit: float | None = option("Seconds after which a run is stopped."),
    patience: float = option(
        "Seconds to wait for workers or a scheduler that are gone, or keep dying.", 60.0, min=0.0
    ),
    retry_failed: bool = flag("--retry-failed", "Repeat failed and timed-out runs."),
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
) -> Any:  # fmt: skip
    from ematwin.numerics.side_by_side import cores

    if time_limit is not None and not 0.0 < time_limit < float("inf"):
        raise InputError(f"--time-limit must be a positive number of s, received {time_limit:g}.")
    name = name or ("local" if scheduler is None else "dask")
    if name == "local" and scheduler is not None:
        raise InputError("--scheduler belongs to --engine dask; leave one of the two out.")
    if name == "local":
        from ematwin.benchmarking.engine import LocalEngine

        return LocalEngine(workers or cores(), time_limit, patience)
    if name == "dask":
        from ematwin.benchmarking.dask import DaskEngine

        if scheduler is not None and workers is not None:
            raise InputError("A scheduler has its own workers; leave --workers out.")
        return DaskEngine(scheduler, workers or cores(), time_limit, patience)
    raise InputError(f"There is no engine {name!r}; choose local or dask.")


def _print(tally: Any, where: str) -> None:
    ended = ", ".join(f"{n} {status}" for status, n in sorted(tally.counts.items()))
    typer.echo(f"{tally.planned} runs in {where}: {ended}.")
    typer.echo(
        f"{tally.finished} of them now, in {tally.seconds:.1f} s; {tally.found} were done before"
        + (f", {tally.elsewhere} came from other processes." if tally.elsewhere else ".")
    )
    if tally.counts.get("done", 0) < tally.planned:
        typer.echo("To repeat failed runs, give the same command with --retry-failed.")
    typer.echo(f"Next: ematwin report {where}")
