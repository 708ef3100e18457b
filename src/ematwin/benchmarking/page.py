"""The report of a study: a page, and its tables as CSV and Parquet."""

import math
from collections import Counter
from pathlib import Path
from typing import Any

from ematwin.benchmarking.analysis import StudyAnalysis, prose
from ematwin.benchmarking.statistics import ALPHA, RESAMPLES, matrix
from ematwin.estimation.search import methods
from ematwin.files import folder_written_whole, write_text
from ematwin.recordings.tables import no_formula
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.study import MOST_CASES
from ematwin.showing.text import listed

MOST_ROWS = 600  # of a table on the page; the files hold all
_NONE = "–"
_INTERVAL = "95 % interval"


def write_report(analysis: StudyAnalysis, folder: str | Path) -> list[str]:
    """Write page and tables whole or not at all; give the names of the files."""
    runs = analysis.table.frame
    frames = {
        "results": runs, "cells": analysis.cells, "effects": analysis.effects,
        "targets": analysis.curves,
    }  # fmt: skip
    with folder_written_whole(folder) as draft:
        for name, frame in frames.items():
            frame.map(lambda value: no_formula(value) if isinstance(value, str) else value).to_csv(
                draft / f"{name}.csv", index=False, lineterminator="\n"
            )
        runs.to_parquet(draft / "results.parquet", index=False)
        write_text(draft / "index.html", study_page(analysis))
        return sorted(path.name for path in draft.iterdir())


def study_page(analysis: StudyAnalysis) -> str:
    """Make the HTML page of a study."""
    contents: dict[str, dict[str, Any]] = {
        "What can and cannot be concluded": {"points": analysis.conclusions},
        "The methods": {"table": _methods(analysis)},
        **{heading: {"figure": figure} for heading, figure in analysis.plot().items()},
        **{
            name.replace("_", " ").capitalize(): {"table": _coefficients(analysis, name)}
            for name in ("performance_coefficient", "performance_coefficient_by_evaluations")
        },
        "Err% by case and algorithm": {"table": _errors(analysis)},
        "Success rate": {"table": success_table(analysis)},
        "Ranks and tests": {"table": _ranks(analysis)},
        "Evaluations to a misfit": {"table": _times(analysis)},
        "Diagnosis": {"table": diagnosis_table(analysis)},
        "Failures": {"table": _failures(analysis)},
        "How it was made": {"facts": _facts(analysis)},
    }
    texts = _texts(analysis)
    sections = [Section(name, texts.get(name, ""), **what) for name, what in contents.items()]
    return render("Comparison of identification algorithms", analysis.lead, sections)


def _texts(analysis: StudyAnalysis) -> dict[str, str]:
    """Texts of the sections, by heading."""
    table, cases = analysis.table, len(analysis.table.cases)
    text = prose(
        "page.j2", runs=len(table), done=int(table.done.sum()), cases=cases, most=MOST_ROWS,
        algorithms=len(table.algorithms), cells=len(analysis.cells), ranks=analysis.ranks,
        cut=f"The first {MOST_CASES} of {cases} cases are drawn." if cases > MOST_CASES else "",
        directed=listed(names) if (names := _directed(analysis)) else "", alpha=ALPHA,
        threshold=analysis.threshold, resamples=RESAMPLES,
    )  # fmt: skip
    parts = (part.partition("\n") for part in text.split("## ")[1:])
    return {heading: " ".join(said.split()) for heading, _, said in parts}


def _methods(analysis: StudyAnalysis) -> Table:
    header = ["algorithm", "form", "from", "departures", "tuned on"]
    known = {one.name: (one.title, one.source, one.departures, one.tuned_on) for one in methods()}
    rows = [Row([name, *known.get(name, [_NONE] * 4)]) for name in analysis.table.algorithms]
    return Table(header, rows, texts=tuple(range(len(header))))


def _coefficients(analysis: StudyAnalysis, name: str) -> Table:
    """Cases by algorithms, with the means of the columns; empty where there is one algorithm."""
    shares = matrix(analysis.cells, name) / 100.0
    rows = [Row([str(case), *map(percent, row)]) for case, *row in shares.itertuples()]
    rows.append(Row(["Average", *map(percent, shares.mean(skipna=False))], marked=True))
    return Table(["case", *shares.columns], rows[:MOST_ROWS] if shares.shape[1] > 1 else [])


def _errors(analysis: StudyAnalysis) -> Table:
    """Err% and effort of each case and algorithm."""
    directed, cells = bool(_directed(analysis)), analysis.cells
    lowest = cells.groupby("case")["err_mean"].min()
    rows = []
    for cell in cells.head(MOST_ROWS).itertuples():
        values = [
            cell.case, cell.algorithm, f"{cell.done} of {cell.runs}",
            number(cell.err_mean), between(cell.err_mean_low_95, cell.err_mean_high_95),
            number(cell.err_median), between(cell.err_median_low_95, cell.err_median_high_95),
            between(cell.err_q1, cell.err_q3), number(cell.evaluations_mean, 0),
            number(cell.seconds_mean),
        ]  # fmt: skip
        if directed:
            values += [number(cell.err_wrapped_mean), number(cell.err_wrapped_median)]
        rows.append(Row(values, marked=cell.err_mean == lowest[cell.case]))
    header = ["case", "algorithm", "done", "mean", _INTERVAL, "median", _INTERVAL, "quartiles",
              "evaluations", "wall s"]  # fmt: skip
    header += ["wrapped: mean", "wrapped: median"] if directed else []
    return Table(header, rows, texts=(1,))


def success_table(analysis: StudyAnalysis) -> Table:
    """Give the share of all runs, failed ones included, that reached each target of Err%."""
    prefix, cells = "share_err_at_most_", analysis.cells
    shares = cells.filter(like=prefix)
    sums = shares.mul(cells["runs"], axis=0).assign(runs=cells["runs"])
    sums = sums.groupby(cells["algorithm"], sort=False).sum()
    shown = sums[shares.columns].div(sums["runs"], axis=0).map(percent)
    header = ["algorithm", "runs", *(f"Err% ≤ {name.removeprefix(prefix)}" for name in shares)]
    return Table(header, [Row([n, str(sums["runs"][n]), *row]) for n, *row in shown.itertuples()])


def _ranks(analysis: StudyAnalysis) -> Table:
    rows = [
        Row([f"{one.first} and {one.second}",
             number(one.p, 2), number(one.p_holm, 2), number(one.a12, 2)],
            marked=one.p_holm < ALPHA)
        for one in analysis.ranks.pairs.itertuples()
    ]  # fmt: skip
    return Table(["pair", "p, Wilcoxon", "p, Holm", "A12"], rows)


def _times(analysis: StudyAnalysis) -> Table:
    header, rows = ["algorithm"], []
    for misfit in analysis.times["misfit"].unique():
        header += [f"{100.0 * misfit:g} %: met", "evaluations", _INTERVAL]
    for algorithm, times in analysis.times.groupby("algorithm", sort=False):
        cells = [str(algorithm)]
        for one in times.itertuples():
            interval = between(one.low_95, one.high_95, 0)
            cells += [percent(one.reached), number(one.expected, 0), interval]
        rows.append(Row(cells))
    return Table(header, rows)


def diagnosis_table(analysis: StudyAnalysis) -> Table:
    """Count missed, false and confused faults of each algorithm, with its mean Err%."""
    frame, directed = analysis.table.frame, bool(_directed(analysis))
    means = frame["err"][analysis.table.done].groupby(frame["algorithm"]).mean()

    def of(part: int, whole: int) -> str:
        return f"{part} of {whole}" if whole else _NONE

    rows = []
    for one in analysis.diagnosis.itertuples():
        mistaken = [f"{a} for {b} ({n})" for (b, a), n in one.confusions.items()]
        rows.append(Row([
            one.algorithm, number(means.get(one.algorithm, math.nan)), of(one.exact, one.runs),
            of(one.missed, one.faults), of(one.false_alarms, one.chances),
            of(one.confused, one.runs), *[of(one.direction_wrong, one.directions)] * directed,
            str(one.without), "; ".join(mistaken[:2]) or _NONE,
        ]))  # fmt: skip
    header = ["algorithm", "mean Err%", "exact", "missed", "false alarms", "confused runs",
              *["direction wrong"] * directed, "failed runs",
              "most often mistaken for another"]  # fmt: skip
    return Table(header, rows, texts=(-1,))


def _failures(analysis: StudyAnalysis) -> Table | None:
    shown = analysis.failures.drop(columns="id").astype(str).head(MOST_ROWS)
    rows = [Row(list(cells)) for cells in shown.itertuples(index=False)]
    header = ["case", "algorithm", "run", "status", "message"]
    return Table(header, rows, texts=(1, 3, -1)) if rows else None


def _facts(analysis: StudyAnalysis) -> dict[str, str]:
    """Settings and provenance; a report that is passed on does not name machines."""
    facts = dict(analysis.table.settings)
    for name, values in analysis.table.provenance.items():
        shown: Counter[str] = Counter()
        for value, count in values.items():
            # the kernel's build tells nothing of the numbers
            shown[value.split("-")[0] if name == "system" else value] += count
        told = [f"{value} ({count} runs)" for value, count in shown.most_common(5)]
        more = f" and {len(shown) - 5} more" if len(shown) > 5 else ""
        facts[name] = "; ".join(told) + more if len(shown) > 1 else next(iter(shown))
    facts.pop("machine", None)
    return facts | {"machines": str(len(analysis.table.provenance.get("machine", ())))}


def _directed(analysis: StudyAnalysis) -> list[str]:
    """Names of the faults that have a direction."""
    subject = analysis.table.subject
    return [subject.names[magnitude] for magnitude, _ in subject.directions]


def number(value: float, digits: int = 3) -> str:
    """Format a number to so many digits; a dash where there is none."""
    if not math.isfinite(value):
        return _NONE
    if value == 0.0 or abs(value) >= 10.0**digits:
        return f"{value:.0f}"
    return f"{value:#.{digits}g}".removesuffix(".")


def percent(share: float) -> str:
    """Format a share in per cent."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else _NONE


def between(low: float, high: float, digits: int = 3) -> str:
    """Format an interval; a dash where there is none."""
    if low == high or not math.isfinite(low):
        return number(low, digits)
    return f"{number(low, digits)} to {number(high, digits)}"
