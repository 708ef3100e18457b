"""The tables of a study's report, for the page and for LaTeX alike."""

import math

import numpy as np

from ematwin.comparison.analysis.paper import PAPER_ALGORITHMS, TABLE_2_AVERAGE, paper_coefficients
from ematwin.comparison.analysis.ranks import ALPHA, RankComparison
from ematwin.comparison.analysis.study import StudyAnalysis
from ematwin.comparison.analysis.summary import Cell
from ematwin.estimation.search import methods as all_methods
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
                        cell.algorithm,
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
                cell.case, cell.algorithm, _whole(spent.mean),
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
        rows.append(Row([algorithm, str(runs), *(_share(column, t, runs) for t in targets)]))
    return Table(["algorithm", "runs", *(f"Err% ≤ {target:g}" for target in targets)], rows)


def _share(column: list[Cell], target: float, runs: int) -> str:
    reached = sum(cell.success[target] * cell.runs for cell in column if cell.runs)
    return f"{100.0 * reached / runs:.0f} %" if runs else _NONE


def methods(analysis: StudyAnalysis) -> Table:
    """What ran: form, source, departures, and what its settings were chosen on."""
    known = {one.name: one for one in all_methods()}
    standing = {form: name for name, form in analysis.forms.items()}
    rows = []
    for name in analysis.table.algorithms:
        one = known.get(name)
        told = [one.title, one.source, one.departures, one.tuned_on] if one else [_NONE] * 4
        as_paper = [standing[name].upper() if name in standing else ""] if standing else []
        rows.append(Row([name, *as_paper, *told]))
    header = ["algorithm", *(["stands for"] if standing else [])]
    header += ["form", "from", "departures", "tuned on"]
    return Table(header, rows, last_is_text=True, texts=tuple(range(len(header))))


def coefficients(analysis: StudyAnalysis) -> Table:
    """PC over all algorithms of the study, with the average over the cases."""
    return _by_case(analysis, analysis.coefficients)


def coefficients_by_evaluations(analysis: StudyAnalysis) -> Table:
    """The same with evaluations in place of seconds."""
    return _by_case(analysis, analysis.coefficients_by_evaluations)


def _by_case(analysis: StudyAnalysis, values: np.ndarray) -> Table:
    return Table(
        ["case", *analysis.table.algorithms],
        [
            Row([case, *(_percent(value) for value in row)])
            for case, row in zip(
                [*analysis.table.cases, "Average"], [*values, _mean(values)], strict=True
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
        header += [analysis.forms[name], "paper"]
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


def pairs(ranks: RankComparison) -> Table:
    """Every two algorithms; significant pairs are marked."""
    return Table(
        ["pair", "p, Wilcoxon", "p, Holm", "A12"],
        [
            Row(
                [
                    f"{pair.first} and {pair.second}",
                    number(pair.p, 2),
                    number(pair.p_holm, 2),
                    number(pair.a12, 2),
                ],
                marked=pair.p_holm < ALPHA,
            )
            for pair in ranks.pairs
        ],
    )


def ranks(analysis: StudyAnalysis) -> Table:
    """Average ranks, best first by mean Err%; beside them those by other middles."""
    order = np.argsort(analysis.ranks.average_ranks)
    return Table(
        ["algorithm", *(f"rank by {by}" for by in analysis.ranks_by)],
        [
            Row([
                analysis.table.algorithms[n],
                *(number(values[n]) for values in analysis.ranks_by.values()),
            ])
            for n in order
        ],
    )  # fmt: skip


def effects(analysis: StudyAnalysis) -> Table:
    """A12 of the best algorithm by rank against each other one, case by case."""
    names, average = analysis.table.algorithms, analysis.ranks.average_ranks
    if len(names) < 2 or not np.isfinite(average).all():
        return Table(["case"], [])
    best = int(np.argmin(average))
    others = [n for n in range(len(names)) if n != best]
    return Table(
        [f"{names[best]} against", *(names[n] for n in others)],
        [
            Row([case, *(number(analysis.a12[c, best, n], 2) for n in others)])
            for c, case in enumerate(analysis.table.cases[:MOST_ROWS])
        ],
    )


def to_target(analysis: StudyAnalysis) -> Table:
    """Share of runs that met a misfit, and the expected evaluations to it with their interval."""
    header = ["algorithm"]
    for misfit in analysis.misfits:
        header += [f"{100.0 * misfit:g} %: met", "evaluations", "95 % interval"]
    rows = []
    for curve in analysis.to_target:
        cells = [curve.algorithm]
        for misfit in analysis.misfits:
            low, high = curve.interval[misfit]
            cells += [
                f"{100.0 * curve.reached[misfit]:.0f} %",
                _whole(curve.expected[misfit]),
                f"{_whole(low)} to {_whole(high)}" if math.isfinite(low) else _NONE,
            ]
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
                row.algorithm,
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
            Row([one.case, one.algorithm, str(one.run), one.status, one.message])
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
