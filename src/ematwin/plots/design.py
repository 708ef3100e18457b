"""Figures of a designed command: the command beside the given one, and the errors of both."""

from typing import Any

import numpy as np

from ematwin.experiments.design import Design
from ematwin.experiments.discriminate import Discrimination
from ematwin.models.registry import model_of
from ematwin.plots.style import BLUE, GREEN, GREY, ORANGE, line, stacked, styled
from ematwin.quantities import preferred

_POINTS = 2000  # of a curve


def plot_command(found: Design | Discrimination) -> Any:
    """Command and load of a design and of the given one, and the answer of a healthy actuator."""
    actuator, model = found.actuator, model_of(found.actuator)
    given = found.default.scenario if isinstance(found, Design) else found.default
    histories = []
    for name, color, scenario in (("given", GREY, given), ("designed", BLUE, found.scenario)):
        time = np.linspace(0.0, scenario.duration, _POINTS)
        record = model.simulate(
            actuator, scenario, model.healthy(actuator), fidelity=model.fidelities[-1]
        )
        histories.append((name, color, time, scenario.histories(time), record))
    titles, units = ["Command"], [model.channel(model.command).unit]
    if model.load is not None:
        titles.append("Load")
        units.append(model.channel(model.load).unit)
    signals = [model.signals(record, actuator)[0] for *_, record in histories]
    titles.append(f"{signals[0].title}, healthy")
    shown = [preferred(unit) for unit in (*units, signals[0].unit)]
    figure = stacked(titles, [unit for unit, _ in shown], "time, s", height=230 * len(titles))
    for (name, color, time, curves, record), signal in zip(histories, signals, strict=True):
        thin = slice(None, None, max(1, len(record) // _POINTS))
        rows = [*((time, curve) for curve in curves[: len(units)]),
                (record.time[thin], signal.values[thin])]  # fmt: skip
        for row, ((at, values), (_, factor)) in enumerate(zip(rows, shown, strict=True), 1):
            line(figure, row, at, factor * values, name, color)
    return figure


def plot_errors(found: Design) -> Any:
    """Expected and observed errors of each fault, as shares of its range."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for name, color, seen, command in (
        ("given", GREY, "#57606a", found.default),
        ("designed", BLUE, GREEN, found.promised),
    ):
        faults = list(command.shares)
        figure.add_bar(
            x=faults,
            y=[100.0 * command.shares[fault] for fault in faults],
            name=f"{name}, expected",
            marker_color=color,
        )
        if command.observed:
            figure.add_scatter(
                x=faults,
                y=[100.0 * command.observed[fault] / command.ranges[fault] for fault in faults],
                name=f"{name}, observed",
                mode="markers",
                marker={"color": seen if name == "given" else ORANGE, "size": 11,
                        "symbol": "x" if name == "given" else "diamond"},
            )  # fmt: skip
    figure.update_yaxes(title_text="error, % of the range", rangemode="tozero")
    return styled(figure, 360)
