"""Figures of a simulated recording beside the healthy one."""

from dataclasses import replace
from typing import Any

from ematwin.models.optional import Signal
from ematwin.models.registry import model_of
from ematwin.plots.style import BLUE, GREY, ORANGE, PALE, line, stacked
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording


def plot_response(recording: Recording, healthy: Recording, actuator: Any) -> Any:
    """Signals of a recording, beside a healthy one under the same command.

    Returns
    -------
    plotly.graph_objects.Figure
    """
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
