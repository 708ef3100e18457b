"""Figures of recordings and files: every channel, and a faulty actuator beside the healthy one."""

from typing import Any

from ematwin.models.registry import model_of
from ematwin.plots import style
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey


def plot_recording(recording: Recording) -> Any:
    """Every channel of a recording over time."""
    panels = []
    for name, values in recording.channels.items():
        title = name.replace("_", " ")
        panel = style.Panel(title, recording.units.get(name, ""))
        panels.append(panel.line(recording.time, values, title, style.BLUE))
    return style.panels_drawn(panels, "time, s", 120).update_layout(showlegend=False)


def plot_channels(found: Survey, taken: tuple[str, ...] = (), rate: float | None = None) -> Any:
    """Every channel of a surveyed file; those ``taken`` stand out.

    Parameters
    ----------
    found : Survey
    taken : names of channels
    rate : samples per second, Hz, where it is known: the axis is then time, else sample numbers
    """
    shown = [one for one in found.channels if not one.is_text and one.samples][:24]
    if not shown:
        return style.empty(120)
    timed = all(one.rate or rate for one in shown)
    figure = style.stacked(
        [one.name for one in shown], [one.unit for one in shown],
        "time, s" if timed else "sample", 110 + 120 * len(shown),
    )  # fmt: skip
    for n, one in enumerate(shown):
        color = style.ORANGE if one.name in taken else style.BLUE
        figure.add_scatter(
            x=style.compact(one.places / ((one.rate or rate or 1.0) if timed else 1.0)),
            y=style.compact(one.shape), mode="lines",
            name="in the map" if one.name in taken else "not used", legendgroup=color,
            showlegend=all(trace.legendgroup != color for trace in figure.data),
            line={"color": color, "width": 1.2}, row=n + 1, col=1,
        )  # fmt: skip
    figure.update_xaxes(matches=None)
    figure.update_layout(hovermode="closest")
    return figure


def plot_response(recording: Recording, healthy: Recording, actuator: Any) -> Any:
    """Signals of a recording, beside a healthy one under the same command."""
    signals, time = model_of(actuator).signals, recording.time
    pairs = zip(signals(recording, actuator), signals(healthy, actuator), strict=True)
    (first, base), *others = pairs
    beside = style.Panel(first.title, first.unit).line(
        time, base.values, "healthy", style.PALE, width=5
    )
    title = f"Difference of the {first.title[0].lower()}{first.title[1:]}"
    difference = first.values - base.values
    panels = [
        beside.line(time, first.values, "faulty", style.ORANGE),
        style.Panel(title, first.unit).line(time, difference, "faulty - healthy", style.GREY),
    ]
    for one, other in others:
        panel = style.Panel(one.title, one.unit).line(
            time, other.values, "healthy", style.PALE, width=5
        )
        if one.reference is not None:
            panel.line(time, one.reference, "command", style.BLUE, dash="dot")
        panels.append(panel.line(time, one.values, "faulty", style.ORANGE))
    return style.panels_drawn(panels, "time, s", 215)
