"""Figures of a study, by plotly: they can be enlarged, and tell their numbers."""

import math
from typing import Any

import numpy as np

from ematwin.plots.panels import Bars, Box, Figure, Panel, Spread, Stairs
from ematwin.plots.style import GREY, styled


def plot_study(analysis: Any) -> dict[str, Any]:
    """Every figure of a study by its heading.

    Means with their intervals, convergence, distributions of Err%, evaluations to target.

    Parameters
    ----------
    analysis : `StudyAnalysis`, as `ematwin.compare` gives it

    Returns
    -------
    dict of plotly.graph_objects.Figure
    """
    return {figure.heading: interactive(figure) for figure in analysis.figures.all}


def interactive(figure: Figure) -> Any:
    """A figure of plotly."""
    from plotly.graph_objects import Figure as PlotlyFigure

    drawn = _grid(figure) if figure.grid else styled(PlotlyFigure(), _height(figure))
    for n, panel in enumerate(figure.panels):
        where = {"row": n // 2 + 1, "col": n % 2 + 1} if figure.grid else {}
        for series in panel.series:
            match series:
                case Bars():
                    _bars(drawn, series, panel)
                case Spread():
                    _spread(drawn, series, first=n == 0, where=where)
                case Box():
                    _box(drawn, series, first=n == 0, where=where)
                case Stairs():
                    drawn.add_scatter(
                        x=short(series.x), y=short(series.y), name=series.name, mode="lines",
                        line={"color": series.color, "shape": "hv"},
                    )  # fmt: skip
    _axes(drawn, figure)
    return drawn


def _height(figure: Figure) -> int:
    return 400 if figure.panels[0].categories else 420


def _grid(figure: Figure) -> Any:
    """Panels, two in a row."""
    from plotly.subplots import make_subplots

    rows = math.ceil(len(figure.panels) / 2)
    drawn = make_subplots(
        rows=rows,
        cols=2,
        subplot_titles=[panel.title for panel in figure.panels],
        vertical_spacing=min(0.08, 0.35 / rows),
        horizontal_spacing=0.09,
    )
    styled(drawn, 70 + 260 * rows)
    for n, note in enumerate(drawn.layout.annotations):
        note.x = drawn.layout[f"xaxis{n + 1 if n else ''}"].domain[0]
    # room for the legend above the first titles
    drawn.update_layout(legend={"y": 1.0 + 30.0 / (260.0 * rows)}, margin={"t": 70})
    drawn.update_layout(hovermode="closest")
    return drawn


def _axes(drawn: Any, figure: Figure) -> None:
    rows = math.ceil(len(figure.panels) / 2)
    for row in range(1, rows + 1) if figure.grid else [None]:
        drawn.update_yaxes(title_text=figure.y_title, row=row, col=row and 1)
    if figure.x_title:
        drawn.update_xaxes(title_text=figure.x_title, row=rows if figure.grid else None)
    if figure.log_x:
        drawn.update_xaxes(type="log", exponentformat="power")
    if figure.log_y:
        drawn.update_yaxes(type="log", exponentformat="power" if figure.log_x else "none")
    if figure.y_range is not None:
        drawn.update_yaxes(range=list(figure.y_range))
    if any(isinstance(series, Bars) for series in figure.panels[0].series):
        _choice_of_scale(drawn)


def _choice_of_scale(drawn: Any) -> None:
    """Buttons for a linear or a logarithmic axis."""
    drawn.update_layout(
        barmode="group",
        hovermode="closest",
        updatemenus=[{
            "type": "buttons", "direction": "right", "x": 0.0, "xanchor": "left", "y": 1.02,
            "yanchor": "bottom", "showactive": True, "pad": {"r": 0, "t": 0},
            "buttons": [
                {"label": scale, "method": "relayout", "args": [{"yaxis.type": scale}]}
                for scale in ("linear", "log")
            ],
        }],
    )  # fmt: skip
    drawn.update_yaxes(rangemode="tozero")


def _bars(drawn: Any, bars: Bars, panel: Panel) -> None:
    drawn.add_bar(
        x=list(panel.categories),
        y=short(bars.height),
        name=bars.name,
        marker_color=bars.color,
        error_y={
            "type": "data",
            "array": short(np.nan_to_num(bars.high - bars.height)),
            "arrayminus": short(np.nan_to_num(bars.height - bars.low)),
            "thickness": 1,
            "width": 2,
        },
    )


def _spread(drawn: Any, spread: Spread, first: bool, where: dict[str, int]) -> None:
    shared = {"legendgroup": spread.name, "name": spread.name, "mode": "lines"}
    drawn.add_scatter(
        x=short(np.concatenate([spread.x, spread.x[::-1]])),
        y=short(np.concatenate([spread.high, spread.low[::-1]])),
        fill="toself", fillcolor=spread.color, opacity=0.18, line={"width": 0}, hoverinfo="skip",
        showlegend=False, **shared, **where,
    )  # fmt: skip
    drawn.add_scatter(
        x=short(spread.x), y=short(spread.middle), line={"color": spread.color, "width": 1.5},
        showlegend=first, **shared, **where,
    )  # fmt: skip


def _box(drawn: Any, box: Box, first: bool, where: dict[str, int]) -> None:
    """Quartiles as a bar, extremes as whiskers, the median as a dash."""
    low, q1, median, q3, high = box.quantiles.tolist()
    shared = {"x": [box.name], "legendgroup": box.name, "name": box.name, "showlegend": False}
    drawn.add_bar(
        **{**shared, "showlegend": first}, y=short([q3 - q1]), base=short([q1]), width=0.5,
        marker={"color": box.color, "opacity": 0.45, "line": {"color": box.color, "width": 1.5}},
        hovertemplate=f"quartiles {q1:.3g} to {q3:.3g}, median {median:.3g}, "
        f"{low:.3g} to {high:.3g}<extra>{box.name}</extra>", **where,
    )  # fmt: skip
    drawn.add_scatter(
        **shared, y=short([median]), mode="markers", hoverinfo="skip",
        marker={"symbol": "line-ew", "size": 18, "line": {"color": box.color, "width": 3}},
        error_y={"type": "data", "symmetric": False, "array": short([high - median]),
                 "arrayminus": short([median - low]), "color": GREY, "thickness": 1, "width": 4},
        **where,
    )  # fmt: skip
    if len(box.points):
        drawn.add_scatter(
            **{**shared, "x": [box.name] * len(box.points)}, y=short(box.points), mode="markers",
            marker={"color": box.color, "size": 4, "opacity": 0.6}, **where,
        )  # fmt: skip


def short(values: Any) -> list[float | None]:
    """Numbers to four digits, as small in the page as they can be; None where there is none."""
    return [
        float(f"{value:.4g}") if math.isfinite(value) else None
        for value in np.asarray(values, dtype=float).tolist()
    ]
