"""The figures of a study as still drawings (SVG, by matplotlib); the critical-difference diagram.

Demsar (2006), J. Mach. Learn. Res. 7, 1-30, for the diagram; drawn by scikit-posthocs.
"""

import io
import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ematwin.comparison.analysis.ranks import ALPHA
from ematwin.comparison.analysis.study import StudyAnalysis
from ematwin.comparison.report.study_figures import color
from ematwin.errors import MissingExtraError
from ematwin.plots.panels import Bars, Box, Figure, Panel, Spread, Stairs

DIAGRAM = "critical_difference.svg"
_LINES = 8  # of a legend in one column
_IN_A_LINE = 7  # entries of a legend above bars
_LETTERS = 30  # of all names below a narrow panel, above which they stand upright
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


def still(figure: Figure) -> str:
    """A figure as SVG text."""
    if figure.grid:
        rows = math.ceil(len(figure.panels) / 2)
        return _svg(partial(_draw_grid, figure=figure, rows=rows), (9.0, 2.5 * rows))
    width = 9.0 if figure.panels[0].categories else 7.0
    return _svg(partial(_draw_alone, figure=figure), (width, 3.6))


def critical_difference(analysis: StudyAnalysis) -> str:
    """Average ranks on a line, a bar over what does not differ; empty without ranks."""
    ranks = analysis.ranks
    if len(ranks.algorithms) < 2 or not np.isfinite(ranks.average_ranks).all():
        return ""
    import pandas
    import scikit_posthocs

    names = [name for name in ranks.algorithms]
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
    """Bars in an order that does not depend on the hash of a name, with dots at their members.

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
    from matplotlib.figure import Figure as Canvas

    settings: Any = {
        "svg.hashsalt": "ematwin", "svg.fonttype": "none", "font.size": 9.0,
        "font.family": "sans-serif", "axes.spines.top": False, "axes.spines.right": False,
    }  # fmt: skip
    with rc_context(settings):
        canvas = Canvas(figsize=size, layout="constrained")
        draw(canvas)
        sink = io.StringIO()
        canvas.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    # a hundredth of a point is fine enough, and half as long
    return re.sub(r'(?<= d=")[^"]*', lambda path: _FINE.sub(r"\1", path[0]), sink.getvalue())


def _draw_alone(canvas: Any, figure: Figure) -> None:
    axes = canvas.add_subplot()
    (panel,) = figure.panels
    _series(axes, panel)
    if panel.categories:
        _name_categories(axes, panel, rotation=60 if len(panel.categories) > 6 else 0)
    if figure.log_x and _has_data(panel):
        axes.set_xscale("log")
    if figure.y_range is not None:
        axes.set_ylim(*figure.y_range)
    if figure.x_title:
        axes.set_xlabel(figure.x_title)
    axes.set_ylabel(figure.y_title)
    if panel.title:
        axes.set_title(panel.title, loc="left")
    if _has_data(panel):
        columns = -(-len(panel.series) // _LINES) if not panel.categories else _IN_A_LINE
        axes.legend(ncols=min(columns, len(panel.series)), frameon=False, fontsize=8)


def _draw_grid(canvas: Any, figure: Figure, rows: int) -> None:
    """Panels, two in a row, with the titles of the axes at the edges."""
    grid = canvas.subplots(rows, 2, squeeze=False).ravel()
    for axes in grid[len(figure.panels) :]:
        axes.set_visible(False)
    for n, (axes, panel) in enumerate(zip(grid, figure.panels, strict=False)):
        _series(axes, panel)
        if panel.categories:
            crowded = sum(map(len, panel.categories)) > _LETTERS
            _name_categories(axes, panel, fontsize=7, rotation=90 if crowded else 0)
        axes.set_title(panel.title, loc="left", fontsize=9)
        if figure.log_x and _has_data(panel):
            axes.set_xscale("log")
        if figure.log_y and _has_data(panel):
            axes.set_yscale("log")
        if n == 0 and panel.series and not panel.categories:
            axes.legend(frameon=False, fontsize=5 if len(panel.series) > _LINES else 7, ncols=2)
    if figure.x_title:
        canvas.supxlabel(figure.x_title, fontsize=9)
    canvas.supylabel(figure.y_title, fontsize=9)


def _name_categories(axes: Any, panel: Panel, **style: Any) -> None:
    axes.set_xticks(range(len(panel.categories)), panel.categories, **style)


def _has_data(panel: Panel) -> bool:
    """Whether anything is drawn: an empty axis takes no logarithm."""
    return any(len(s.x) if isinstance(s, (Spread, Stairs)) else True for s in panel.series)


def _series(axes: Any, panel: Panel) -> None:
    for n, series in enumerate(panel.series):
        match series:
            case Bars():
                _bars(axes, series, n, len(panel.series))
            case Spread():
                axes.fill_between(
                    series.x, series.low, series.high, color=series.color, alpha=0.18, lw=0
                )
                axes.plot(series.x, series.middle, color=series.color, lw=1.2, label=series.name)
            case Box():
                _box(axes, series)
            case Stairs() if len(series.x):
                axes.step(series.x, series.y, where="post", color=series.color, label=series.name)


def _bars(axes: Any, bars: Bars, place: int, count: int) -> None:
    """The bars of one of ``count`` algorithms, beside those of the others."""
    width = 0.8 / count
    reach = np.nan_to_num(np.abs([bars.low - bars.height, bars.high - bars.height]))
    axes.bar(
        np.arange(len(bars.height)) + (place - (count - 1) / 2.0) * width,
        np.nan_to_num(bars.height), width, yerr=reach, label=bars.name, color=bars.color,
        error_kw={"elinewidth": 0.8, "capsize": 1.5},
    )  # fmt: skip


def _box(axes: Any, box: Box) -> None:
    low, q1, median, q3, high = box.quantiles
    numbers = {"whislo": low, "q1": q1, "med": median, "q3": q3, "whishi": high, "fliers": []}
    axes.bxp([numbers], positions=[box.place], widths=0.6, medianprops={"color": box.color})
    if len(box.points):
        x = [box.place] * len(box.points)
        axes.plot(x, box.points, ".", ms=3.0, color=box.color, alpha=0.6)
