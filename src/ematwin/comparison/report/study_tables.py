"""The tables of a study's report, for the page and for LaTeX alike."""

import math

import numpy as np

from ematwin.comparison.analysis.conclusions import shown
from ematwin.comparison.analysis.convergence import STATED_GAPS
from ematwin.comparison.analysis.paper import PAPER_ALGORITHMS, TABLE_2_AVERAGE, paper_coefficients
from ematwin.comparison.analysis.ranks import ALPHA
from ematwin.comparison.analysis.study import StudyAnalysis
from ematwin.comparison.analysis.summary import Cell
from ematwin.report.page import Row, Table

MOST_ROWS = 600  # of a table on the page; cells.csv and results.csv hold all
_NONE = "–"


def number(value: float, digits: int = 3) -> str:
    """A number to so many digits, zeros at the end among them; a dash where there is none."""
    if not math.isfinite(value):
        return _NONE
    if value == 0.0 or abs(value) >= 10.0**digits:
        return f"{value:.0f}"
    return f"{value:#.{digits}g}".removesuffix(".")


def _whole(value: float) -> str:
    """A count, or a mean of counts."""
    return f"{value:.0f}" if math.isfinite(value) else _NONE


def _between(interval: tuple[float, float]) -> str:
    low, high = interval
    if not math.isfinite(low):
        return _NONE
    return number(low) if low == high else f"{number(low)} to {number(high)}"


def _between_whole(interval: tuple[float, float]) -> str:
    low, high = map(_whole, interval)
    return low if low == high else f"{low} to {high}"


def errors(analysis: StudyAnalysis) -> Table:
    """Err% of each case and algorithm; the lowest mean of a case is marked."""
    turned = bool(analysis.table.subject.directions)
    rows = []
    for row in analysis.cells:
        best = min((cell.metrics["err"].mean for cell in row if cell.done), default=math.nan)
        for cell in row:
            err, wrapped = cell.metrics["err"], cell.metrics["err_wrapped"]
            rows.append(
                Row(
                    [
                        cell.case,
                        shown(cell.algorithm),
                        f"{cell.done} of {cell.runs}",
                        number(err.mean),
                        _between(err.mean_interval),
                        number(err.median),
                        _between(err.median_interval),
                        f"{number(err.q1)} to {number(err.q3)}" if cell.done else _NONE,
                        *([number(wrapped.mean), number(wrapped.median)] if turned else []),
                    ],
                    marked=cell.done > 0 and err.mean == best,
                )
            )
    header = [
        "case", "algorithm", "done", "mean", "95 % interval", "median", "95 % interval",
        "quartiles", *(["wrapped: mean", "wrapped: median"] if turned else []),
    ]  # fmt: skip
    return Table(header, rows[:MOST_ROWS], texts=(1,))


def effort(analysis: StudyAnalysis) -> Table:
    """Evaluations and seconds of each case and algorithm."""
    rows = []
    for cell in (cell for row in analysis.cells for cell in row):
        spent, wall, cpu = (cell.metrics[m] for m in ("evaluations", "seconds", "cpu_seconds"))
        rows.append(
            Row([
                cell.case, shown(cell.algorithm), _whole(spent.mean),
                _between_whole(spent.mean_interval), number(wall.mean),
                _between(wall.mean_interval), number(wall.median), number(wall.iqr),
                number(cpu.mean), _between(cpu.mean_interval),
            ])
        )  # fmt: skip
    header = [
        "case", "algorithm", "evaluations", "95 % interval", "wall s, mean", "95 % interval",
        "wall s, median", "IQR", "CPU s, mean", "95 % interval",
    ]  # fmt: skip
    return Table(header, rows[:MOST_ROWS], texts=(1,))


def success(analysis: StudyAnalysis) -> Table:
    """Share of all runs, failed ones included, that came to each target of Err%."""
    targets = list(analysis.cells[0][0].success)
    rows = []
    for a, algorithm in enumerate(analysis.table.algorithms):
        column = [row[a] for row in analysis.cells]
        runs = sum(cell.runs for cell in column)
        rows.append(Row([shown(algorithm), str(runs), *(_share(column, t, runs) for t in targets)]))
    return Table(["algorithm", "runs", *(f"Err% ≤ {target:g}" for target in targets)], rows)


def _share(column: list[Cell], target: float, runs: int) -> str:
    reached = sum(cell.success[target] * cell.runs for cell in column if cell.runs)
    return f"{100.0 * reached / runs:.0f} %" if runs else _NONE


def coefficients(analysis: StudyAnalysis) -> Table:
    """PC over all algorithms of the study, with the average over the cases."""
    return Table(
        ["case", *(shown(name) for name in analysis.table.algorithms)],
        [
            Row([case, *(_percent(value) for value in row)])
            for case, row in zip(
                [*analysis.table.cases, "Average"],
                [*analysis.coefficients, _mean(analysis.coefficients)],
                strict=True,
            )
        ],
    )


def beside_paper(analysis: StudyAnalysis) -> Table:
    """Table 2: our PC over the paper's algorithms, each beside the paper's own; else no rows."""
    cases = analysis.table.cases
    theirs = paper_coefficients(cases, analysis.shared, analysis.table.subject.kind)
    known = [c for c in range(len(cases)) if np.isfinite(theirs[c]).any()]
    ours = analysis.shared_coefficients[known]
    last = [TABLE_2_AVERAGE[PAPER_ALGORITHMS.index(name)] for name in analysis.shared]
    rows = []
    for name, here, paper in zip(
        [*(cases[c] for c in known), "Average"],
        [*ours, _mean(ours)],
        [*theirs[known], np.array(last, dtype=float)],
        strict=True,
    ):
        cells = [name]
        for one, other in zip(here, paper, strict=True):
            cells += [_percent(one), _percent(other)]
        rows.append(Row(cells, marked=name == "Average"))
    if not known:
        rows = []
    header = ["case"]
    for name in analysis.shared:
        header += [shown(name), "paper"]
    return Table(header, rows)


def _percent(value: float) -> str:
    return f"{value:.0f} %" if math.isfinite(value) else _NONE


def _mean(values: np.ndarray) -> np.ndarray:
    return values.mean(axis=0) if len(values) else np.full(values.shape[1], np.nan)


def likeness(analysis: StudyAnalysis) -> Table:
    """Rank correlation with the paper's Table 2."""
    found = analysis.likeness
    named = {"all cells": found.cells, "averages over the cases": found.average, **found.by_case}
    return Table(
        ["over", "Spearman", "Kendall", "pairs"],
        [
            Row([name, number(one.spearman, 2), number(one.kendall, 2), str(one.pairs)])
            for name, one in named.items()
        ],
    )


def pairs(analysis: StudyAnalysis) -> Table:
    """Every two algorithms; significant pairs are marked."""
    return Table(
        ["pair", "p, Wilcoxon", "p, Holm", "A12"],
        [
            Row(
                [
                    f"{shown(pair.first)} and {shown(pair.second)}",
                    number(pair.p, 2),
                    number(pair.p_holm, 2),
                    number(pair.a12, 2),
                ],
                marked=pair.p_holm < ALPHA,
            )
            for pair in analysis.ranks.pairs
        ],
    )


def ranks(analysis: StudyAnalysis) -> Table:
    """Average ranks, best first."""
    order = np.argsort(analysis.ranks.average_ranks)
    return Table(
        ["algorithm", "average rank"],
        [
            Row([shown(analysis.table.algorithms[n]), number(analysis.ranks.average_ranks[n])])
            for n in order
        ],
    )


def to_target(analysis: StudyAnalysis) -> Table:
    """Share of runs that closed the gap, and the expected evaluations to it."""
    header = ["algorithm"]
    for gap in STATED_GAPS:
        header += [f"gap {gap:g}: met", "evaluations"]
    rows = []
    for curve in analysis.to_target:
        cells = [shown(curve.algorithm)]
        for gap in STATED_GAPS:
            cells += [f"{100.0 * curve.reached[gap]:.0f} %", _whole(curve.expected[gap])]
        rows.append(Row(cells))
    return Table(header, rows)


def diagnosis(analysis: StudyAnalysis) -> Table:
    """Missed, false and confused faults of each algorithm, with its mean Err%."""
    turned = bool(analysis.table.subject.directions)
    rows = []
    for a, row in enumerate(analysis.diagnosis):
        known = analysis.table.done & (analysis.table.algorithm == a)
        err = analysis.table.scalars["err"][known]
        common = list(row.confusions.items())[:2]
        rows.append(
            Row([
                shown(row.algorithm),
                number(float(err.mean())) if len(err) else _NONE,
                _of(row.exact, row.runs),
                _of(row.missed, row.faults),
                _of(row.false_alarms, row.chances),
                _of(row.confused, row.runs),
                *([_of(row.direction_wrong, row.directions)] if turned else []),
                str(row.without),
                "; ".join(f"{a} for {b} ({n})" for (b, a), n in common) or _NONE,
            ])
        )  # fmt: skip
    header = [
        "algorithm", "mean Err%", "exact", "missed", "false alarms", "confused runs",
        *(["direction wrong"] if turned else []), "failed runs", "most often mistaken for another",
    ]  # fmt: skip
    return Table(header, rows, last_is_text=True)


def _of(part: int, whole: int) -> str:
    return f"{part} of {whole}" if whole else _NONE


def failures(analysis: StudyAnalysis) -> Table:
    """Runs that did not end well."""
    return Table(
        ["case", "algorithm", "run", "status", "message"],
        [
            Row([one.case, shown(one.algorithm), str(one.run), one.status, one.message])
            for one in analysis.failures[:MOST_ROWS]
        ],
        last_is_text=True,
        texts=(1, 3),
    )


def claims(analysis: StudyAnalysis) -> Table:
    """The paper's claims and what came out here."""
    return Table(
        ["the paper says", "where", "here", "numbers"],
        [
            Row([claim.text, claim.source, claim.verdict, claim.evidence])
            for claim in analysis.claims
        ],
        last_is_text=True,
        texts=(0, 1, 2),
    )
