"""Experiments: what commands can reveal, designed commands, healthy tests; pages and figures."""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from ematwin.experiments.command_errors import CommandErrors
from ematwin.experiments.design import Design
from ematwin.experiments.discriminate import Discrimination
from ematwin.experiments.healthy_tests import HealthyTests
from ematwin.experiments.identifiability import HEADINGS, Identifiability
from ematwin.experiments.sensitivity import Sensitivity
from ematwin.models.base import Demand
from ematwin.models.registry import model_of
from ematwin.models.scenario import Scenario
from ematwin.report.page import Row, Section, Table, render
from ematwin.report.style import BLUE, GREEN, GREY, ORANGE, PALE, Panel, empty, panels_drawn
from ematwin.showing.text import capital, number_of, said


def identifiability_page(
    found: Sequence[Identifiability], parts: Mapping[str, Sensitivity] | None = None
) -> str:
    """HTML page of one or several commands, the most telling first.

    ``parts`` are Sobol indices by the name of the command, where they were asked for.
    """
    sections = [Section("Smallest fault that is found", figure=plot_smallest(found))]
    for one in found:
        text = (
            f"{one.scenario.duration:g} s. Noise and the twin's own error are "
            f"{100.0 * one.noise:.2f} % of the answer. Of the smallest faults all but "
            f"{100.0 * one.miss:.3g} % are found, with false alarms at "
            f"{100.0 * one.false_alarm:.2g} %."
        )
        obstacles = [f"No verdict: {sentence}" for sentence in one.obstacles]
        sections.append(Section(one.scenario.name, text, obstacles, told_table(one)))
        sections.append(Section(figure=plot_correlation(one)))
        if parts:
            own = parts[one.scenario.name]
            text = (
                "How much of the variance of the answer goes back to each unknown, from "
                f"{own.answers} answers: by itself, and with all in which it takes part; standard "
                "errors."
            )
            for channel, caption in own.captions.items():
                title = f"{one.scenario.name}: {caption}"
                sections.append(Section(title, text, table=sobol_table(own, channel)))
    title = f"{found[0].actuator.name}: identifiability of faults"
    return render(title, found[0].lead, sections)


def sobol_table(parts: Sensitivity, channel: str) -> Table:
    """Indices of a channel."""
    return Table(["unknown", "by itself", "in all"], [Row(row) for row in parts.rows(channel)])


def told_table(found: Identifiability) -> Table:
    """Each fault with its expected errors."""
    rows = [Row(one.cells, marked=one.how in ("open", "dead")) for one in found.told]
    return Table(list(HEADINGS), rows, texts=(-1,))


def design_page(found: Design) -> str:
    """HTML page of a design."""
    text = "Expected error of each fault, averaged over faults that are not known yet: from noise "
    text += "and model discrepancy."
    if found.held:
        held = ", ".join(found.held)
        text += f" Counted as known, because no command can determine them: {held}."
    if found.left_out:
        text += f" {found.left_out_sentence}"
    if found.promised.checks:
        which = "" if found.checked else ", by which it was chosen"
        erred = f"what identify erred on {found.promised.checks} simulated recordings"
        text += f" Observed: root mean square of {erred} of each command{which}."
    price = "On a healthy actuator; in brackets the most that was seen with faults."
    begun = "Identifiability of faults that have just begun"
    every = "With everything that is unknown, also what no command can determine."
    facts = {
        "made for": found.fault or "the fault with the largest expected error, as a share of range",
        "search": _search(found), "faults": f"{found.draws} vectors drawn from their prior",
        "limits": _listed(found.limits),
    }  # fmt: skip
    sections = [
        Section("Command", table=_parts_table(found.scenario), figure=plot_command(found)),
        Section("Errors", text=text, table=errors_table(found)),
        Section(figure=plot_errors(found)),
        Section("The price", price, table=price_table(found)),
        *(
            Section(f"{begun}: {title} command", every, table=told_table(one.told))
            for title, one in (("the designed", found.promised), ("the given", found.default))
            if one.told is not None
        ),
        Section("How it was found", facts=facts),
    ]
    return render(f"{found.actuator.name}: designed command", found.sentence, sections)


def discrimination_page(found: Discrimination) -> str:
    """HTML page of a command under which two explanations differ."""
    both = (found.first, found.second)
    names = {**found.first, **found.second}
    rows = [Row([name, *(_shown(values.get(name)) for values in both)]) for name in names]
    facts = {
        "distance": f"{found.distance:.3g} standard deviations",
        f"distance with {found.default.name}": f"{found.default_distance:.3g}",
        "limits": _listed(found.limits),
        "demands": _listed(found.demands),
        "search": _search(found),
    }
    sections = [
        Section("Explanations", table=Table(["", "first", "second"], rows)),
        Section("Command", table=_parts_table(found.scenario), figure=plot_command(found)),
        Section("How it was found", facts=facts),
    ]
    title = f"{found.actuator.name}: command to tell two explanations apart"
    return render(title, found.sentence, sections)


LEARNT = "Expected standard error, %"


def healthy_tests_page(found: HealthyTests) -> str:
    """HTML page of healthy tests: commands, and how well parameters are known after each."""
    text = (
        "Standard errors from the prior and the information of the simulated recordings. "
        "Marked: after all tests still more than half the error that the tolerance states."
    )
    refused = f"of which {found.refused} exceed a limit or move too little"
    facts = {"compared": f"{found.compared} commands, {refused}", "limits": _listed(found.limits)}
    sections = [
        Section("Tests", table=tests_table(found, []), figure=plot_healthy_tests(found)),
        Section("Parameters", text=text, figure=plot_learnt_errors(found)),
        Section(LEARNT, table=learnt_table(found)),
        Section("How they were found", facts=facts),
    ]
    lead = " ".join(filter(None, (found.sentence, found.open_sentence, found.next_sentence)))
    shown = sections if found.tests else sections[-1:]
    return render(f"{found.actuator.name}: healthy tests", lead, shown)


def tests_table(found: HealthyTests, files: Sequence[str]) -> Table:
    """Each test with the parameters it improves, its duration and demands, and its file."""
    demands = [one for one in model_of(found.actuator).limited if one.name in found.limits]
    rows = []
    for n, test in enumerate(found.tests):
        asked = [said(test.demands.get(one.name, 0.0), one.unit, 3) for one in demands]
        what = test.scenario.description or test.scenario.name
        cells = [str(n + 1), what, ", ".join(found.improves(n)), f"{test.scenario.duration:g} s"]
        rows.append(Row([*cells, *asked, *files[n : n + 1]]))
    limits = [said(found.limits[one.name], one.unit, 3) for one in demands]
    rows.append(Row(["", "limit", "", "", *limits, *([""] if files else [])]))
    header = ["", "test", "improves most", "duration", *(one.name for one in demands)]
    return Table([*header, *(["file"] if files else [])], rows, texts=(1, 2))


def learnt_table(found: HealthyTests) -> Table:
    """Standard error of each parameter, %, now and after each test."""
    count = len(found.tests)
    header = ["parameter", "by tolerance", "now", *(f"after {n + 1}" for n in range(count))]
    left = found.open_after(found.after)
    rows = []
    for place, now in found.known.items():
        errors = [found.tolerances[place], now, *(one.errors[place] for one in found.tests)]
        cells = [f"{100.0 * x:.2g}" for x in (*errors, found.repeated[place])]
        rows.append(Row([place, *cells], marked=place in left))
    return Table([*header, f"{count} x {found.given.name}"], rows)


def errors_table(found: Design) -> Table:
    """Each fault with its expected and observed errors."""
    checked = bool(found.promised.observed and found.default.observed)
    header = ["fault", "given", "designed", "times better"]
    header += ["given, observed", "designed, observed", "times better"] if checked else []
    rows = []
    for name in found.promised.errors:
        pairs = [(found.default.errors[name], found.promised.errors[name])]
        if checked:
            pairs.append((found.default.observed[name], found.promised.observed[name]))
        cells = [
            text for old, new in pairs for text in (f"{old:.2g}", f"{new:.2g}", f"{old / new:.2f}")
        ]
        rows.append(Row([name, *cells], marked=name == (found.fault or found.default.weakest)))
    return Table(header, rows)


def price_table(found: Design) -> Table:
    """Duration and motion of both commands beside the limits."""

    def asked(one: CommandErrors, demand: Demand) -> str:
        more = one.faulty.get(demand.name)
        text = said(one.demands.get(demand.name, math.nan), demand.unit)
        return text if more is None else f"{text} ({number_of(more, demand.unit)})"

    both = (found.default, found.promised)
    rows = [Row(["duration", *(f"{one.scenario.duration:g} s" for one in both), ""])]
    for one in found.experiment.model.limited:
        if one.name in found.limits:
            limit = said(found.limits[one.name], one.unit)
            rows.append(Row([one.name, *(asked(each, one) for each in both), limit]))
    return Table(["", "given", "designed", "limit"], rows)


def _parts_table(scenario: Scenario) -> Table:
    """Parts of command and load."""
    rows = []
    for history in ("command", "load"):
        for part in getattr(scenario, history):
            values = part.model_dump(exclude={"type"}, exclude_none=True)
            told = ", ".join(f"{name} {_shown(x)}" for name, x in values.items())
            rows.append(Row([history, part.type, told]))
    return Table(["", "part", "SI"], rows, texts=(1, -1))


def _shown(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_shown(x) for x in value)}]"
    if isinstance(value, float | int):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {x:.4g}" for name, x in values.items())


def _search(found: Design | Discrimination) -> str:
    spent = f"{found.evaluations} commands in {found.seconds:.1f} s"
    return f"{spent}, seed {found.seed}, {found.stopped}"


_POINTS = 2000  # of a curve
_TESTS = (BLUE, ORANGE, GREEN)


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
    driven = (("Command", model.command), ("Load", model.load))
    panels = [Panel(title, model.channel(name).unit) for title, name in driven if name]
    answers: list[Panel] = []
    for name, color, scenario in (("given", GREY, given), ("designed", BLUE, found.scenario)):
        time = np.linspace(0.0, scenario.duration, _POINTS)
        for panel, curve in zip(panels, scenario.histories(time), strict=False):
            panel.line(time, curve, name, color)
        healthy, fidelity = model.healthy(actuator), model.fidelities[-1]
        record = model.simulate(actuator, scenario, healthy, fidelity=fidelity)
        signal = model.signals(record, actuator)[0]
        answers = answers or [Panel(f"{signal.title}, healthy", signal.unit)]
        answers[0].line(record.time, signal.values, name, color)
    return panels_drawn([*panels, *answers], 195)


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
            panel.line(time, values, f"test {n + 1}", _TESTS[n % 3])
    return panels_drawn(panels, 165)


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
    steps = [("by tolerance", found.tolerances, GREY, "line-ns-open")]
    steps += [("now", found.known, GREY, "circle")]
    for n, (one, color) in enumerate(zip(found.tests, cycle(_TESTS), strict=False), start=1):
        steps.append((f"after test {n}", one.errors, color, "circle"))
    steps += [(f"{len(found.tests)} x {found.given.name}", found.repeated, GREY, "x-thin-open")]
    for name, errors, color, symbol in steps:
        figure.add_scatter(
            x=[100.0 * errors[place] for place in places], y=places, name=name, mode="markers",
            marker={"color": color, "size": 9, "symbol": symbol, "line": {"width": 2}},
            hovertemplate="%{y}: %{x:.2g} %",
        )  # fmt: skip
    return figure.update_xaxes(title_text="standard error, %", type="log")
