"""The tables of a study's report, as they are shown to people."""

import math
from collections.abc import Callable
from typing import Any

from ematwin.benchmarking.analysis import StudyAnalysis
from ematwin.benchmarking.ranks import ALPHA, RankComparison
from ematwin.estimation.search import methods as all_methods
from ematwin.report.page import Row, Table

MOST_ROWS = 600  # of a table on the page; the files hold all
_NONE = "–"
_INTERVAL = "95 % interval"


def directed(analysis: StudyAnalysis) -> list[str]:
    """Names of the faults that have a direction."""
    subject = analysis.table.subject
    return [subject.names[magnitude] for magnitude, _ in subject.directions]


def methods(analysis: StudyAnalysis) -> Table:
    """List what ran: form, source, departures, and what its settings were chosen on."""
    known = {one.name: one for one in all_methods()}
    header = ["algorithm", "form", "from", "departures", "tuned on"]
    rows = []
    for name in analysis.table.algorithms:
        one = known.get(name)
        said = [one.title, one.source, one.departures, one.tuned_on] if one else [_NONE] * 4
        rows.append(Row([name, *said]))
    return Table(header, rows, last_is_text=True, texts=tuple(range(len(header))))


def errors(analysis: StudyAnalysis) -> Table:
    """Give Err% and effort of each case and algorithm; the lowest mean of a case is marked."""
    turned = bool(directed(analysis))
    lowest = analysis.cells.groupby("case")["err_mean"].min()
    rows = []
    for cell in analysis.cells.head(MOST_ROWS).itertuples():
        values = [
            cell.case, cell.algorithm, f"{cell.done} of {cell.runs}",
            number(cell.err_mean), between(cell.err_mean_low_95, cell.err_mean_high_95),
            number(cell.err_median), between(cell.err_median_low_95, cell.err_median_high_95),
            between(cell.err_q1, cell.err_q3), whole(cell.evaluations_mean),
            number(cell.seconds_mean),
        ]  # fmt: skip
        if turned:
            values += [number(cell.err_wrapped_mean), number(cell.err_wrapped_median)]
        rows.append(Row(values, marked=cell.err_mean == lowest[cell.case]))
    header = ["case", "algorithm", "done", "mean", _INTERVAL, "median", _INTERVAL, "quartiles",
              "evaluations", "wall s"]  # fmt: skip
    header += ["wrapped: mean", "wrapped: median"] if turned else []
    return Table(header, rows, texts=(1,))


def success(analysis: StudyAnalysis) -> Table:
    """Give the share of all runs, failed ones included, that reached each target of Err%."""
    prefix = "share_err_at_most_"
    shares = [name for name in analysis.cells if name.startswith(prefix)]
    reached = analysis.cells[shares].mul(analysis.cells["runs"], axis=0)
    by = analysis.cells["algorithm"]
    runs = analysis.cells["runs"].groupby(by, sort=False).sum()
    shown = reached.groupby(by, sort=False).sum().div(runs, axis=0).map(percent)
    header = ["algorithm", "runs", *(f"Err% ≤ {name.removeprefix(prefix)}" for name in shares)]
    return Table(header, [Row([n, str(runs[n]), *row]) for n, *row in shown.itertuples()])


def by_case(values: Any, shown: Callable[[float], str], average: bool = False) -> Table:
    """Show a DataFrame of cases by algorithms; ``average`` adds its means."""
    rows = [Row([str(case), *map(shown, row)]) for case, *row in values.itertuples()]
    if average:
        rows.append(Row(["Average", *map(shown, values.mean(skipna=False))], marked=True))
    return Table(["case", *values.columns], rows[:MOST_ROWS])


def pairs(ranks: RankComparison) -> Table:
    """List every two algorithms; those that differ are marked."""
    rows = [
        Row(
            [
                f"{one.first} and {one.second}",
                *(number(v, 2) for v in (one.p, one.p_holm, one.a12)),
            ],
            marked=one.p_holm < ALPHA,
        )
        for one in ranks.pairs
    ]
    return Table(["pair", "p, Wilcoxon", "p, Holm", "A12"], rows)


def times(analysis: StudyAnalysis) -> Table:
    """Give the share of runs that met a misfit, and the expected evaluations to it."""
    header = ["algorithm"]
    for misfit in analysis.times["misfit"].unique():
        header += [f"{100.0 * misfit:g} %: met", "evaluations", _INTERVAL]
    rows = []
    for algorithm, times in analysis.times.groupby("algorithm", sort=False):
        cells = [str(algorithm)]
        for one in times.itertuples():
            interval = between(one.low_95, one.high_95, whole)
            cells += [percent(one.reached), whole(one.expected), interval]
        rows.append(Row(cells))
    return Table(header, rows)


def diagnosis(analysis: StudyAnalysis) -> Table:
    """Count missed, false and confused faults of each algorithm, with its mean Err%."""
    turned = bool(directed(analysis))
    frame = analysis.table.frame
    means = frame["err"][analysis.table.done].groupby(frame["algorithm"]).mean()
    rows = [
        Row([
            row.algorithm,
            number(means.get(row.algorithm, math.nan)),
            _of(row.exact, row.runs),
            _of(row.missed, row.faults),
            _of(row.false_alarms, row.chances),
            _of(row.confused, row.runs),
            *([_of(row.direction_wrong, row.directions)] if turned else []),
            str(row.without),
            "; ".join(f"{a} for {b} ({n})" for (b, a), n in list(row.confusions.items())[:2])
            or _NONE,
        ])
        for row in analysis.diagnosis
    ]  # fmt: skip
    header = [
        "algorithm", "mean Err%", "exact", "missed", "false alarms", "confused runs",
        *(["direction wrong"] if turned else []), "failed runs", "most often mistaken for another",
    ]  # fmt: skip
    return Table(header, rows, last_is_text=True)


def failures(analysis: StudyAnalysis) -> Table:
    """List the runs that did not end well."""
    rows = [
        Row([one.case, one.algorithm, str(one.run), one.status, one.stopped])
        for one in analysis.failures.head(MOST_ROWS).itertuples()
    ]
    header = ["case", "algorithm", "run", "status", "message"]
    return Table(header, rows, last_is_text=True, texts=(1, 3))


def number(value: float, digits: int = 3) -> str:
    """Format a number to so many digits; a dash where there is none."""
    if not math.isfinite(value):
        return _NONE
    if value == 0.0 or abs(value) >= 10.0**digits:
        return f"{value:.0f}"
    return f"{value:#.{digits}g}".removesuffix(".")


def whole(value: float) -> str:
    """Format a count, or a mean of counts."""
    return f"{value:.0f}" if math.isfinite(value) else _NONE


def percent(share: float) -> str:
    """Format a share in per cent."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else _NONE


def between(low: float, high: float, shown: Callable[[float], str] = number) -> str:
    """Format an interval."""
    if not math.isfinite(low):
        return _NONE
    return shown(low) if low == high else f"{shown(low)} to {shown(high)}"


def _of(part: int, whole: int) -> str:
    return f"{part} of {whole}" if whole else _NONE
