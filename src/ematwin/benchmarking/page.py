"""The report of a study: a page, and its tables as CSV and Parquet."""

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from ematwin.benchmarking.analysis import StudyAnalysis
from ematwin.benchmarking.statistics import ALPHA, RESAMPLES, matrix
from ematwin.errors import FileError
from ematwin.estimation.search import methods as all_methods
from ematwin.files import folder_written_whole, write_text
from ematwin.recordings.tables import no_formula
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.study import MOST_CASES
from ematwin.showing.text import counted, listed

MOST_ROWS = 600  # of a table on the page; the files hold all
_NONE = "–"
_INTERVAL = "95 % interval"


def check_folder(folder: Path) -> None:
    """Before long work: raise `FileError` unless the folder is there, or can be made."""
    if folder.exists() and not folder.is_dir():
        raise FileError(f"Cannot write the report to {folder}: it is a file. Name a folder.")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileError(
            f"Cannot write the report to {folder}: {there} is read-only. Choose a folder that is "
            "yours."
        )


def write_report(analysis: StudyAnalysis, folder: str | Path) -> list[str]:
    """Write page and tables whole or not at all; give the names of the files."""
    target = Path(folder)
    check_folder(target)
    frames = {
        "results": analysis.table.frame,
        "cells": analysis.cells,
        "effects": analysis.effects,
        "targets": analysis.curves,
    }
    with folder_written_whole(target) as draft:
        for name, frame in frames.items():
            frame.map(lambda value: no_formula(value) if isinstance(value, str) else value).to_csv(
                draft / f"{name}.csv", index=False, lineterminator="\n"
            )
        analysis.table.frame.to_parquet(draft / "results.parquet", index=False)
        write_text(draft / "index.html", study_page(analysis))
        return sorted(path.name for path in draft.iterdir())


def study_page(analysis: StudyAnalysis) -> str:
    """Make the HTML page of a study."""
    table = analysis.table
    failed = len(analysis.failures)
    lead = (
        f"{len(table)} runs: {counted(len(table.algorithms), 'algorithm')} on "
        f"{counted(len(table.cases), 'case')}. {int(table.done.sum())} ended well"
        f"{f', {failed} did not' if failed else ''}. Every number here is computed from the store."
    )
    sections = [
        Section("What can and cannot be concluded", text=lead, points=analysis.conclusions),
        _methods(analysis),
        *_figures(analysis),
        *_coefficients(analysis),
        _errors(analysis),
        Section(
            "Success rate",
            "Share of all runs, failed ones included, that reached an Err%.",
            table=success_table(analysis),
        ),
        _ranks(analysis),
        _times(analysis),
        _diagnosis(analysis),
        _failures(analysis),
        Section("How it was made", facts=_facts(analysis)),
    ]
    return render("Comparison of identification algorithms", analysis.lead, sections)


def _methods(analysis: StudyAnalysis) -> Section:
    known = {one.name: one for one in all_methods()}
    rows = []
    for name in analysis.table.algorithms:
        one = known.get(name)
        said = [one.title, one.source, one.departures, one.tuned_on] if one else [_NONE] * 4
        rows.append(Row([name, *said]))
    header = ["algorithm", "form", "from", "departures", "tuned on"]
    return Section(
        "The methods",
        text="Forms with settings as published stand beside improved ones; the last column "
        "says what settings were chosen on, where a source does not give them.",
        table=Table(header, rows, texts=tuple(range(len(header)))),
    )


def _figures(analysis: StudyAnalysis) -> Iterable[Section]:
    texts = {
        "Mean Err%": "Bars are means over the runs; whiskers are 95 % bootstrap intervals of the "
        f"mean ({RESAMPLES} resamples): search spread, not measurement uncertainty.",
        "Distribution of Err%": "Median and quartiles, and the runs where they are few.",
        "Convergence": "Median and quartiles of the best misfit over the runs.",
        "Evaluations to target": "A target is a misfit relative to a twin that does not answer: 31 "
        "of them, evenly spaced in their logarithm from 50 % to 0.3 %, the same in every study. "
        "The curve is the share of all pairs of run and target met, over all cases, with 95 % "
        "bootstrap intervals. Where the twin itself is farther from the record than a target, "
        "no algorithm meets it; and a small misfit need not mean a small Err%.",
        "Average ranks": "A line joins algorithms of which none is shown to differ from another.",
    }
    count = len(analysis.table.cases)
    cut = f" The first {MOST_CASES} of {count} cases are drawn." if count > MOST_CASES else ""
    return [
        Section(heading, text=texts.get(heading, "") + cut, figure=figure)
        for heading, figure in analysis.plot().items()
    ]


def _coefficients(analysis: StudyAnalysis) -> list[Section]:
    """A table of cases by algorithms, with the means of its columns, for each coefficient."""
    if len(analysis.table.algorithms) < 2:
        return []
    texts = {
        "performance_coefficient": "PC = 100 (1 - t err / sum of t err), t the mean seconds and "
        "err the mean Err% of an algorithm on a case, the sum over all algorithms of the study: "
        "100 % less the algorithm's share in time times error, so a number depends on who else "
        "takes part.",
        "performance_coefficient_by_evaluations": "The same with evaluations in place of seconds, "
        "which no machine and no other work on it changes.",
    }
    found = []
    for name, text in texts.items():
        shares = matrix(analysis.cells, name) / 100.0
        rows = [Row([str(case), *map(percent, row)]) for case, *row in shares.itertuples()]
        rows.append(Row(["Average", *map(percent, shares.mean(skipna=False))], marked=True))
        table = Table(["case", *shares.columns], rows[:MOST_ROWS])
        found.append(Section(name.replace("_", " ").capitalize(), text=text, table=table))
    return found


def _errors(analysis: StudyAnalysis) -> Section:
    """Err% and effort of each case and algorithm."""
    names = _directed(analysis)
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
        if names:
            values += [number(cell.err_wrapped_mean), number(cell.err_wrapped_median)]
        rows.append(Row(values, marked=cell.err_mean == lowest[cell.case]))
    header = ["case", "algorithm", "done", "mean", _INTERVAL, "median", _INTERVAL, "quartiles",
              "evaluations", "wall s"]  # fmt: skip
    text = "The lowest mean of a case stands out."
    if names:
        header += ["wrapped: mean", "wrapped: median"]
        text += (
            f" “Wrapped” takes the direction of the {listed(names)} as an angle, which the paper's "
            "form does not."
        )
    count = len(analysis.cells)
    cut = f" The first {MOST_ROWS} of {count} rows; cells.csv has all." if count > MOST_ROWS else ""
    return Section("Err% by case and algorithm", text + cut, table=Table(header, rows, texts=(1,)))


def success_table(analysis: StudyAnalysis) -> Table:
    """Give the share of all runs, failed ones included, that reached each target of Err%."""
    prefix = "share_err_at_most_"
    shares = [name for name in analysis.cells if name.startswith(prefix)]
    reached = analysis.cells[shares].mul(analysis.cells["runs"], axis=0)
    by = analysis.cells["algorithm"]
    runs = analysis.cells["runs"].groupby(by, sort=False).sum()
    shown = reached.groupby(by, sort=False).sum().div(runs, axis=0).map(percent)
    header = ["algorithm", "runs", *(f"Err% ≤ {name.removeprefix(prefix)}" for name in shares)]
    return Table(header, [Row([n, str(runs[n]), *row]) for n, *row in shown.itertuples()])


def _ranks(analysis: StudyAnalysis) -> Section:
    ranks = analysis.ranks
    rows = [
        Row([f"{one.first} and {one.second}", *(number(v, 2) for v in one[2:])],
            marked=one.p_holm < ALPHA)
        for one in ranks.pairs
    ]  # fmt: skip
    return Section(
        "Ranks and tests",
        text="Blocks are cases, each with the mean Err% of an algorithm; runs of one case "
        "share its fault and are not separate blocks. Wilcoxon's signed-rank test compares "
        "two algorithms over the cases, Holm's correction allows for the number of pairs. A12 "
        "is the chance that a run of the first has the lower Err% than one of the second on "
        "the same case; 0.5 is no difference. Pairs that differ at "
        f"{ALPHA:g} after correction stand out. With {counted(len(ranks.blocks), 'case')} and "
        f"{counted(len(ranks.pairs), 'pair')} no corrected p can fall below "
        f"{ranks.smallest_holm:.2g}. effects.csv has A12 of each case.",
        table=Table(["pair", "p, Wilcoxon", "p, Holm", "A12"], rows),
    )


def _times(analysis: StudyAnalysis) -> Section:
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
    return Section(
        "Evaluations to a misfit",
        text="Share of the runs that met a misfit, and evaluations to expect: all that were "
        "spent over the number of runs that met it. Intervals by bootstrap over the runs "
        "within each case; cases are not drawn anew.",
        table=Table(header, rows),
    )


def _diagnosis(analysis: StudyAnalysis) -> Section:
    at = analysis.threshold
    text = (
        f"A component counts as faulty from {at:g} of its range away from healthy. Missed: an "
        "injected fault not named. False alarm: a healthy component named. Confused: a run that "
        "missed a fault and named a healthy component instead."
    )
    if names := _directed(analysis):
        text += (
            f" The direction of the {listed(names)} counts only where there is one and it was "
            f"found; it is wrong from {at:g} of a turn."
        )
    return Section("Diagnosis", text=text, table=diagnosis_table(analysis))


def diagnosis_table(analysis: StudyAnalysis) -> Table:
    """Count missed, false and confused faults of each algorithm, with its mean Err%."""
    turned = ["direction wrong"] if _directed(analysis) else []
    frame = analysis.table.frame
    means = frame["err"][analysis.table.done].groupby(frame["algorithm"]).mean()

    def of(part: int, whole: int) -> str:
        return f"{part} of {whole}" if whole else _NONE

    rows = [
        Row([
            row.algorithm, number(means.get(row.algorithm, math.nan)),
            of(row.exact, row.runs), of(row.missed, row.faults),
            of(row.false_alarms, row.chances), of(row.confused, row.runs),
            *(of(row.direction_wrong, row.directions) for _ in turned),
            str(row.without),
            "; ".join(f"{a} for {b} ({n})" for (b, a), n in list(row.confusions.items())[:2])
            or _NONE,
        ])
        for row in analysis.diagnosis.itertuples()
    ]  # fmt: skip
    header = ["algorithm", "mean Err%", "exact", "missed", "false alarms", "confused runs", *turned,
              "failed runs", "most often mistaken for another"]  # fmt: skip
    return Table(header, rows, texts=(-1,))


def _failures(analysis: StudyAnalysis) -> Section:
    count = len(analysis.failures)
    if not count:
        return Section("Failures", text="None: every run ended well.")
    text = f"{counted(count, 'run')} failed."
    if count > MOST_ROWS:
        text += f" The first {MOST_ROWS} are listed; results.csv has all."
    shown = analysis.failures.drop(columns="id").astype(str).head(MOST_ROWS)
    rows = [Row(list(cells)) for cells in shown.itertuples(index=False)]
    header = ["case", "algorithm", "run", "status", "message"]
    return Section("Failures", text, table=Table(header, rows, texts=(1, 3, -1)))


def _facts(analysis: StudyAnalysis) -> dict[str, str]:
    provenance = dict(analysis.table.provenance)
    machines = provenance.pop("machine", Counter())
    if "system" in provenance:  # the kernel's build tells nothing of the numbers
        systems: Counter[str] = Counter()
        for value, count in provenance["system"].items():
            systems[value.split("-")[0]] += count
        provenance["system"] = systems
    made = {name: _counts(values) for name, values in provenance.items()}
    # a report that is passed on does not name machines
    return {**analysis.table.settings, **made, "machines": str(len(machines))}


def _counts(values: "Counter[str]") -> str:
    if len(values) == 1:
        return next(iter(values))
    most = values.most_common(5)
    more = f" and {len(values) - 5} more" if len(values) > 5 else ""
    return "; ".join(f"{value} ({count} runs)" for value, count in most) + more


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
