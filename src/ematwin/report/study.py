"""Figures of a study of search methods."""

import math
from itertools import cycle
from typing import Any

import numpy as np

from ematwin.report.style import empty, entry, error_bars, styled

# Okabe and Ito, told apart by colour-blind readers; from the ninth on Tol's muted ones.
PALETTE = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c959f",
    "#332288", "#882255", "#117733", "#999933", "#44aa99", "#aa4499", "#ddcc77", "#661100",
)  # fmt: skip
MOST_CASES = 12  # with bars or a panel of their own


def plot_study(analysis: Any) -> dict[str, Any]:
    """Every figure of a study by its heading, from the `StudyAnalysis` of `ematwin.compare`.

    Means with their intervals, average ranks, convergence, distributions of Err%, evaluations to
    target; what has no data is left out.
    """
    drawn = {
        "Mean Err%": _means(analysis, "err", "mean Err%"),
        "Mean time of a search": _means(analysis, "seconds", "mean time, s"),
        "Average ranks": _ranks(analysis),
        "Convergence": _convergence(analysis),
        "Distribution of Err%": _distributions(analysis),
        "Evaluations to target": _targets(analysis),
    }
    return {heading: figure for heading, figure in drawn.items() if figure.data}


def _colors(analysis: Any) -> dict[str, str]:
    """Colours by algorithm."""
    return dict(zip(analysis.table.algorithms, cycle(PALETTE), strict=False))


def _means(analysis: Any, metric: str, title: str) -> Any:
    """Means with their bootstrap intervals, by case and algorithm."""
    figure = empty(400)
    for name, color in _colors(analysis).items():
        cells = analysis.cells[analysis.cells["algorithm"] == name].head(MOST_CASES)
        mean = cells[f"{metric}_mean"]
        if mean.isna().all():
            continue
        figure.add_bar(
            x=list(cells["case"]), y=_short(mean), name=name, marker_color=color,
            error_y=error_bars(
                _short((cells[f"{metric}_mean_high_95"] - mean).fillna(0.0)),
                _short((mean - cells[f"{metric}_mean_low_95"]).fillna(0.0)), thickness=1, width=2,
            ),
        )  # fmt: skip
    buttons = [
        {"label": scale, "method": "relayout", "args": [{"yaxis.type": scale}]}
        for scale in ("linear", "log")
    ]
    menu = {
        "type": "buttons", "direction": "right", "x": 0.0, "xanchor": "left", "y": 1.02,
        "yanchor": "bottom", "pad": {"r": 0, "t": 0}, "buttons": buttons,
    }  # fmt: skip
    figure.update_layout(barmode="group", hovermode="closest", updatemenus=[menu])
    return figure.update_yaxes(title_text=title, rangemode="tozero")


def _ranks(analysis: Any) -> Any:
    """Average ranks; a line joins algorithms that do not differ significantly (Demsar 2006)."""
    ranks = analysis.ranks
    known = len(ranks.average) > 1 and all(map(math.isfinite, ranks.average.values()))
    order = ranks.order if known else []
    figure = empty(170 + 24 * len(order))
    reached = 0
    for n, name in enumerate(order):
        alike = n + 1
        while alike < len(order) and not any(
            ranks.differ(order[alike], other) for other in order[n:alike]
        ):
            alike += 1
        if alike > max(n + 1, reached):
            reached = alike
            x = [ranks.average[name], ranks.average[order[alike - 1]]]
            level = [-0.5 - 0.35 * n] * 2
            figure.add_scatter(
                x=x, y=level, mode="lines", line={"width": 5, "color": "#8c959f"},
                hoverinfo="skip", showlegend=False,
            )  # fmt: skip
    for n, name in enumerate(order):
        color = _colors(analysis)[name]
        figure.add_scatter(
            x=[ranks.average[name]], y=[n + 0.5], mode="markers+text", text=[name], name=name,
            textposition="middle right", marker={"color": color, "size": 11}, showlegend=False,
        )  # fmt: skip
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(title_text="average rank by mean Err%, 1 the best")
    return figure.update_yaxes(visible=False, autorange="reversed")


def _convergence(analysis: Any) -> Any:
    """Median and quartiles of the best cost over the evaluations, a panel for each case."""
    figure, places = _panels(analysis)
    colors, frame = _colors(analysis), analysis.bands
    bands = frame.groupby(["case", "algorithm"], sort=False) if len(frame) else ()
    for (case, name), band in bands:
        band = band[np.isfinite(band["q3"]) & (band["q1"] > 0.0)]
        if case in places and len(band):
            _spread(figure, name, colors[name], band, ("median", "q1", "q3"), places[case])
    figure.update_xaxes(type="log", exponentformat="power")
    figure.update_yaxes(type="log", exponentformat="power")
    return _titled(figure, places, "best misfit", "simulations")


def _distributions(analysis: Any) -> Any:
    """Median and quartiles of Err%, with the runs where they are few; a panel for each case."""
    figure, places = _panels(analysis)
    errors = analysis.table.frame["err"].to_numpy(dtype=float)
    cells = analysis.cells.set_index(["case", "algorithm"])
    least = 1e-6  # per cent: the axis is a logarithm
    for case, place in places.items():
        for name, color in _colors(analysis).items():
            cell, rows = cells.loc[(case, name)], analysis.table.cells[case, name]
            if not cell["done"]:
                continue
            q1, median, q3 = np.maximum(cell[["err_q1", "err_median", "err_q3"]], least)
            figure.add_scatter(
                x=[name], y=_short([median]), mode="markers", **entry(figure, name),
                marker={"symbol": "line-ew", "size": 18, "line": {"color": color, "width": 3}},
                error_y=error_bars(
                    _short([q3 - median]), _short([median - q1]), color=color, width=6
                ),
                hovertemplate=f"median {median:.3g}, quartiles {q1:.3g} to {q3:.3g}", **place,
            )  # fmt: skip
            if len(rows) <= 30:  # runs of a cell drawn one by one
                err = np.maximum(errors[rows[analysis.table.done[rows]]], least)
                figure.add_scatter(
                    x=[name] * len(err), y=_short(err), mode="markers", showlegend=False,
                    name=name, legendgroup=name, hoverinfo="y",
                    marker={"color": color, "size": 4, "opacity": 0.6}, **place,
                )  # fmt: skip
    figure.update_yaxes(type="log", exponentformat="none")
    return _titled(figure, places, "Err%")


def _targets(analysis: Any) -> Any:
    """Share of pairs of run and target met over the evaluations."""
    figure = empty(420)
    colors, curves = _colors(analysis), analysis.curves
    for name, curve in curves.groupby("algorithm", sort=False) if len(curves) else ():
        _spread(figure, name, colors[name], curve, ("share", "low_95", "high_95"))
    figure.update_xaxes(title_text="simulations", type="log", exponentformat="power")
    title = "share of (run, target) pairs met"
    return figure.update_yaxes(title_text=title, range=[0.0, 1.02])


def _panels(analysis: Any) -> tuple[Any, dict[str, dict[str, int]]]:
    """A figure with a panel for each case, two in a row, and their places."""
    from plotly.subplots import make_subplots

    cases = analysis.table.cases[:MOST_CASES]
    rows = math.ceil(len(cases) / 2)
    figure = make_subplots(
        rows=rows, cols=2, subplot_titles=cases, vertical_spacing=min(0.08, 0.35 / rows),
        horizontal_spacing=0.09,
    )  # fmt: skip
    styled(figure, 70 + 260 * rows)
    # room for the legend above the first titles
    legend = {"y": 1.0 + 30.0 / (260.0 * rows)}
    figure.update_layout(legend=legend, margin={"t": 70}, hovermode="closest")
    return figure, {case: {"row": n // 2 + 1, "col": n % 2 + 1} for n, case in enumerate(cases)}


def _titled(figure: Any, places: dict[str, dict[str, int]], y: str, x: str = "") -> Any:
    for place in places.values():
        if place["col"] == 1:
            figure.update_yaxes(title_text=y, **place)
        if x and place["row"] == max(one["row"] for one in places.values()):
            figure.update_xaxes(title_text=x, **place)
    return figure


def _spread(
    figure: Any, name: str, color: str, curve: Any, columns: tuple[str, str, str],
    where: dict[str, int] | None = None,
) -> None:  # fmt: skip
    """A line with a band around it: columns of a DataFrame over its evaluations."""
    x, (middle, low, high) = curve["evaluations"], (curve[column] for column in columns)
    shown = entry(figure, name) | {"mode": "lines", **(where or {})}
    if np.isfinite(low).all():
        figure.add_scatter(
            x=_short(np.r_[x, x[::-1]]), y=_short(np.r_[high, low[::-1]]), fill="toself",
            fillcolor=color, opacity=0.18, line={"width": 0}, hoverinfo="skip",
            **shown | {"showlegend": False},
        )  # fmt: skip
    figure.add_scatter(x=_short(x), y=_short(middle), line={"color": color, "width": 1.5}, **shown)


def _short(values: Any) -> list[float | None]:
    """Numbers to four digits, as small in the page as they can be; None where there is none."""
    numbers = np.asarray(values, dtype=float).tolist()
    return [float(f"{value:.4g}") if math.isfinite(value) else None for value in numbers]
