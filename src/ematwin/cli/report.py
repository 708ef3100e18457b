"""``ematwin report``: the runs of a study in, a page, tables and figures out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ematwin.cli.options import print_json, print_table
from ematwin.errors import InputError

if TYPE_CHECKING:
    from ematwin.comparison.analysis.study import StudyAnalysis


def report(
    store: Annotated[
        str, typer.Argument(help="The store of `ematwin compare`: a file or a database URL.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Write page, CSV, LaTeX tables and SVG figures to this folder."),
    ] = None,
    slim: Annotated[
        bool,
        typer.Option("--slim", help="Static figures on the page, without a library that draws."),
    ] = False,
    ioh: Annotated[
        Path | None, typer.Option(help="Export the runs for IOHanalyzer to this new folder.")
    ] = None,
    target: Annotated[
        list[float] | None,
        typer.Option(help="Err% to give success rates for. Repeatable; default 0.5, 1, 2, 5."),
    ] = None,
    misfit: Annotated[
        list[float] | None,
        typer.Option(
            help="Relative misfit to give the evaluations to. Repeatable; default 0.1, 0.02, 0.005."
        ),
    ] = None,
    threshold: Annotated[
        float,
        typer.Option(
            help="Deviation from healthy that counts as a fault, as a share of the range."
        ),
    ] = 0.05,
    seed: Annotated[int, typer.Option(help="Seed of the bootstrap.")] = 1,
    json: Annotated[bool, typer.Option("--json", help="Answer with all tables as JSON.")] = False,
) -> None:
    """Report a study: errors, times, ranks, tests, convergence and diagnosis, from its store."""
    from ematwin.comparison.analysis.convergence import STATED_MISFITS
    from ematwin.comparison.analysis.study import analyse
    from ematwin.comparison.analysis.summary import TARGETS
    from ematwin.comparison.study.store import open_store

    if seed < 0:
        raise InputError(f"--seed must not be negative, received {seed}.")
    if out is not None:
        from ematwin.comparison.report.study_folder import check_folder

        check_folder(out)
    with open_store(store) as opened:
        analysis = analyse(
            opened.runs(),
            targets=tuple(sorted(set(target))) if target else TARGETS,
            misfits=tuple(sorted(set(misfit), reverse=True)) if misfit else STATED_MISFITS,
            threshold=threshold,
            seed=seed,
        )
        exported = None
        if ioh is not None:
            from ematwin.comparison.analysis.ioh import export_ioh

            exported = export_ioh(opened.runs(), ioh, analysis.table.cases)
    files: list[str] = []
    if out is not None:
        from ematwin.comparison.report.study_folder import write_report

        files = write_report(analysis, out, slim=slim)
    if json:
        answer = analysis.as_dict()
        answer["report"] = None if out is None else {"folder": str(out), "files": files}
        answer["ioh"] = exported and {
            "folder": str(ioh), "written": exported[0], "without_history": exported[1]
        }  # fmt: skip
        print_json(answer)
        return
    print_summary(analysis)
    if exported is not None:
        left = f"; {exported[1]} had no history to export" if exported[1] else ""
        typer.echo(f"wrote {exported[0]} runs to {ioh}{left}")
    if out is not None:
        typer.echo(f"wrote {out / 'index.html'} and {len(files) - 1} more files")


def print_summary(analysis: "StudyAnalysis") -> None:
    """Success rates and conclusions, for people."""
    from rich.table import Table

    from ematwin.comparison.report.study_tables import diagnosis, success

    for title, source in (
        ("Share of runs that reached an Err%", success(analysis)),
        (f"Diagnosis at {analysis.threshold:g}", diagnosis(analysis)),
    ):
        table = Table(title=title, title_justify="left")
        for n, heading in enumerate(source.header):
            table.add_column(heading, justify="right" if n else "left")
        for row in source.rows:
            table.add_row(*row.cells)
        print_table(table, 140)
    for sentence in analysis.conclusions:
        typer.echo(f"- {sentence}")
