"""Figures: one look for all, colours that colour-blind readers can tell apart (Okabe and Ito)."""

from typing import Any

BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#8c959f"


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


def styled(figure: Any, height: int) -> Any:
    """The common look."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 40, "t": 40, "b": 50},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1.0, "xanchor": "right"},
        hovermode="x unified",
        modebar={"orientation": "v"},
    )
    # panel titles on the left, out of the legend's way
    figure.update_annotations(x=0.0, xanchor="left", font_size=14)
    return figure


def line(figure: Any, row: int, x: Any, y: Any, name: str, color: str, **style: Any) -> None:
    """Add a line to a panel; the same name shares one legend entry."""
    shown = all(trace.name != name for trace in figure.data)
    figure.add_scatter(
        x=x, y=y, name=name, legendgroup=name, showlegend=shown, mode="lines",
        line={"color": color, "width": 1.4, **style}, row=row, col=1,
    )  # fmt: skip
