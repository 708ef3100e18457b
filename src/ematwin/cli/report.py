"""``ematwin report`` and ``ematwin store``: the runs of a study in, their analysis out."""

from pathlib import Path

import typer

import ematwin
from ematwin.cli import options
from ematwin.cli.options import argument, flag, option
from ematwin.errors import InputError

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
    seed: int = option("Seed of the bootstrap.", 1),
    json: bool = flag("--json", "Answer with all tables as JSON."),
) -> None:
    """Report a study: errors, times, ranks, tests, convergence and diagnosis, from its store."""
    from ematwin.benchmarking.analysis import analyse
    from ematwin.benchmarking.convergence import STATED_MISFITS
    from ematwin.benchmarking.page import check_folder, write_report
    from ematwin.benchmarking.statistics import TARGETS
    from ematwin.benchmarking.store import open_store
    from ematwin.benchmarking.table import check_extra

    if seed < 0:
        raise InputError(f"--seed must not be negative, received {seed}.")
    check_extra()
    if out is not None:
        check_folder(out)
    with open_store(store) as opened:
        analysis = analyse(
            opened.runs(),
            targets=tuple(sorted(set(target))) if target else TARGETS,
            misfits=tuple(sorted(set(misfit), reverse=True)) if misfit else STATED_MISFITS,
            threshold=threshold,
            seed=seed,
        )
    files = [] if out is None else write_report(analysis, out)
    written = None if out is None else {"folder": out, "files": files}

    def tell() -> None:
        _print_summary(analysis)
        if out is not None:
            typer.echo(f"wrote {out / 'index.html'} and {len(files) - 1} more files")

    options.answer(json, lambda: {**analysis.as_dict(), "report": written}, tell)


def _print_summary(analysis: "ematwin.StudyAnalysis") -> None:
    from ematwin.benchmarking.page import diagnosis_table, success_table

    options.print_table("Share of runs that reached an Err%", success_table(analysis), width=140)
    title = f"Diagnosis at {analysis.threshold:g}"
    options.print_table(title, diagnosis_table(analysis), width=140)
    for sentence in analysis.conclusions:
        typer.echo(f"- {sentence}")


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
    options.answer(json, lambda: plain, lambda: typer.echo(told))
