"""Page: a study of algorithms, beside the paper's."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from ematwin.comparison.analysis.claims import OPEN
from ematwin.comparison.analysis.diagnosis import THRESHOLD
from ematwin.comparison.analysis.ranks import ALPHA
from ematwin.comparison.analysis.study import StudyAnalysis
from ematwin.comparison.analysis.summary import RESAMPLES
from ematwin.comparison.report import study_tables as tables
from ematwin.comparison.report.study_figures import MOST_CASES, MOST_POINTS, StudyFigures
from ematwin.comparison.report.study_svg import DIAGRAM
from ematwin.optimizers.presets import SINGLE
from ematwin.plots.panels import Figure, Spread
from ematwin.plots.study import interactive
from ematwin.report.page import Section, Table, render

Draw = Callable[[Figure], dict[str, Any]]
"""A figure as what a `Section` takes: a figure of plotly or a drawing."""


def study_page(
    analysis: StudyAnalysis, figures: StudyFigures, stills: dict[str, str], *, slim: bool = False
) -> str:
    """HTML page of a study.

    Parameters
    ----------
    figures : StudyFigures, of the analysis
    stills : dict, SVG texts by file name; the critical-difference diagram comes from here
    slim : bool, show the still drawings instead of interactive figures, which are 1.2 MB larger
    """

    def draw(figure: Figure) -> dict[str, Any]:
        if slim:
            return {"svg": _within_page(stills[figure.file])}
        return {"figure": interactive(figure)}

    table = analysis.table
    counted = (
        f"{len(table)} runs: {_counted(len(table.algorithms), 'algorithm')} on "
        f"{_counted(len(table.cases), 'case')}. {int(table.done.sum())} ended well"
        f"{_failed(analysis)}. Every number here is computed from the store alone."
    )
    sections = [
        Section("What can and cannot be concluded", text=counted, points=analysis.conclusions),
        Section(
            "The methods",
            text="Forms with settings as published stand beside improved ones; the last column "
            "says what settings were chosen on, where a source does not give them.",
            table=tables.methods(analysis),
        ),
        *_claims(analysis),
        *_bars(figures, draw),
        *_coefficients(analysis),
        *_errors(analysis, figures, draw),
        *_ranks(analysis, _within_page(stills.get(DIAGRAM, ""))),
        *_convergence(analysis, figures, draw),
        *_diagnosis(analysis),
        _failures(analysis),
        Section("How it was made", facts=_facts(analysis)),
    ]
    return render("Comparison of identification algorithms", lead_of(analysis), sections)


def lead_of(analysis: StudyAnalysis) -> str:
    """Who errs least, in a sentence, and whether that is more than chance."""
    wins: Counter[str] = Counter()
    judged = 0
    for row in analysis.cells:
        done = [cell for cell in row if cell.done and math.isfinite(cell.metrics["err"].mean)]
        if len(done) == len(row) and done:
            judged += 1
            wins[min(done, key=lambda cell: cell.metrics["err"].mean).algorithm] += 1
    if not wins or len(analysis.table.algorithms) < 2:
        done_runs = int(analysis.table.done.sum())
        return f"{done_runs} of {_counted(len(analysis.table), 'run')} ended well."
    best, count = wins.most_common(1)[0]
    tied = [name for name, won in wins.items() if won == count]
    if len(tied) > 1:
        return (
            f"{' and '.join(tied)} have the lowest mean Err% equally often, on {count} "
            f"of {_counted(judged, 'case')} each."
        )
    others = len(analysis.table.algorithms) - 1
    surely = sum(
        pair.p_holm < ALPHA and (pair.a12 > 0.5) == (pair.first == best)
        for pair in analysis.ranks.pairs
        if best in (pair.first, pair.second)
    )
    sure = "no test tells that from chance"
    if surely:
        whom = "the other" if others == 1 else f"{surely} of the {others} others"
        sure = f"it is better than {whom} by more than chance"
    where = f"{count} of {_counted(judged, 'case')}"
    return f"{best} has the lowest mean Err% on {where}; {sure}."


def _within_page(svg: str) -> str:
    """A drawing without what only a file of its own needs."""
    return svg[svg.find("<svg") :] if svg else ""


def _claims(analysis: StudyAnalysis) -> list[Section]:
    if not analysis.claims:
        return []
    return [
        Section(
            "The paper's claims, point by point",
            text="ESREL 2020, sections 7.2 and 8. A claim about one number is decided only where "
            f"its 95 % bootstrap interval (±, half its width) lies on one side of it, one about an "
            "order of means only where they differ by more than their intervals allow; otherwise "
            f"it “{OPEN}”. Coefficients and wins have no intervals and are read as they are. "
            f"{_forms(analysis)}",
            table=tables.claims(analysis),
        )
    ]


def _forms(analysis: StudyAnalysis) -> str:
    """Which methods stand for the paper's."""
    told = [f"{name.upper()} is {form}" for name, form in analysis.forms.items()]
    return f"Here {', '.join(told)}."


def _bars(figures: StudyFigures, draw: Draw) -> list[Section]:
    text = (
        "Bars are means over the runs; whiskers are 95 % bootstrap intervals of the mean "
        f"({RESAMPLES} resamples): search spread, not measurement uncertainty."
    )
    return [
        Section(figure.heading, text="" if n else text, **draw(figure))
        for n, figure in enumerate(figures.bars)
    ]


def _coefficients(analysis: StudyAnalysis) -> list[Section]:
    sections = []
    beside = tables.beside_paper(analysis)
    if beside.rows and len(analysis.shared) >= 2:
        sections += [
            Section(
                "Performance coefficient beside the paper's (table 2)",
                text="PC = 100 (1 - t err / sum of t err), t the mean seconds and err the mean "
                "Err% of an algorithm on a case, the sum over the paper's algorithms that the "
                "study has. It is 100 % less the algorithm's share in the sum of time times error "
                "of all of them, so a number depends on who else takes part; with six, a case adds "
                f"up to 500 %. {_forms(analysis)}",
                table=beside,
            ),
            Section(
                text="Rank correlation of the two halves: 1 is the same order, 0 none, -1 the "
                "reverse. The cells of a case are not independent, so no p-value is given.",
                table=tables.likeness(analysis),
            ),
        ]
    if len(analysis.table.algorithms) < 2:
        return sections
    if [*analysis.forms.values()] != analysis.table.algorithms or not sections:
        sections.append(
            Section(
                "Performance coefficient over all algorithms of the study",
                table=tables.coefficients(analysis),
            )
        )
    sections.append(
        Section(
            "Performance coefficient by evaluations",
            text="The same with evaluations in place of seconds, which no machine and no other "
            f"work on it changes.{_one_by_one(analysis)}",
            table=tables.coefficients_by_evaluations(analysis),
        )
    )
    return sections


def _one_by_one(analysis: StudyAnalysis) -> str:
    """A word on methods whose library evaluates one point at a time."""
    single = [name for name in analysis.table.algorithms if name in SINGLE]
    if not single:
        return ""
    return (
        f" {', '.join(single)}: the library asks for one point at a time, which takes 13 "
        "times as long as in a batch, so the seconds say little of the method."
    )


def _errors(analysis: StudyAnalysis, figures: StudyFigures, draw: Draw) -> list[Section]:
    cells = len(analysis.table.cases) * len(analysis.table.algorithms)
    left = (
        f" The first {tables.MOST_ROWS} of {cells} rows; cells.csv has all."
        if cells > tables.MOST_ROWS
        else ""
    )
    sections = [
        Section(
            "Err% by case and algorithm",
            text="The lowest mean of a case stands out." + _wrapped(analysis) + left,
            table=tables.errors(analysis),
        ),
        Section("Evaluations and time", text=left.strip(), table=tables.effort(analysis)),
        Section(
            "Success rate",
            text="Share of all runs, failed ones included, that reached an Err%.",
            table=tables.success(analysis),
        ),
    ]
    if analysis.table.done.any():
        sections.append(
            Section(
                figures.distributions.heading,
                text="Box: quartiles and median; whiskers: the extremes; dots: the runs, where "
                f"there are no more than {MOST_POINTS}." + _first_cases(analysis),
                **draw(figures.distributions),
            )
        )
    return sections


def _ranks(analysis: StudyAnalysis, diagram: str) -> list[Section]:
    if not analysis.ranks.pairs:
        return []
    return [
        Section(
            "Ranks and tests",
            text="Blocks are cases, each with the mean Err% of an algorithm; runs of one case "
            "share its fault and are not separate blocks. Wilcoxon's signed-rank test compares "
            "two algorithms over the cases, Holm's correction allows for the number of pairs. A12 "
            "is the chance that a run of the first has the lower Err% than one of the second on "
            "the same case; 0.5 is no difference. Pairs that differ at "
            f"{ALPHA:g} after correction stand out. {_least(analysis)} Ranks by the mean are "
            "ruled by single bad runs; those by the median forget them; those by evaluations "
            "count all that was spent until runs explained the recording to a stated misfit "
            "(cases in which no algorithm did count as ties). The tests are of the means.",
            table=tables.ranks(analysis),
        ),
        Section(
            text="Critical-difference diagram: average ranks, the best on the left; the dots on "
            "a bar are algorithms of which none is shown to differ from another."
            if diagram
            else "",
            svg=diagram,
        ),
        Section(table=tables.pairs(analysis.ranks)),
        *(
            Section(
                text=f"Among the methods of the preset {preset} alone, which makes "
                f"{_counted(len(ranks.pairs), 'pair')} and a smallest corrected p of "
                f"{ranks.smallest_holm:.2g}:",
                table=tables.pairs(ranks),
            )
            for preset, ranks in analysis.within.items()
        ),
        Section(
            "Effect sizes, case by case",
            text="A12 of the algorithm with the lowest average rank against each other one: the "
            "chance that its run has the lower Err%. effects.csv has all pairs.",
            table=tables.effects(analysis),
        ),
    ]


def _least(analysis: StudyAnalysis) -> str:
    """How small a corrected p can be at all."""
    ranks = analysis.ranks
    return (
        f"With {_counted(len(ranks.blocks), 'case')} and {_counted(len(ranks.pairs), 'pair')} no "
        f"corrected p can fall below {ranks.smallest_holm:.2g}."
    )


def _convergence(analysis: StudyAnalysis, figures: StudyFigures, draw: Draw) -> list[Section]:
    if not len(analysis.table.history_cost):
        return [
            Section(
                figures.convergence.heading,
                text="No run kept a history, so no curves can be drawn.",
            )
        ]
    return [
        Section(
            figures.convergence.heading,
            text="Median and quartiles of the best misfit over the runs." + _first_cases(analysis),
            **draw(figures.convergence),
        ),
        Section(
            figures.to_target.heading,
            text="A target is a misfit relative to a twin that does not answer: 31 of them, "
            "evenly spaced in their logarithm from 50 % to 0.3 %, the same in every study. The "
            "curve is the share of all pairs of run and target met, over all cases"
            f"{_bands(figures)}. Where the twin itself is farther from the record than a target, "
            "nobody meets it; and a small misfit need not mean a small Err%.",
            **draw(figures.to_target),
        ),
        Section(
            text="Share of the runs that met a misfit, and evaluations to expect: all that were "
            "spent over the number of runs that met it. Intervals by bootstrap over the runs "
            "within each case; cases are not drawn anew.",
            table=tables.to_target(analysis),
        ),
    ]


def _bands(figures: StudyFigures) -> str:
    drawn = isinstance(figures.to_target.panels[0].series[0], Spread)
    return ", with 95 % bootstrap intervals" if drawn else ""


def _wrapped(analysis: StudyAnalysis) -> str:
    names = _directed(analysis)
    if not names:
        return ""
    return (
        f" “Wrapped” takes the direction of the {names} as an angle, which the paper's form does "
        "not."
    )


def _directed(analysis: StudyAnalysis) -> str:
    """The faults that have a direction."""
    subject = analysis.table.subject
    return " and ".join(subject.names[magnitude] for magnitude, _ in subject.directions)


def _diagnosis(analysis: StudyAnalysis) -> list[Section]:
    at, subject = analysis.threshold, analysis.table.subject
    share = "" if (subject.upper - subject.lower == 1.0).all() else " of its range"
    text = (
        f"A component counts as faulty from {at:g}{share} away from healthy"
        f"{' (the default)' if at == THRESHOLD else ''}. Missed: an injected fault not named. "
        "False alarm: a healthy component named. Confused: a run that missed a fault and named "
        "a healthy component instead."
    )
    if names := _directed(analysis):
        text += (
            f" The direction of the {names} counts only where there is one and it was found; it is "
            f"wrong from {at:g} of a turn."
        )
    return [Section("Diagnosis", text=text, table=tables.diagnosis(analysis))]


def _failures(analysis: StudyAnalysis) -> Section:
    count = len(analysis.failures)
    if not count:
        return Section("Failures", text="None: every run ended well.")
    text = f"{_counted(count, 'run')} failed."
    if count > tables.MOST_ROWS:
        text += f" The first {tables.MOST_ROWS} are listed; results.csv has all."
    return Section("Failures", text=text, table=tables.failures(analysis))


def _facts(analysis: StudyAnalysis) -> dict[str, str]:
    found = {}
    for name, values in analysis.table.settings.items():
        found[name] = _listed(values)
    for name, values in analysis.table.provenance.items():
        if name == "system":  # the kernel's build tells nothing of the numbers
            values = Counter({value.split("-")[0]: count for value, count in values.items()})
        # names of machines are nobody's business in a report that is passed on
        found["machines" if name == "machine" else name] = (
            str(len(values)) if name == "machine" else _listed(values)
        )
    return found


def _listed(values: Any) -> str:
    if len(values) == 1:
        return str(next(iter(values)))
    most = values.most_common(5)
    more = f" and {len(values) - 5} more" if len(values) > 5 else ""
    return "; ".join(f"{value} ({count} runs)" for value, count in most) + more


def _first_cases(analysis: StudyAnalysis) -> str:
    count = len(analysis.table.cases)
    if count <= MOST_CASES:
        return ""
    return f" The first {MOST_CASES} of {count} cases are drawn."


def _failed(analysis: StudyAnalysis) -> str:
    return f", {len(analysis.failures)} did not" if analysis.failures else ""


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def latex_tables(analysis: StudyAnalysis) -> dict[str, tuple[Table, str]]:
    """Tables and captions by the name of their file."""
    return {
        "errors": (tables.errors(analysis), "Err% by case and algorithm"),
        "effort": (tables.effort(analysis), "Evaluations and time by case and algorithm"),
        "success": (tables.success(analysis), "Share of runs that reached an Err%"),
        "coefficients": (tables.coefficients(analysis), "Performance coefficient"),
        "beside_paper": (
            tables.beside_paper(analysis),
            "Performance coefficient beside the paper's Table 2",
        ),
        "methods": (tables.methods(analysis), "Methods, their sources and departures"),
        "coefficients_by_evaluations": (
            tables.coefficients_by_evaluations(analysis),
            "Performance coefficient by evaluations",
        ),
        "ranks": (tables.ranks(analysis), "Average ranks"),
        "effects": (tables.effects(analysis), "Effect sizes (A12) by case"),
        "pairs": (tables.pairs(analysis.ranks), "Pairs of algorithms: Wilcoxon, Holm, A12"),
        "to_target": (tables.to_target(analysis), "Evaluations to target"),
        "diagnosis": (tables.diagnosis(analysis), f"Diagnosis at {analysis.threshold:g}"),
        "failures": (tables.failures(analysis), "Failed runs"),
    }
