"""The same figures as still drawings (SVG, by matplotlib), and the critical-difference diagram.

Demsar (2006), J. Mach. Learn. Res. 7, 1-30, for the diagram; drawn by scikit-posthocs.
"""

import io
import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ematwin.analysis.conclusions import shown
from ematwin.analysis.convergence import bands
from ematwin.analysis.ranks import ALPHA
from ematwin.analysis.study import StudyAnalysis
from ematwin.errors import MissingExtraError
from ematwin.report.study_figures import MOST_CASES, MOST_POINTS, Group, bars_file, color, groups

_FINE = re.compile(r"(\d\.\d\d)\d+")


def check_extra() -> None:
    """Raise `MissingExtraError` unless matplotlib and scikit-posthocs are there."""
    try:
        import matplotlib
        import pandas
        import scikit_posthocs
    except ImportError as error:
        name = {"scikit_posthocs": "scikit-posthocs"}.get(str(error.name), str(error.name))
        raise MissingExtraError(name, "study", "The report of a study") from None
    del matplotlib, pandas, scikit_posthocs


def drawings(analysis: StudyAnalysis) -> dict[str, str]:
    """SVG texts by file name."""
    found = {}
    for group in groups(analysis):
        for metric, unit in (("err", "mean Err%"), ("seconds", "mean time, s")):
            found[bars_file(group, metric)] = _svg(
                partial(_bars, analysis=analysis, group=group, metric=metric, unit=unit),
                (9.0, 3.6),
            )
    rows = math.ceil(min(len(analysis.table.cases), MOST_CASES) / 2)
    found["convergence.svg"] = _svg(lambda f: _convergence(f, analysis, rows), (9.0, 2.5 * rows))
    found["distributions.svg"] = _svg(
        lambda f: _distributions(f, analysis, rows), (9.0, 2.5 * rows)
    )
    found["evaluations_to_target.svg"] = _svg(lambda f: _to_target(f, analysis), (7.0, 3.6))
    diagram = critical_difference(analysis)
    if diagram:
        found["critical_difference.svg"] = diagram
    return found


def critical_difference(analysis: StudyAnalysis) -> str:
    """Average ranks on a line, a bar over what does not differ; empty without ranks."""
    ranks = analysis.ranks
    if len(ranks.algorithms) < 2 or not np.isfinite(ranks.average_ranks).all():
        return ""
    import pandas
    import scikit_posthocs

    names = [shown(name) for name in ranks.algorithms]
    significance = pandas.DataFrame(ranks.significance(), index=names, columns=names)

    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        axes.spines["top"].set_visible(True)  # the line of the ranks
        made = scikit_posthocs.critical_difference_diagram(
            pandas.Series(ranks.average_ranks, index=names),
            significance,
            alpha=ALPHA,
            ax=axes,
            label_fmt_left="{label} ({rank:.2f})\N{NO-BREAK SPACE}",
            label_fmt_right="\N{NO-BREAK SPACE}({rank:.2f}) {label}",
            color_palette={name: color(n) for n, name in enumerate(names)},
            text_h_margin=0.08,
        )
        _draw_bars_again(axes, [line for bar in made["crossbars"] for line in bar])
        axes.set_xticks(range(1, len(names) + 1))

    return _svg(draw, (7.5, 1.0 + 0.28 * len(names)))


def _draw_bars_again(axes: Any, lines: list[Any]) -> None:
    """Bars in an order that does not hang on the hash of a name, with dots at their members.

    A bar may pass over an algorithm that is not of its group: the dots tell.
    """
    ends: list[float] = []  # of each level
    bars = sorted(sorted(line.get_xdata()) for line in lines)
    for line in lines:
        line.remove()
    for ranks in bars:
        level = next((n for n, end in enumerate(ends) if end < ranks[0]), len(ends))
        ends[level : level + 1] = [ranks[-1]]
        axes.plot(ranks, [-level - 1] * len(ranks), "k-o", lw=2.0, ms=5.0, zorder=3)


def _svg(draw: Callable[[Any], None], size: tuple[float, float]) -> str:
    """A drawing as text, the same for the same numbers."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    settings: Any = {
        "svg.hashsalt": "ematwin", "svg.fonttype": "none", "font.size": 9.0,
        "font.family": "sans-serif", "axes.spines.top": False, "axes.spines.right": False,
    }  # fmt: skip
    with rc_context(settings):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        sink = io.StringIO()
        figure.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    # a hundredth of a point is fine enough, and half as long
    return re.sub(r'(?<= d=")[^"]*', lambda path: _FINE.sub(r"\1", path[0]), sink.getvalue())


def _bars(figure: Any, analysis: StudyAnalysis, group: Group, metric: str, unit: str) -> None:
    axes = figure.add_subplot()
    algorithms = analysis.table.algorithms
    width = 0.8 / len(algorithms)
    places = np.arange(len(group.cases))
    for a, algorithm in enumerate(algorithms):
        spreads = [analysis.cells[c][a].metrics[metric] for c in group.cases]
        means = np.array([spread.mean for spread in spreads])
        intervals = np.array([spread.mean_interval for spread in spreads])
        reach = np.nan_to_num(np.abs(intervals.T - means))
        axes.bar(
            places + (a - (len(algorithms) - 1) / 2.0) * width, np.nan_to_num(means), width,
            yerr=reach, label=shown(algorithm), color=color(a),
            error_kw={"elinewidth": 0.8, "capsize": 1.5},
        )  # fmt: skip
    rotate = len(group.cases) > 6
    axes.set_xticks(places, [analysis.table.cases[c] for c in group.cases],
                    rotation=60 if rotate else 0)  # fmt: skip
    axes.set_ylabel(unit)
    axes.set_title(group.title, loc="left")
    axes.legend(ncols=len(algorithms), frameon=False, fontsize=8)


def _convergence(figure: Any, analysis: StudyAnalysis, rows: int) -> None:
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    for c, axes in enumerate(grid):
        if c >= min(len(analysis.table.cases), MOST_CASES):
            axes.set_visible(False)
            continue
        found = bands(analysis.table, c)
        for band in found:
            shade = color(analysis.table.algorithms.index(band.algorithm))
            known = np.isfinite(band.q3) & (band.q1 > 0.0)
            n = band.evaluations[known]
            axes.fill_between(n, band.q1[known], band.q3[known], color=shade, alpha=0.18, lw=0)
            axes.plot(n, band.median[known], color=shade, lw=1.2, label=shown(band.algorithm))
        axes.set_title(analysis.table.cases[c], loc="left", fontsize=9)
        if axes.lines and any(len(line.get_xdata()) for line in axes.lines):
            axes.set_xscale("log")
            axes.set_yscale("log")
        if c == 0 and found:
            axes.legend(frameon=False, fontsize=7, ncols=2)
    figure.supxlabel("simulations", fontsize=9)
    figure.supylabel("best misfit, A s", fontsize=9)


def _distributions(figure: Any, analysis: StudyAnalysis, rows: int) -> None:
    table = analysis.table
    done = table.done
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    for c, axes in enumerate(grid):
        if c >= min(len(table.cases), MOST_CASES):
            axes.set_visible(False)
            continue
        for a in range(len(table.algorithms)):
            part = table.cell(c, a)
            err = np.maximum(table.scalars["err"][part][done[part]], 1e-6)
            if len(err):
                # ends of the whiskers are the extremes, as on the page
                axes.boxplot(err, positions=[a], widths=0.6, whis=(0, 100),
                             medianprops={"color": color(a)})  # fmt: skip
                if len(err) <= MOST_POINTS:
                    axes.plot([a] * len(err), err, ".", ms=3.0, color=color(a), alpha=0.6)
        axes.set_xticks(range(len(table.algorithms)), [shown(name) for name in table.algorithms],
                        fontsize=7)  # fmt: skip
        if axes.lines:
            axes.set_yscale("log")
        axes.set_title(table.cases[c], loc="left", fontsize=9)
    figure.supylabel("Err%", fontsize=9)


def _to_target(figure: Any, analysis: StudyAnalysis) -> None:
    axes = figure.add_subplot()
    for a, curve in enumerate(analysis.to_target):
        if len(curve.evaluations):
            axes.step(curve.evaluations, curve.share, where="post", color=color(a),
                      label=shown(curve.algorithm))  # fmt: skip
            axes.set_xscale("log")
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("simulations")
    axes.set_ylabel("share of (run, target) pairs met")
    if axes.has_data():
        axes.legend(frameon=False, fontsize=8)
