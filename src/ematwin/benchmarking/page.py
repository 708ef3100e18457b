"""The report of a study: a page, and its tables as CSV and Parquet."""

import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from ematwin.benchmarking import tables
from ematwin.benchmarking.analysis import StudyAnalysis
from ematwin.benchmarking.conclusions import counted
from ematwin.benchmarking.ranks import ALPHA
from ematwin.benchmarking.summary import RESAMPLES, matrix
from ematwin.benchmarking.tables import MOST_ROWS
from ematwin.errors import FileError
from ematwin.files import folder_written_whole, write_text
from ematwin.plots.study import MOST_CASES
from ematwin.recordings.tables import no_formula
from ematwin.report.page import Section, render
from ematwin.showing.words import listed


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
    """Write page and tables whole or not at all; give the names of the files.

    Raises
    ------
    FileError
        If the folder cannot be written; it is left as it was.
    """
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
        Section(
            "The methods",
            text="Forms with settings as published stand beside improved ones; the last column "
            "says what settings were chosen on, where a source does not give them.",
            table=tables.methods(analysis),
        ),
        *_figures(analysis),
        *_coefficients(analysis),
        *_errors(analysis),
        _ranks(analysis),
        Section(
            "Evaluations to a misfit",
            text="Share of the runs that met a misfit, and evaluations to expect: all that were "
            "spent over the number of runs that met it. Intervals by bootstrap over the runs "
            "within each case; cases are not drawn anew.",
            table=tables.times(analysis),
        ),
        _diagnosis(analysis),
        _failures(analysis),
        Section("How it was made", facts=_facts(analysis)),
    ]
    return render("Comparison of identification algorithms", analysis.lead, sections)


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
    return [
        Section(
            name.replace("_", " ").capitalize(),
            text=text,
            table=tables.by_case(
                matrix(analysis.cells, name) / 100.0, tables.percent, average=True
            ),
        )
        for name, text in texts.items()
    ]


def _errors(analysis: StudyAnalysis) -> list[Section]:
    text = "The lowest mean of a case stands out."
    if names := tables.directed(analysis):
        text += (
            f" “Wrapped” takes the direction of the {listed(names)} as an angle, which the paper's "
            "form does not."
        )
    count = len(analysis.cells)
    cut = f" The first {MOST_ROWS} of {count} rows; cells.csv has all." if count > MOST_ROWS else ""
    return [
        Section("Err% by case and algorithm", text + cut, table=tables.errors(analysis)),
        Section(
            "Success rate",
            "Share of all runs, failed ones included, that reached an Err%.",
            table=tables.success(analysis),
        ),
    ]


def _ranks(analysis: StudyAnalysis) -> Section:
    ranks = analysis.ranks
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
        table=tables.pairs(ranks),
    )


def _diagnosis(analysis: StudyAnalysis) -> Section:
    at = analysis.threshold
    text = (
        f"A component counts as faulty from {at:g} of its range away from healthy. Missed: an "
        "injected fault not named. False alarm: a healthy component named. Confused: a run that "
        "missed a fault and named a healthy component instead."
    )
    if names := tables.directed(analysis):
        text += (
            f" The direction of the {listed(names)} counts only where there is one and it was "
            f"found; it is wrong from {at:g} of a turn."
        )
    return Section("Diagnosis", text=text, table=tables.diagnosis(analysis))


def _failures(analysis: StudyAnalysis) -> Section:
    count = len(analysis.failures)
    if not count:
        return Section("Failures", text="None: every run ended well.")
    text = f"{counted(count, 'run')} failed."
    if count > MOST_ROWS:
        text += f" The first {MOST_ROWS} are listed; results.csv has all."
    return Section("Failures", text, table=tables.failures(analysis))


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
