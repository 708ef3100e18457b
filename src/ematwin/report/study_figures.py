"""Interactive figures of a study: counterparts of the paper's figures 4 to 7, and more."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ematwin.analysis.conclusions import shown
from ematwin.analysis.convergence import Band, bands
from ematwin.analysis.paper import HIGH_CASES, LOW_CASES
from ematwin.analysis.study import StudyAnalysis
from ematwin.report.figures import styled

# Okabe and Ito, told apart by colour-blind readers; the last two for a seventh and eighth method.
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c959f")
MOST_CASES = 12  # with a panel of their own
MOST_POINTS = 30  # runs of a cell drawn one by one


@dataclass(frozen=True)
class Group:
    """Cases shown in one bar chart."""

    title: str
    name: str  # of files
    cases: list[int]


def color(place: int) -> str:
    """Colour of the algorithm at a place."""
    return PALETTE[place % len(PALETTE)]


def groups(analysis: StudyAnalysis) -> list[Group]:
    """Low and high faults of the paper; other cases follow in their order."""
    names = analysis.table.cases
    low = [c for c, name in enumerate(names) if name in LOW_CASES]
    high = [c for c, name in enumerate(names) if name in HIGH_CASES]
    other = [c for c in range(len(names)) if c not in low and c not in high]
    found = [
        Group("low faults", "low", low),
        Group("high faults", "high", high),
        Group("cases", "cases", other[: 2 * MOST_CASES]),
    ]
    return [group for group in found if group.cases]


def bars(analysis: StudyAnalysis, group: Group, metric: str, title: str) -> Any:
    """Mean of a metric with its bootstrap interval, by case and algorithm."""
    from plotly.graph_objects import Figure

    figure = Figure()
    for a, algorithm in enumerate(analysis.table.algorithms):
        cells = [analysis.cells[c][a] for c in group.cases]
        means = np.array([cell.metrics[metric].mean for cell in cells])
        intervals = np.array([cell.metrics[metric].mean_interval for cell in cells])
        figure.add_bar(
            x=[cell.case for cell in cells],
            y=short(means),
            name=shown(algorithm),
            marker_color=color(a),
            error_y={
                "type": "data",
                "array": short(np.nan_to_num(intervals[:, 1] - means)),
                "arrayminus": short(np.nan_to_num(means - intervals[:, 0])),
                "thickness": 1,
                "width": 2,
            },
        )
    styled(figure, 400)
    figure.update_layout(
        barmode="group",
        hovermode="closest",
        updatemenus=[{
            "type": "buttons", "direction": "right", "x": 0.0, "xanchor": "left", "y": 1.02,
            "yanchor": "bottom", "showactive": True, "pad": {"r": 0, "t": 0},
            "buttons": [
                {"label": scale, "method": "relayout", "args": [{"yaxis.type": kind}]}
                for scale, kind in (("linear", "linear"), ("log", "log"))
            ],
        }],
    )  # fmt: skip
    figure.update_yaxes(title_text=title, rangemode="tozero")
    return named(figure, bars_file(group, metric))


def bars_file(group: Group, metric: str) -> str:
    """Name of the still drawing of `bars`; the paper's figures keep their numbers."""
    number = {
        ("low", "err"): "4", ("high", "err"): "5", ("low", "seconds"): "6", ("high", "seconds"): "7"
    }.get((group.name, metric), "")  # fmt: skip
    return f"figure{number}_{'errors' if metric == 'err' else 'seconds'}_{group.name}.svg"


def named(figure: Any, drawing: str) -> Any:
    """The figure with the name of the still drawing that shows the same."""
    figure.update_layout(meta=drawing)
    return figure


def panels(titles: list[str], y_title: str, x_title: str = "") -> Any:
    """A grid of panels, two in a row."""
    from plotly.subplots import make_subplots

    rows = math.ceil(len(titles) / 2)
    figure = make_subplots(
        rows=rows,
        cols=2,
        subplot_titles=titles,
        vertical_spacing=min(0.08, 0.35 / rows),
        horizontal_spacing=0.09,
    )
    styled(figure, 70 + 260 * rows)
    for n, note in enumerate(figure.layout.annotations):
        note.x = figure.layout[f"xaxis{n + 1 if n else ''}"].domain[0]
    for row in range(1, rows + 1):
        figure.update_yaxes(title_text=y_title, row=row, col=1)
    if x_title:
        figure.update_xaxes(title_text=x_title, row=rows)
    # room for the legend above the first titles
    figure.update_layout(legend={"y": 1.0 + 30.0 / (260.0 * rows)}, margin={"t": 70})
    figure.update_layout(hovermode="closest")
    return figure


def convergence(analysis: StudyAnalysis) -> Any:
    """Median and quartiles of the best cost over the evaluations, a panel for each case."""
    cases = analysis.table.cases[:MOST_CASES]
    figure = panels(cases, "best misfit, A s", "simulations")
    for c in range(len(cases)):
        for band in bands(analysis.table, c):
            _band(figure, band, analysis.table.algorithms.index(band.algorithm), c)
    figure.update_yaxes(type="log", exponentformat="power")
    figure.update_xaxes(type="log", exponentformat="power")
    return named(figure, "convergence.svg")


def _band(figure: Any, band: Band, place: int, case: int) -> None:
    where = {"row": case // 2 + 1, "col": case % 2 + 1}
    known = np.isfinite(band.q3) & (band.q1 > 0.0)
    n = band.evaluations[known]
    name = shown(band.algorithm)
    shared = {"legendgroup": name, "name": name, "mode": "lines"}
    figure.add_scatter(
        x=short(np.concatenate([n, n[::-1]])),
        y=short(np.concatenate([band.q3[known], band.q1[known][::-1]])),
        fill="toself", fillcolor=color(place), opacity=0.18, line={"width": 0}, hoverinfo="skip",
        showlegend=False, **shared, **where,
    )  # fmt: skip
    figure.add_scatter(
        x=short(n), y=short(band.median[known]), line={"color": color(place), "width": 1.5},
        showlegend=case == 0, **shared, **where,
    )  # fmt: skip


def distributions(analysis: StudyAnalysis) -> Any:
    """Boxes of Err%, with the runs themselves where they are few; a panel for each case."""
    table = analysis.table
    cases = table.cases[:MOST_CASES]
    figure = panels(cases, "Err%")
    done = table.done
    for c in range(len(cases)):
        where = {"row": c // 2 + 1, "col": c % 2 + 1}
        for a, algorithm in enumerate(table.algorithms):
            part = table.cell(c, a)
            err = np.maximum(table.scalars["err"][part][done[part]], 1e-6)  # the axis is a log
            if not len(err):
                continue
            low, q1, median, q3, high = np.quantile(err, [0.0, 0.25, 0.5, 0.75, 1.0])
            name = shown(algorithm)
            figure.add_box(
                x=[name], q1=short([q1]), median=short([median]), q3=short([q3]),
                lowerfence=short([low]), upperfence=short([high]), name=name, legendgroup=name,
                marker_color=color(a), showlegend=c == 0, **where,
            )  # fmt: skip
            if len(err) <= MOST_POINTS:
                figure.add_scatter(
                    x=[name] * len(err), y=short(err), mode="markers", legendgroup=name, name=name,
                    marker={"color": color(a), "size": 4, "opacity": 0.6}, showlegend=False,
                    **where,
                )  # fmt: skip
    figure.update_yaxes(type="log", exponentformat="none")
    return named(figure, "distributions.svg")


def to_target(analysis: StudyAnalysis) -> Any:
    """Share of runs and targets met over the evaluations."""
    from plotly.graph_objects import Figure

    figure = Figure()
    for a, curve in enumerate(analysis.to_target):
        figure.add_scatter(
            x=short(curve.evaluations), y=short(curve.share), name=shown(curve.algorithm),
            mode="lines", line={"color": color(a), "shape": "hv"},
        )  # fmt: skip
    styled(figure, 420)
    figure.update_xaxes(type="log", title_text="simulations", exponentformat="power")
    figure.update_yaxes(range=[0.0, 1.02], title_text="share of (run, target) pairs met")
    return named(figure, "evaluations_to_target.svg")


def short(values: Any) -> list[float | None]:
    """Numbers to four digits, as small in the page as they can be; None where there is none."""
    return [
        float(f"{value:.4g}") if math.isfinite(value) else None
        for value in np.asarray(values, dtype=float).tolist()
    ]
