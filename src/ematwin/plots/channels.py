"""Figures of a file or a recording: a panel for each channel."""

from typing import Any

from ematwin.plots.style import BLUE, ORANGE, compact, line, stacked, styled
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey

_PANEL = 120  # px


def plot_recording(recording: Recording) -> Any:
    """Every channel of a recording over time.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    names = list(recording.channels)
    shown = [preferred(recording.units.get(name, "")) for name in names]
    titles = [name.replace("_", " ") for name in names]
    units = [unit for unit, _ in shown]
    figure = stacked(titles, units, "time, s", 110 + _PANEL * len(names))
    for n, (name, title) in enumerate(zip(names, titles, strict=True)):
        line(figure, n + 1, recording.time, shown[n][1] * recording.channels[name], title, BLUE)
    figure.update_layout(showlegend=False)
    return figure


def plot_channels(found: Survey, taken: tuple[str, ...] = (), rate: float | None = None) -> Any:
    """Every channel of a surveyed file; those ``taken`` stand out.

    Parameters
    ----------
    found : Survey
    taken : names of channels
    rate : samples per second, Hz, where it is known: the axis is then time, else sample numbers

    Returns
    -------
    plotly.graph_objects.Figure
    """
    shown = [one for one in found.channels if not one.is_text and one.samples][:24]
    if not shown:
        from plotly.graph_objects import Figure

        return styled(Figure(), 120)
    timed = all(one.rate or rate for one in shown)
    figure = stacked(
        [one.name for one in shown], [one.unit for one in shown],
        "time, s" if timed else "sample", 110 + _PANEL * len(shown),
    )  # fmt: skip
    for n, one in enumerate(shown):
        color = ORANGE if one.name in taken else BLUE
        figure.add_scatter(
            x=compact(one.places / ((one.rate or rate or 1.0) if timed else 1.0)),
            y=compact(one.shape), mode="lines",
            name="in the map" if one.name in taken else "not used", legendgroup=color,
            showlegend=all(trace.legendgroup != color for trace in figure.data),
            line={"color": color, "width": 1.2}, row=n + 1, col=1,
        )  # fmt: skip
    figure.update_xaxes(matches=None)
    figure.update_layout(hovermode="closest")
    return figure
