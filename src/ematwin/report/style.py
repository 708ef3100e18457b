"""Figures: one look for all, colours that colour-blind readers can tell apart (Okabe and Ito).

Backgrounds are transparent and texts of a middle grey, so that a figure stands in a light notebook
and in a dark one; pages set both to their own theme.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ematwin.quantities import preferred
from ematwin.recordings.survey import extremes

BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#8c959f"
AMBER, PALE = "#e69f00", "#aeb8c2"
# Faults side by side: none of them the green of healthy nor the grey of no verdict.
SERIES = ("#d55e00", "#cc79a7", "#0072b2", "#e69f00", "#56b4e9", "#7a5195", "#b8860b", "#a6761d")


def _template() -> Any:
    """The look, as a template of plotly: a tenth of the size of those that come with it."""
    from plotly.graph_objects import layout

    grid, font = "rgba(128,138,148,0.25)", {"family": "system-ui, sans-serif"}
    axis = {"gridcolor": grid, "zerolinecolor": grid, "linecolor": grid, "automargin": True,
            "title": {"standoff": 8}}  # fmt: skip
    return layout.Template(layout={
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {**font, "size": 13, "color": "#6e7781"}, "colorway": list(SERIES),
        "xaxis": axis, "yaxis": axis, "hoverlabel": {"font": font},
    })  # fmt: skip


@dataclass
class Panel:
    """Lines over one horizontal axis; ``unit`` is SI, and they are shown in the user's."""

    title: str
    unit: str
    lines: list[tuple[Any, Any, str, str, dict[str, Any]]] = field(default_factory=list)

    def line(self, x: Any, y: Any, name: str, color: str, **style: Any) -> "Panel":
        """The panel with one more line, of values (S,) in SI."""
        self.lines.append((x, np.asarray(y, dtype=float), name, color, style))
        return self


def panels_drawn(panels: Sequence[Panel], height: int) -> Any:
    """Panels over time above one another, ``height`` px each."""
    shown = [preferred(panel.unit) for panel in panels]
    titles, units = [panel.title for panel in panels], [unit for unit, _ in shown]
    figure = stacked(titles, units, "time, s", 110 + height * len(panels))
    for row, (panel, (_, factor)) in enumerate(zip(panels, shown, strict=True), start=1):
        for x, y, name, color, style in panel.lines:
            line(figure, row, x, factor * y, name, color, **style)
    return figure


def stacked(titles: list[str], units: list[str], x_title: str, height: int) -> Any:
    """Panels above one another over one horizontal axis."""
    from plotly.subplots import make_subplots

    spacing = min(0.07, 0.28 / len(titles))  # shares of the height: as much for many as for four
    figure = make_subplots(
        rows=len(titles), cols=1, shared_xaxes=True, vertical_spacing=spacing, subplot_titles=titles
    )
    for n, unit in enumerate(units):
        figure.update_yaxes(title_text=unit, row=n + 1, col=1)
    figure.update_xaxes(title_text=x_title, row=len(titles), col=1)
    return styled(figure, height)


def empty(height: int, **layout: Any) -> Any:
    """A figure without panels, in the common look."""
    from plotly.graph_objects import Figure

    return styled(Figure(), height, **layout)


def styled(figure: Any, height: int, **layout: Any) -> Any:
    """The common look; ``layout`` has what is different here."""
    figure.update_layout(
        template=_template(),
        height=height,
        margin={"l": 70, "r": 20, "t": 60, "b": 50},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1.0, "xanchor": "right"},
        hovermode="x unified",
        modebar={"orientation": "v"},
    )
    # the legend stands above the title of the first panel, 25 px higher
    figure.update_layout(legend_y=1.0 + 25.0 / max(height - 110, 100), **layout)
    for title, axis in zip(figure.layout.annotations, figure.select_xaxes(), strict=False):
        title.update(x=axis.domain[0], xanchor="left", font_size=14)  # left above its panel
    return figure


def line(figure: Any, row: int, x: Any, y: Any, name: str, color: str, **style: Any) -> None:
    """Add a line to a panel, thinned to its extremes; the same name shares one legend entry."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    kept = extremes(y, 2400)  # more points make the page slow and show nothing more
    figure.add_scatter(
        x=_compact(x[kept]), y=_compact(y[kept]), mode="lines", **entry(figure, name),
        line={"color": color, "width": 1.4, **style}, row=row, col=1,
    )  # fmt: skip


def entry(figure: Any, name: str) -> dict[str, Any]:
    """Name of a trace; the first of a figure with that name stands in the legend for all."""
    first = all(trace.name != name for trace in figure.data)
    return {"name": name, "legendgroup": name, "showlegend": first}


def error_bars(above: Any, below: Any, **look: Any) -> dict[str, Any]:
    """Bars from values up to ``above`` and down to ``below`` them."""
    return {"type": "data", "symmetric": False, "array": above, "arrayminus": below, **look}


def _compact(values: np.ndarray) -> np.ndarray:
    """Numbers in single precision where a figure cannot tell: half the size on a page."""
    known = values[np.isfinite(values)]
    steps = np.abs(np.diff(np.sort(known)))
    finest = steps[steps > 0.0].min(initial=np.inf)
    span = np.abs(known).max(initial=0.0)
    if finest < 1e-6 * span and np.ptp(known) < span / 10.0:
        return values  # steps too small for single precision, such as those of calendar times
    return values.astype(np.float32)
