"""The report of a study as a folder: page, CSV, LaTeX tables and drawings.

All is made in a draft beside the folder and put in place at the end: a report is written whole or
not at all. In a folder that is already there, only files that a report makes are replaced.
"""

import csv
import os
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np

from ematwin.comparison.analysis.study import StudyAnalysis
from ematwin.comparison.analysis.summary import METRICS
from ematwin.comparison.report.latex import latex_table
from ematwin.comparison.report.study import latex_tables, study_page
from ematwin.comparison.report.study_figures import StudyFigures
from ematwin.comparison.report.study_svg import DIAGRAM, check_extra, critical_difference, still
from ematwin.comparison.report.study_tables import claims
from ematwin.errors import FileError
from ematwin.files import folder_written_whole, write_text
from ematwin.recordings.tables import no_formula

_KEPT_SCALARS = (
    "err", "err_wrapped", "cost", "relative_misfit", "evaluations", "seconds", "cpu_seconds",
)  # fmt: skip


def check_folder(folder: Path) -> None:
    """Before long work: the folder is there or can be made, and is writable.

    Raises
    ------
    FileError
        If not.
    MissingExtraError
        If what draws is not installed.
    """
    check_extra()
    if folder.exists() and not folder.is_dir():
        raise FileError(f"Cannot write the report to {folder}: it is a file. Name a folder.")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileError(
            f"Cannot write the report to {folder}: {there} is read-only. Choose a folder that is "
            "yours."
        )


def write_report(analysis: StudyAnalysis, folder: str | Path, *, slim: bool = False) -> list[str]:
    """Write the report; gives the names of its files. ``slim`` as of `study_page`.

    Raises
    ------
    FileError
        If the folder cannot be written; it is left as it was.
    """
    target = Path(folder)
    check_folder(target)
    with folder_written_whole(target) as draft:
        _fill(analysis, draft, slim)
        names = sorted(path.name for path in draft.iterdir())
    for pattern in ("table_*.tex", "figure*_*.svg", DIAGRAM, "claims.md"):
        for path in target.glob(pattern):
            if path.name not in names:
                path.unlink()  # an older report left it
    return names


def _fill(analysis: StudyAnalysis, draft: Path, slim: bool) -> None:
    figures = StudyFigures(analysis)
    stills = {figure.file: still(figure) for figure in figures.all}
    if diagram := critical_difference(analysis):
        stills[DIAGRAM] = diagram
    for name, text in stills.items():
        write_text(draft / name, text)
    for name, (table, caption) in latex_tables(analysis).items():
        if table.rows:
            write_text(draft / f"table_{name}.tex", latex_table(table, caption, f"tab:{name}"))
    if analysis.claims:
        write_text(draft / "claims.md", claims_markdown(analysis))
    _write_csv(draft / "results.csv", _run_rows(analysis))
    _write_csv(draft / "cells.csv", _cell_rows(analysis))
    _write_csv(draft / "effects.csv", _effect_rows(analysis))
    _write_csv(draft / "targets.csv", _target_rows(analysis))
    write_text(draft / "index.html", study_page(analysis, figures, stills, slim=slim))


def claims_markdown(analysis: StudyAnalysis) -> str:
    """The paper's claims and what came out, as a Markdown table (docs/study.md holds one)."""
    table = claims(analysis)
    lines = [table.header, ["---"] * len(table.header), *(row.cells for row in table.rows)]
    return "".join(
        f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |\n" for cells in lines
    )


def _run_rows(analysis: StudyAnalysis) -> Iterator[list[object]]:
    """One row a run, failed ones included."""
    table = analysis.table
    whole = ("run", "seed", "record_seed", "population", "iterations")
    names = table.subject.names
    yield [
        "id", "case", "algorithm", *whole, "status", *_KEPT_SCALARS, "stopped",
        *(f"injected_{name}" for name in names), *(f"found_{name}" for name in names),
    ]  # fmt: skip
    columns = [getattr(table, name).tolist() for name in whole]
    scalars = [table.scalars[name].tolist() for name in _KEPT_SCALARS]
    injected, found = table.injected.tolist(), table.found.tolist()
    for n, id_ in enumerate(table.ids):
        yield [
            id_, table.cases[table.case[n]], table.algorithms[table.algorithm[n]],
            *(column[n] for column in columns), table.status[n],
            *(column[n] for column in scalars), table.stopped[n], *injected[n], *found[n],
        ]  # fmt: skip


def _cell_rows(analysis: StudyAnalysis) -> Iterator[list[object]]:
    """One row a case and algorithm: every number of the summary."""
    targets = list(analysis.cells[0][0].success)
    numbers = ("mean", "median", "q1", "q3")
    header: list[object] = ["case", "algorithm", "runs", "done", "failed"]
    for metric in METRICS:
        header += [f"{metric}_{name}" for name in numbers]
        header += [
            f"{metric}_{of}_{end}" for of in ("mean", "median") for end in ("low_95", "high_95")
        ]
    header += [f"share_err_at_most_{target:g}" for target in targets]
    header += ["performance_coefficient", "performance_coefficient_by_evaluations"]
    yield header
    for c, row in enumerate(analysis.cells):
        for a, cell in enumerate(row):
            values: list[object] = [cell.case, cell.algorithm, cell.runs, cell.done, cell.failed]
            for metric in METRICS:
                spread = cell.metrics[metric]
                values += [getattr(spread, name) for name in numbers]
                values += [*spread.mean_interval, *spread.median_interval]
            values += [cell.success[target] for target in targets]
            values.append(float(analysis.coefficients[c, a]))
            values.append(float(analysis.coefficients_by_evaluations[c, a]))
            yield values


def _effect_rows(analysis: StudyAnalysis) -> Iterator[list[object]]:
    """One row a case and pair: A12 of the first against the second."""
    names = analysis.table.algorithms
    yield ["case", "first", "second", "a12"]
    for c, case in enumerate(analysis.table.cases):
        for i, j in combinations(range(len(names)), 2):
            yield [case, names[i], names[j], float(analysis.a12[c, i, j])]


def _target_rows(analysis: StudyAnalysis) -> Iterator[list[object]]:
    """One row an algorithm and number of evaluations: share of pairs of run and target met."""
    yield ["algorithm", "evaluations", "share", "low_95", "high_95"]
    for curve in analysis.to_target:
        columns = (curve.evaluations, curve.share, curve.share_low, curve.share_high)
        for row in np.stack(columns, axis=1).tolist():
            yield [curve.algorithm, *row]


def _write_csv(path: Path, rows: Iterator[list[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(
            [_cell(value) for value in row] for row in rows
        )


def _cell(value: object) -> object:
    if isinstance(value, str):
        return no_formula(value)
    return "" if value != value else value
