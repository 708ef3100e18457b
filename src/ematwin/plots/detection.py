"""Figures of verdicts on recordings: the trend over runs, each fault in its own colour."""

from collections.abc import Sequence
from typing import Any

from ematwin.models.base import Reported
from ematwin.monitoring.detect import Detection, Verdict
from ematwin.plots.style import (
    AMBER,
    GREEN,
    GREY,
    colors_of,
    stacked,
    tick_labels,
)

_SYMBOLS = ("diamond", "square", "triangle-up", "cross", "x", "star", "pentagon", "hourglass")
_PLAIN = {
    "healthy": (GREEN, "circle"),
    "changed": (AMBER, "circle"),
    "no verdict": (GREY, "circle-open"),
}


def plot_trend(found: Detection, each: str = "run") -> Any:
    """Health index and reported quantities over runs, with healthy bands and intervals.

    Runs stand at the time of their recordings where all have one, else by their names in the
    order in which they were given. Faults are told apart by colour and symbol.

    Parameters
    ----------
    each : "run" (its recordings together) or "motion" (each recording)

    Returns
    -------
    plotly.graph_objects.Figure
    """
    verdicts = found.motions if each == "motion" else found.runs
    calibration = found.calibration
    reported = calibration.model.reported(calibration.actuator)
    titles = ["Health index", *(_title(one) for one in reported)]
    units = ["", *("times healthy" if one.logarithmic else one.unit for one in reported)]
    x, axis = _places(verdicts, each)
    figure = stacked(titles, units, "", 150 + 180 * len(titles))
    texts = [_hover(verdict) for verdict in verdicts]
    looks = _looks(found)
    _limits(figure, x, verdicts)
    _marks(figure, 1, x, [v.index for v in verdicts], verdicts, texts, looks)
    for row, one in enumerate(reported, start=2):
        values = [next(m for m in v.magnitudes if m.name == one.name) for v in verdicts]
        _band(figure, row, x, [m.healthy for m in values])
        bars = {
            "type": "data", "symmetric": False, "color": GREY, "thickness": 1,
            "array": [m.high - m.value for m in values],
            "arrayminus": [m.value - m.low for m in values],
        }  # fmt: skip
        _marks(figure, row, x, [m.value for m in values], verdicts, texts, looks, bars)
    figure.update_layout(hovermode="closest")
    figure.update_yaxes(rangemode="tozero", row=1, col=1)
    figure.update_xaxes(row=len(titles), col=1, **axis)
    return figure


def plot_index(found: Detection) -> Any:
    """Health index of each motion, judged alone.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    verdicts = found.motions
    x, axis = _places(verdicts, "motion")
    figure = stacked(["Health index of each motion"], [""], "", 360)
    _limits(figure, x, verdicts)
    texts = [_hover(v) for v in verdicts]
    _marks(figure, 1, x, [v.index for v in verdicts], verdicts, texts, _looks(found))
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(row=1, col=1, **axis)
    return figure


def _title(one: Reported) -> str:
    return one.name.replace("_", " ").capitalize()


def _places(verdicts: Sequence[Verdict], each: str) -> tuple[list[Any], dict[str, Any]]:
    """Where verdicts stand on the axis, and what the axis says."""
    times = [verdict.when for verdict in verdicts]
    if all(times) and len(set(times)) == len(times):
        return [str(time) for time in times], {"type": "date"}
    names = [verdict.name.removeprefix(f"{each} ") for verdict in verdicts]
    return list(range(1, len(names) + 1)), {**tick_labels(names), "title_text": each}


def _looks(found: Detection) -> dict[str, tuple[str, str]]:
    """Colour and symbol of what a verdict says: each fault its own."""
    faults = [v.said for v in (*found.runs, *found.motions) if v.said not in _PLAIN]
    colors = colors_of(faults)
    return _PLAIN | {
        name: (color, _SYMBOLS[n % len(_SYMBOLS)]) for n, (name, color) in enumerate(colors.items())
    }


def _limits(figure: Any, x: list[Any], verdicts: Sequence[Verdict]) -> None:
    for name, dash, values in (
        ("healthy up to here", "dash", [v.threshold for v in verdicts]),
        ("may drift up to here", "dot", [v.clear for v in verdicts]),
    ):
        figure.add_scatter(
            x=x, y=values, mode="lines", name=name, hoverinfo="skip", row=1, col=1,
            line={"color": GREY, "dash": dash, "width": 1.2},
        )  # fmt: skip


def _marks(
    figure: Any,
    row: int,
    x: list[Any],
    y: list[float],
    verdicts: Sequence[Verdict],
    texts: list[str],
    looks: dict[str, tuple[str, str]],
    bars: dict[str, Any] | None = None,
) -> None:
    for name, (color, symbol) in looks.items():
        members = [n for n, verdict in enumerate(verdicts) if verdict.said == name]
        if not members:
            continue
        own = bars and {
            key: [value[n] for n in members] if isinstance(value, list) else value
            for key, value in bars.items()
        }
        figure.add_scatter(
            x=[x[n] for n in members], y=[y[n] for n in members], mode="markers", name=name,
            legendgroup=name, showlegend=row == 1, text=[texts[n] for n in members],
            hoverinfo="text+y", marker={"color": color, "size": 8, "symbol": symbol},
            error_y=own, row=row, col=1,
        )  # fmt: skip


def _band(figure: Any, row: int, x: list[Any], healthy: list[tuple[float, float]]) -> None:
    low, high = [pair[0] for pair in healthy], [pair[1] for pair in healthy]
    figure.add_scatter(
        x=[*x, *reversed(x)], y=[*high, *reversed(low)], fill="toself", mode="lines",
        line={"width": 0}, fillcolor="rgba(0,158,115,0.15)", name="healthy band",
        legendgroup="band", showlegend=row == 2, hoverinfo="skip", row=row, col=1,
    )  # fmt: skip


def _hover(verdict: Verdict) -> str:
    one = verdict.covariate
    return f"{verdict.name}<br>{verdict.said}" + ("" if one is None else f", {one.name} {one}")
