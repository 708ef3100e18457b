"""The report of a study as a folder: page, CSV, LaTeX tables and drawings.

All is made in a draft beside the folder and put in place at the end: a report is written whole or
not at all. In a folder that is already there, only files that a report makes are replaced.
"""

import csv
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ematwin.analysis.study import StudyAnalysis
from ematwin.analysis.summary import METRICS
from ematwin.errors import FileError
from ematwin.faults import FAULTS
from ematwin.readers.files import write_text
from ematwin.report.latex import latex_table
from ematwin.report.study import latex_tables, study_page
from ematwin.report.study_svg import check_extra, drawings
from ematwin.report.study_tables import claims

_KEPT_SCALARS = (
    "err", "err_wrapped", "cost", "relative_misfit", "evaluations", "seconds", "cpu_seconds",
)  # fmt: skip
_DIAGRAM = "critical_difference.svg"


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
    try:
        target.absolute().parent.mkdir(parents=True, exist_ok=True)
        draft = Path(
            tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.absolute().parent)
            if not target.exists()
            else tempfile.mkdtemp(prefix=".report.", dir=target)
        )
    except OSError as error:
        raise FileError(
            f"Cannot write the report to {target}: {error.strerror}. Choose a folder that is yours."
        ) from None
    try:
        _fill(analysis, draft, slim)
        names = sorted(path.name for path in draft.iterdir())
        _put(draft, target)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(
            f"Cannot write the report to {target}: {error.strerror or error}."
        ) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return names


def _fill(analysis: StudyAnalysis, draft: Path, slim: bool) -> None:
    drawn = drawings(analysis)
    for name, text in drawn.items():
        write_text(draft / name, text)
    for name, (table, caption) in latex_tables(analysis).items():
        if table.rows:
            write_text(draft / f"table_{name}.tex", latex_table(table, caption, f"tab:{name}"))
    if analysis.claims:
        write_text(draft / "claims.md", claims_markdown(analysis))
    _write_csv(draft / "results.csv", _run_rows(analysis))
    _write_csv(draft / "cells.csv", _cell_rows(analysis))
    write_text(draft / "index.html", study_page(analysis, drawn, slim=slim))


def _put(draft: Path, target: Path) -> None:
    """Put the draft in its place; what an older report left there goes."""
    if not target.exists():
        draft.chmod(0o777 & ~_umask())
        draft.rename(target)
        return
    fresh = {path.name for path in draft.iterdir()}
    old = [
        path
        for pattern in ("table_*.tex", "figure*_*.svg", _DIAGRAM, "claims.md")
        for path in target.glob(pattern)
        if path.name not in fresh
    ]
    for path in sorted(draft.iterdir()):
        os.replace(path, target / path.name)
    for path in old:
        path.unlink()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


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
    yield [
        "id", "case", "algorithm", *whole, "status", *_KEPT_SCALARS, "stopped",
        *(f"injected_{name}" for name in FAULTS), *(f"found_{name}" for name in FAULTS),
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
    header.append("performance_coefficient")
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
            yield values


def _write_csv(path: Path, rows: Iterator[list[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(
            ["" if value != value else value for value in row] for row in rows
        )
