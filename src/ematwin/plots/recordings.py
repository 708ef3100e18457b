"""Figures of recordings and files: every channel, and a faulty actuator beside the healthy one."""

from dataclasses import replace
from typing import Any

from ematwin.models.optional import Signal
from ematwin.models.registry import model_of
from ematwin.plots.style import BLUE, GREY, ORANGE, PALE, compact, line, stacked, styled
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey


def plot_recording(recording: Recording) -> Any:
    """Every channel of a recording over time."""
    names = list(recording.channels)
    shown = [preferred(recording.units.get(name, "")) for name in names]
    titles = [name.replace("_", " ") for name in names]
    units = [unit for unit, _ in shown]
    figure = stacked(titles, units, "time, s", 110 + 120 * len(names))
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
    """
    shown = [one for one in found.channels if not one.is_text and one.samples][:24]
    if not shown:
        from plotly.graph_objects import Figure

        return styled(Figure(), 120)
    timed = all(one.rate or rate for one in shown)
    figure = stacked(
        [one.name for one in shown], [one.unit for one in shown],
        "time, s" if timed else "sample", 110 + 120 * len(shown),
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


def plot_response(recording: Recording, healthy: Recording, actuator: Any) -> Any:
    """Signals of a recording, beside a healthy one under the same command."""
    model = model_of(actuator)
    faulty_signals = [_shown(one) for one in model.signals(recording, actuator)]
    healthy_signals = [_shown(one) for one in model.signals(healthy, actuator)]
    first, base = faulty_signals[0], healthy_signals[0]
    titles = [first.title, f"Difference of the {first.title[0].lower()}{first.title[1:]}"]
    units = [first.unit, first.unit]
    for signal in faulty_signals[1:]:
        titles.append(signal.title)
        units.append(signal.unit)
    figure = stacked(titles, units, "time, s", height=110 + 215 * len(titles))
    time = recording.time
    line(figure, 1, time, base.values, "healthy", PALE, width=5)
    line(figure, 1, time, first.values, "faulty", ORANGE)
    line(figure, 2, time, first.values - base.values, "faulty - healthy", GREY)
    pairs = zip(faulty_signals[1:], healthy_signals[1:], strict=True)
    for row, (one, other) in enumerate(pairs, start=3):
        line(figure, row, time, other.values, "healthy", PALE, width=5)
        if one.reference is not None:
            line(figure, row, time, one.reference, "command", BLUE, dash="dot")
        line(figure, row, time, one.values, "faulty", ORANGE)
    return figure


def _shown(one: Signal) -> Signal:
    """A signal in the unit in which it is shown."""
    unit, factor = preferred(one.unit)
    reference = None if one.reference is None else factor * one.reference
    return replace(one, unit=unit, values=factor * one.values, reference=reference)
