"""Figures of verdicts on recordings: the trend over runs, a colour for each fault."""

from collections.abc import Sequence
from typing import Any

from ematwin.monitoring.detection import Detection, Diagnosis
from ematwin.plots.style import AMBER, GREEN, GREY, SERIES, stacked, tick_labels
from ematwin.quantities import preferred

_SYMBOLS = ("diamond", "square", "triangle-up", "cross", "x", "star", "pentagon", "hourglass")
_PLAIN = {
    "healthy": (GREEN, "circle"),
    "changed": (AMBER, "circle"),
    "no verdict": (GREY, "circle-open"),
}


def plot_trend(found: Detection, each: str = "run") -> Any:
    """Faults, or what else is reported, over runs, with healthy bands and intervals.

    Runs stand at the time of their recordings where all have one, else by their names in the
    order in which they were given. Faults are told apart by colour and symbol. The distance
    from healthy runs comes first where a healthy population judges.

    Parameters
    ----------
    each : "run" (its recordings together) or "motion" (each recording)
    """
    rows = found.each(each)
    x, axis = _places(rows, each)
    first = rows[0]
    at = [one.standing for one in rows if one.standing is not None]
    titles = ["Distance from healthy runs"] * bool(at)
    titles += [m.name.replace("_", " ").capitalize() for m in first.magnitudes]
    units = [""] * bool(at)
    units += ["times healthy" if m.unit == "x" else preferred(m.unit)[0] for m in first.magnitudes]
    figure = stacked(titles, units, "", 150 + 180 * len(titles))
    texts = [_hover(one) for one in rows]
    looks = _looks(found)
    if at:
        _marks(figure, 1, x, [one.distance for one in at], rows, texts, looks)
        figure.update_yaxes(rangemode="tozero", row=1, col=1)
    for row, one in enumerate(first.magnitudes, start=1 + bool(at)):
        values = [next(m for m in v.magnitudes if m.name == one.name) for v in rows]
        factor = preferred(one.unit)[1]
        bands = [(factor * m.healthy[0], factor * m.healthy[1]) for m in values]
        _band(figure, row, x, bands, row == 1 + bool(at))
        bars = {
            "type": "data", "symmetric": False, "color": GREY, "thickness": 1,
            "array": [factor * (m.high - m.value) for m in values],
            "arrayminus": [factor * (m.value - m.low) for m in values],
        }  # fmt: skip
        _marks(figure, row, x, [factor * m.value for m in values], rows, texts, looks, bars)
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(row=len(titles), col=1, **axis)
    return figure


def _places(verdicts: Sequence[Diagnosis], each: str) -> tuple[list[Any], dict[str, Any]]:
    """Places of verdicts on the axis, and the layout of the axis."""
    times = [verdict.when for verdict in verdicts]
    if all(times) and len(set(times)) == len(times):
        return [str(time) for time in times], {"type": "date"}
    names = [verdict.name.removeprefix(f"{each} ") for verdict in verdicts]
    return list(range(1, len(names) + 1)), {**tick_labels(names), "title_text": each}


def _looks(found: Detection) -> dict[str, tuple[str, str]]:
    """Colour and symbol of each verdict, different for each fault."""
    said = dict.fromkeys(verdict.said for verdict in (*found.runs, *found.motions))
    faults = [name for name in said if name not in _PLAIN]
    return _PLAIN | {
        name: (SERIES[n % len(SERIES)], _SYMBOLS[n % len(_SYMBOLS)])
        for n, name in enumerate(faults)
    }


def _marks(
    figure: Any, row: int, x: list[Any], y: list[float], verdicts: Sequence[Diagnosis],
    texts: list[str], looks: dict[str, tuple[str, str]], bars: dict[str, Any] | None = None,
) -> None:  # fmt: skip
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


def _band(
    figure: Any, row: int, x: list[Any], healthy: list[tuple[float, float]], first: bool
) -> None:
    low, high = [pair[0] for pair in healthy], [pair[1] for pair in healthy]
    figure.add_scatter(
        x=[*x, *reversed(x)], y=[*high, *reversed(low)], fill="toself", mode="lines",
        line={"width": 0}, fillcolor="rgba(0,158,115,0.15)", name="healthy band",
        legendgroup="band", showlegend=first, hoverinfo="skip", row=row, col=1,
    )  # fmt: skip


def _hover(one: Diagnosis) -> str:
    covariate = None if one.standing is None else one.standing.covariate
    said = "" if covariate is None else f", {covariate.name} {covariate}"
    return f"{one.name}<br>{one.said}{said}"
