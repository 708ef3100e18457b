"""``ematwin compare``, ``report`` and ``store``: many searches compared fairly, and their runs."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, flag, option
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
        autocompletion=options.several_algorithms,
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
    with Store(store) as opened, answers.progress_bar("Runs", not json) as show:
        where = opened.name
        tally = run_study(
            plan, opened, carrier, retry_failed=retry_failed,
            progress=lambda now: show(now.complete / now.planned, f"{now.complete}/{now.planned}"),
        )  # fmt: skip

    def tell() -> None:
        ended = ", ".join(f"{n} {status}" for status, n in sorted(tally.counts.items()))
        others = f", {tally.elsewhere} came from other processes" if tally.elsewhere else ""
        typer.echo(f"{tally.planned} runs in {where}: {ended}.")
        now = f"{tally.finished} of them now, in {tally.seconds:.1f} s"
        typer.echo(f"{now}; {tally.found} were done before{others}.")
        if tally.counts.get("done", 0) < tally.planned:
            typer.echo("To repeat failed runs, give the same command with --retry-failed.")
        typer.echo(f"Next: ematwin report {where}")

    answers.give(json, lambda: {"store": where, **vars(tally)}, tell)


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


WHERE = argument("The store of `ematwin compare`: a file or a database URL.")
store = typer.Typer(help="Check the store of a study.", no_args_is_help=True, rich_markup_mode=None)


def report(
    store: str = WHERE,
    out: Path | None = option("Write a page, and the tables as CSV and Parquet, to this folder."),
    target: list[float] | None = option(
        "Err% to give success rates for. Repeatable; default 0.5, 1, 2, 5."
    ),
    misfit: list[float] | None = option(
        "Relative misfit to give the evaluations to. Repeatable; default 0.1, 0.02, 0.005."
    ),
    threshold: float = option(
        "Deviation from healthy that counts as a fault, as a share of the range.", 0.05
    ),
    seed: int = option("Seed of the bootstrap.", 1, min=0),
    json: bool = flag("--json", "Answer with all tables as JSON."),
) -> None:
    """Report a study: errors, times, ranks, tests, convergence and diagnosis, from its store."""
    from ematwin.benchmarking import page
    from ematwin.benchmarking.analysis import analyse
    from ematwin.benchmarking.store import open_store
    from ematwin.benchmarking.table import check_extra

    check_extra()
    settings: dict[str, Any] = {"threshold": threshold, "seed": seed}
    if target:
        settings["targets"] = tuple(sorted(set(target)))
    if misfit:
        settings["misfits"] = tuple(sorted(set(misfit), reverse=True))
    with open_store(store) as opened:
        analysis = analyse(opened.runs(), **settings)
    files = [] if out is None else page.write_report(analysis, out)
    written = None if out is None else {"folder": out, "files": files}

    def tell() -> None:
        reached, diagnosed = page.success_table(analysis), page.diagnosis_table(analysis)
        answers.print_table("Share of runs that reached an Err%", reached, width=140)
        answers.print_table(f"Diagnosis at {analysis.threshold:g}", diagnosed, width=140)
        for sentence in analysis.conclusions:
            typer.echo(f"- {sentence}")
        if out is not None:
            typer.echo(f"wrote {out / 'index.html'} and {len(files) - 1} more files")

    answers.give(json, lambda: {**analysis.as_dict(), "report": written}, tell)


@store.callback()
def stores() -> None:
    """Check the store of a study."""


@store.command("check")
def check(store: str = WHERE, json: bool = options.JSON) -> None:
    """Verify every run of a store by its checksum."""
    from ematwin.benchmarking.store import open_store

    with open_store(store) as opened:
        count = sum(1 for _ in opened.runs())
    told = f"{store}: {count} runs, all as they were written."
    plain = {"store": store, "runs": count, "damaged": []}
    answers.give(json, lambda: plain, lambda: typer.echo(told))
