"""Figures of experiments: what a command can reveal, designed commands, healthy tests."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ematwin.experiments.design import Design
from ematwin.experiments.discriminate import Discrimination
from ematwin.experiments.healthy_tests import HealthyTests
from ematwin.experiments.identifiability import Identifiability
from ematwin.models.registry import model_of
from ematwin.plots.style import BLUE, GREEN, GREY, ORANGE, PALE, Panel, empty, panels_drawn
from ematwin.showing.text import capital

_POINTS = 2000  # of a curve


def plot_smallest(found: Sequence[Identifiability] | Identifiability) -> Any:
    """The smallest detectable fault as a share of its range, by command; none where no bar is."""
    several = [found] if isinstance(found, Identifiability) else list(found)
    height = 140 + max(len(one.told) for one in several) * (16 + 14 * len(several))
    figure = empty(height, hovermode="closest", barmode="group", margin_l=20)
    for n, one in enumerate(several):
        told = one.told[::-1]  # plotly draws from below
        shares = [100.0 * t.smallest / t.range if math.isfinite(t.smallest) else None
                  for t in told]  # fmt: skip
        figure.add_bar(
            y=[t.name for t in told], x=shares, name=one.scenario.name, orientation="h",
            marker_color=(BLUE, ORANGE, GREEN, GREY)[n % 4],
            text=["" if share is not None else "none" for share in shares],
        )  # fmt: skip
    return figure.update_xaxes(
        title_text="smallest fault found, % of its range", rangemode="tozero", ticksuffix=" %"
    )


def plot_correlation(found: Identifiability) -> Any:
    """The correlation of all that is unknown, as squares."""
    names = list(found.names)
    values = np.asarray(found.correlation).round(3)
    rows, columns = np.indices(values.shape)
    height = 200 + 18 * len(names)
    figure = empty(height, margin_l=20, hovermode="closest", showlegend=False)
    figure.add_scatter(
        x=[names[n] for n in columns.ravel()], y=[names[n] for n in rows.ravel()],
        mode="markers", text=values.ravel(),
        marker={
            "symbol": "square", "size": max(5, min(16, 420 // len(names))),
            "color": values.ravel(), "cmin": -1.0, "cmax": 1.0, "colorscale": "RdBu",
            "reversescale": True, "colorbar": {"title": {"text": "correlation"}, "thickness": 12},
        },
        hovertemplate="%{y} and %{x}: %{text:.2f}<extra></extra>",
    )  # fmt: skip
    figure.update_yaxes(autorange="reversed", categoryorder="array", categoryarray=names)
    return figure.update_xaxes(categoryorder="array", categoryarray=names, tickangle=-60)


def plot_command(found: Design | Discrimination) -> Any:
    """Command and load of a design and of the given one, and the answer of a healthy actuator."""
    actuator, model = found.actuator, model_of(found.actuator)
    given = found.default.scenario if isinstance(found, Design) else found.default
    panels = [Panel("Command", model.channel(model.command).unit)]
    if model.load is not None:
        panels.append(Panel("Load", model.channel(model.load).unit))
    answers: list[Panel] = []
    for name, color, scenario in (("given", GREY, given), ("designed", BLUE, found.scenario)):
        time = np.linspace(0.0, scenario.duration, _POINTS)
        for panel, curve in zip(panels, scenario.histories(time), strict=False):
            panel.line(time, curve, name, color)
        record = model.simulate(
            actuator, scenario, model.healthy(actuator), fidelity=model.fidelities[-1]
        )
        signal = model.signals(record, actuator)[0]
        answers = answers or [Panel(f"{signal.title}, healthy", signal.unit)]
        answers[0].line(record.time, signal.values, name, color)
    return panels_drawn([*panels, *answers], "time, s", 195)


def plot_errors(found: Design) -> Any:
    """Expected and observed errors of each fault, as shares of its range."""
    figure = empty(360)
    for name, command, color, seen, symbol in (
        ("given", found.default, GREY, "#57606a", "x"),
        ("designed", found.promised, BLUE, ORANGE, "diamond"),
    ):
        faults = list(command.shares)
        expected = [100.0 * share for share in command.shares.values()]
        figure.add_bar(x=faults, y=expected, name=f"{name}, expected", marker_color=color)
        if command.observed:
            figure.add_scatter(
                x=faults,
                y=[100.0 * command.observed[fault] / command.ranges[fault] for fault in faults],
                name=f"{name}, observed", mode="markers",
                marker={"color": seen, "size": 11, "symbol": symbol},
            )  # fmt: skip
    return figure.update_yaxes(title_text="error, % of the range", rangemode="tozero")


def plot_healthy_tests(found: HealthyTests) -> Any:
    """Command and load of each test."""
    model = model_of(found.actuator)
    channels = [model.channel(name) for name in (model.command, model.disturbed) if name]
    panels = [Panel(capital(one.meaning), one.unit) for one in channels]
    for n, scenario in enumerate(found.scenarios):
        time = np.linspace(0.0, scenario.duration, _POINTS)
        for panel, values in zip(panels, scenario.histories(time), strict=False):
            panel.line(time, values, f"test {n + 1}", (BLUE, ORANGE, GREEN)[n % 3])
    return panels_drawn(panels, "time, s", 165)


def plot_learnt_errors(found: HealthyTests) -> Any:
    """Standard error of each parameter by its tolerance, now and after each test, %."""
    places = list(found.known)[::-1]  # plotly draws from below
    height = 130 + 26 * len(places)  # px of a parameter
    figure = empty(height, hovermode="closest", margin_l=20)
    for place in places:
        ends = [100.0 * found.known[place], 100.0 * found.after[place]]
        figure.add_scatter(
            x=ends, y=[place, place], mode="lines", showlegend=False,
            line={"color": PALE, "width": 2}, hoverinfo="skip",
        )  # fmt: skip
    steps = [
        ("by tolerance", found.tolerances, GREY, "line-ns-open"),
        ("now", found.known, GREY, "circle"),
        *(
            (f"after test {n}", one.errors, (BLUE, ORANGE, GREEN)[(n - 1) % 3], "circle")
            for n, one in enumerate(found.tests, 1)
        ),
        (f"{len(found.tests)} x {found.given.name}", found.repeated, GREY, "x-thin-open"),
    ]
    for name, errors, color, symbol in steps:
        figure.add_scatter(
            x=[100.0 * errors[place] for place in places], y=places, name=name, mode="markers",
            marker={"color": color, "size": 9, "symbol": symbol, "line": {"width": 2}},
            hovertemplate="%{y}: %{x:.2g} %",
        )  # fmt: skip
    return figure.update_xaxes(title_text="standard error, %", type="log")
