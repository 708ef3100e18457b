"""An identification: page and tables, figures of faults, fit, search, and of how sure it is."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.identification import Identification, fault_cells
from ematwin.estimation.profile import LIMIT, ProfileUncertainty
from ematwin.estimation.uncertainty import Uncertainty, predicted
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.report import style
from ematwin.report.page import Row, Section, Table, columns_in_words, listed, render
from ematwin.showing.text import number_of, said_between


def identification_page(found: Identification) -> str:
    """HTML page: faults, measured and fitted channels, residuals, convergence, provenance.

    The recording is as it was identified: with the load that was given, counted from where its
    rotor stood, and averaged.
    """
    truth = _true_faults(found)
    bars = "Bars are shares of a fault's range, lines their 95 % intervals."
    bars += " Diamonds are the true values of the simulation." if truth else ""
    fit = "Both went through the same filter. A pattern in the residual is something that the twin "
    fit += "does not model."
    sections = [
        Section("Deviation from healthy", bars, figure=plot_faults(found)),
        Section("Faults", table=fault_table(found)),
        Section("Parts", table=parts_table(found)),
        *uncertainty_sections(found),
        Section("Measured and fitted", fit, figure=plot_fit(found)),
    ]
    if len(found.history) > 1:  # where equations show all, nothing is searched
        sections.append(Section("Convergence", figure=plot_convergence(found)))
    sections.append(Section("How it was found", facts=_facts(found)))
    notes = [*(f"Assumed: {sentence}" for sentence in found.assumed), *found.warnings]
    title = f"{found.actuator.name}: identified faults"
    return render(title, found.verdict.sentence, sections, notes, grade=found.verdict.grade)


def fault_table(found: Identification) -> Table:
    """Each value with its interval, physical value and healthy value; the true one if known."""
    truth = _true_faults(found)
    described = found.model.describe(found.actuator, truth)
    true = {row.name: number_of(row.value, row.unit) for row in described}
    rows = []
    for row in fault_cells(found):
        cells = [row.name, row.value, row.interval, row.healthy]
        cells += [true.get(row.name, "")] if truth else []
        cells += [row.k, row.k_interval, row.meaning]
        rows.append(Row(cells, marked=row.name in found.present))
    header = ["fault", "value", "95 % of value", "healthy", *(["true"] if truth else [])]
    return Table([*header, "k", "95 % of k", "meaning"], rows, texts=(-1,))


def parts_table(found: Identification) -> Table:
    """Combinations of faults, and what of load and sensors is not as recorded."""
    rows = []
    for part in found.model.contrasts(found.actuator):
        if part.name in found.contrasts:
            value, ends = found.contrasts[part.name]
            told = part.said(found.actuator, value, *ends)
            rows.append(Row([part.meaning, *told, part.ambiguity]))
    for name, (value, (low, high)) in found.nuisances.items():
        one = found.model.unknown(found.actuator, name)
        cells = [one.meaning, *said_between(value, low, high, one.unit), "not as recorded"]
        rows.append(Row(cells, marked=True))
    return Table(["part", "value", "95 %", ""], rows, texts=(-1,))


def _facts(found: Identification) -> dict[str, str]:
    source, record, known = found.provenance, found.recording, "the tolerances of the data sheet"
    if found.calibrated:
        known = "healthy recordings and their drift"
    facts = {
        "record": str(source.get("file") or f"{source.get('source')} {source.get('model', '')}"),
        "samples": f"{len(record)} at {record.sample_rate:g} Hz",
        "actuator": f"{found.actuator.name}: {found.actuator.description}",
        "algorithm": f"{found.algorithm}, seed {found.seed}",
        "simulations": f"{found.evaluations} in {found.seconds:.2f} s",
        "stopped": found.stopped,
        "misfit": f"{found.cost:.4g}; {100.0 * found.relative_misfit:.2f} %",
        "intervals": "95 %, over noise, the twin's own error, and parameters, load and sensors as "
        f"far as {known} leave them open",
    }
    if source.get("columns"):
        facts["columns"] = columns_in_words(source["columns"])
    if source.get("changed"):
        facts["changed"] = listed(source["changed"])
    return facts


_LOOKS = {
    "fault": style.ORANGE, "changed": style.AMBER, "agrees with healthy": style.GREEN,
    "no verdict": style.GREY, "held": style.PALE,
}  # fmt: skip


def plot_faults(found: Identification) -> Any:
    """How far each fault lies from healthy, with its interval, coloured by the verdict.

    A bar is a share of the fault's range. Green agrees with healthy, amber has changed without a
    name, orange is a fault that the verdict names; grey where there is no verdict or the value was
    held. A diamond is the true value, where the recording is a simulation.
    """
    faults = [one for one in found.model.faults(found.actuator) if one.direction_of is None]
    unknowns = {one.name: one for one in faults if one.name in found.values}
    names = list(unknowns)[::-1]  # plotly draws from below
    healthy = {name: one.healthy for name, one in unknowns.items()}

    def deviation(name: str, value: float) -> float:
        return 100.0 * (value - healthy[name]) / unknowns[name].width

    at = {name: deviation(name, found.values[name]) for name in names}
    known = {name: found.intervals.get(name, (found.values[name],) * 2) for name in names}
    ends = {name: [deviation(name, end) for end in known[name]] for name in names}
    height = 130 + 34 * len(names)  # px of a bar
    figure = style.empty(height, hovermode="closest", barmode="overlay", margin_l=20)
    for label, color in _LOOKS.items():
        members = [name for name in names if _state(found, name, healthy[name]) == label]
        if not members:
            continue
        figure.add_bar(
            y=members, x=[at[name] for name in members], orientation="h", name=label,
            marker_color=color, width=0.62,
            error_x=style.error_bars(
                [max(ends[name][1] - at[name], 0.0) for name in members],
                [max(at[name] - ends[name][0], 0.0) for name in members],
                thickness=1.6, width=5, color=style.GREY,
            ),
            customdata=[_hover(found, name) for name in members],
            hovertemplate="%{customdata}<extra></extra>",
        )  # fmt: skip
    if truth := _true_faults(found):
        members = [name for name in names if name in truth]
        figure.add_scatter(
            y=members, x=[deviation(name, truth[name]) for name in members], mode="markers",
            name="true (simulated)", hovertemplate="true: %{x:.3g} %<extra></extra>",
            marker={"symbol": "diamond-open", "size": 11, "color": style.BLUE},
            marker_line_width=2.5,
        )  # fmt: skip
    figure.update_yaxes(categoryorder="array", categoryarray=names)
    return figure.update_xaxes(
        title_text="deviation from healthy, % of its range", zeroline=True, zerolinewidth=2,
        ticksuffix=" %",
    )  # fmt: skip


def _state(found: Identification, name: str, healthy: float) -> str:
    """The group of bars that a fault belongs to."""
    if name not in found.intervals:
        return "held"
    if name in found.present:
        return "fault"
    if found.verdict.grade == "none":
        return "no verdict"
    low, high = found.intervals[name]
    off = found.verdict.grade == "changed" and not low <= healthy <= high
    return "changed" if off else "agrees with healthy"


def _true_faults(found: Identification) -> dict[str, float]:
    """The faults that were simulated, by name; empty where a recording was measured."""
    if found.provenance.get("source") != "simulated":
        return {}
    told = found.provenance.get("faults") or {}
    return {name: float(value) for name, value in told.items()}


def _hover(found: Identification, name: str) -> str:
    row = next(row for row in found.physical if row.name == name)
    shown, factor = preferred(row.unit)
    unit = f" {shown}".rstrip()
    value, healthy = factor * row.value, factor * row.healthy
    ends = [factor * x for x in found.physical_values.get(name, ())]
    between = f"<br>95 %: {ends[1]:.3g} to {ends[2]:.3g}{unit}" if ends else ""
    return f"{row.meaning}<br>{value:.4g}{unit}, healthy {healthy:.4g}{unit}{between}"


def plot_fit(found: Identification, recording: Recording | None = None) -> Any:
    """Measured and fitted channels over time, and their differences.

    ``recording`` was identified; None takes the one in the identification.
    """
    recording = recording or found.recording
    comparison = found.model.compare(recording, found.actuator)
    values = {**found.fitted, **found.values}
    # nuisances stay as they were found
    without = values | {one.name: one.healthy for one in found.model.faults(found.actuator)}
    both = {name: np.array([value, without[name]]) for name, value in values.items()}
    answers, captions = comparison.responses(both, 2), comparison.captions()
    time, panels = recording.time, []
    for name, target in comparison.measured().items():
        title, unit = captions[name]
        fitted, healthy = answers[name]
        # the measured line is wide and pale, so that it shows under the fitted one
        beside = style.Panel(title, unit).line(time, target, "measured", style.PALE, width=5)
        beside.line(time, healthy, "healthy twin", style.BLUE, dash="dot")
        left = style.Panel("Residual", unit)
        left.line(time, target - fitted, "measured - fitted", style.GREY)
        panels += [beside.line(time, fitted, "fitted", style.ORANGE), left]
    return style.panels_drawn(panels, 240)


def plot_convergence(found: Any) -> Any:
    """Best cost over the simulations of an identification or a `MinimizeResult`."""
    if isinstance(found, Identification):
        evaluations, cost = found.history.T
        title, unit, each = "Best misfit so far", "misfit", "simulations"
    else:
        evaluations, cost = found.history.evaluations, found.history.cost
        title, unit, each = "Best cost so far", "cost", "evaluations"
    figure = style.stacked([title], [unit], each, height=340)
    evaluations, cost = evaluations[np.isfinite(cost)], cost[np.isfinite(cost)]
    style.line(figure, 1, evaluations, cost, found.algorithm, style.BLUE, shape="hv")
    if (cost > 0.0).all():
        figure.update_yaxes(type="log", dtick=1, exponentformat="power")
    return figure


def uncertainty_sections(found: Identification) -> list[Section]:
    """Intervals and probabilities, then the figures of the method."""
    sure = found.uncertainty
    if sure is None:
        return []
    sections = [
        Section(f"How sure: {sure.method}", table=uncertainty_table(sure)),
        Section(points=[*sure.sentences, *(f"Doubt: {sentence}" for sentence in sure.doubts)]),
    ]
    if isinstance(sure, ProfileUncertainty):
        text = "The 95 % interval ends where the rise passes the dotted line, or further out by the"
        text += " error of the model."
        sections.append(Section("Profiles of the faults", text, figure=plot_profile(found)))
    pairs = "Each pair of faults by draws: a slanted cloud is two that are traded off."
    band = "The recording over the answers of the twin to draws of everything that is unknown."
    band += " Noise of the sensors is not in the band."
    sections.append(Section("Faults together", pairs, figure=plot_posterior(found)))
    sections.append(Section("What the twin may answer", band, figure=plot_answers(found)))
    return sections


def uncertainty_table(sure: Uncertainty) -> Table:
    """Interval and probability of each fault by the method that was asked for."""
    rows = [Row(list(row), marked=sure.present[row[0]] > 0.5) for row in sure.rows]
    return Table(list(sure.headings), rows, texts=(-1,))


def plot_posterior(found: Identification, names: Sequence[str] | None = None) -> Any:
    """Joint distribution of faults: each pair as a cloud of draws, each alone as a histogram.

    A dotted line stands at a threshold that is a number. ``names`` are the unknowns that are shown,
    all faults if not given. Raises `InputError` if ``found``, identified with an ``uncertainty``,
    has no draws, or not of an unknown that is named.
    """
    sure = found.uncertainty
    if sure is None:
        raise InputError('The identification has no draws; identify with uncertainty="posterior".')
    shown = list(sure.present if names is None else names)
    missing = [name for name in shown if name not in sure.draws.names]
    if missing:
        there = ", ".join(sure.draws.names)
        raise InputError(f"There are no draws of {missing[0]!r}; there are of {there}.")
    draws, limits = sure.draws, {}
    for name, text in sure.thresholds.items():
        with suppress(ValueError):  # those in a physical unit are no numbers
            limits[name] = float(text)
    from plotly.subplots import make_subplots

    size, marker = len(shown), {"color": style.BLUE}
    figure = make_subplots(
        rows=size, cols=size, shared_xaxes=True, horizontal_spacing=0.012, vertical_spacing=0.012
    )
    edges = {name: _edges(draws.of(name)) for name in shown}
    thin = slice(None, None, max(1, len(draws.values) // 1000))  # draws of a cloud
    points = {name: draws.of(name)[thin].astype(np.float32) for name in shown}
    for row, across in enumerate(shown):
        for column, along in enumerate(shown[: row + 1]):
            place = {"row": row + 1, "col": column + 1}
            middle = 0.5 * (edges[along][1:] + edges[along][:-1])
            if row == column:
                counts, _ = np.histogram(draws.of(along), edges[along])
                figure.add_bar(x=middle, y=counts, marker=marker, showlegend=False, **place)
                limit = limits.get(along, np.nan)
                if edges[along][0] < limit < edges[along][-1]:
                    figure.add_vline(limit, line_color=style.ORANGE, line_dash="dot", **place)
                figure.update_yaxes(showticklabels=False, **place)
            else:
                figure.add_scatter(
                    x=points[along], y=points[across], mode="markers", showlegend=False,
                    marker={**marker, "size": 3, "opacity": 0.25}, hoverinfo="skip", **place,
                )  # fmt: skip
                figure.update_xaxes(range=edges[along][[0, -1]], **place)
                figure.update_yaxes(range=edges[across][[0, -1]], **place)
                figure.update_yaxes(showticklabels=column == 0, **place)
            if row == size - 1:
                figure.update_xaxes(title_text=along, **place)
            if column == 0 and row:
                figure.update_yaxes(title_text=across, **place)
    return style.styled(figure, 160 + 110 * size, hovermode="closest", bargap=0.0)


def plot_profile(found: Identification) -> Any:
    """Rise of the deviance along each fault while everything else follows.

    Raises `InputError` unless ``found`` was identified with ``uncertainty="profile"``.
    """
    if not isinstance(found.uncertainty, ProfileUncertainty):
        raise InputError('The identification has no profiles; identify with uncertainty="profile".')
    from plotly.subplots import make_subplots

    profiles, columns = found.uncertainty.walks, 3
    rows = -(-len(profiles) // columns)
    titles = [f"{name}<br>{one.shape}" for name, one in profiles.items()]
    figure = make_subplots(rows=rows, cols=columns, subplot_titles=titles, vertical_spacing=0.12)
    for n, (name, one) in enumerate(profiles.items()):
        place = {"row": n // columns + 1, "col": n % columns + 1}
        figure.add_scatter(
            x=one.values, y=one.rise, mode="lines+markers", name=name, showlegend=False,
            line={"color": style.BLUE, "width": 1.4}, **place,
        )  # fmt: skip
        figure.add_hline(LIMIT, line_color=style.GREY, line_dash="dot", **place)
        figure.add_vrect(*one.interval, fillcolor=style.GREEN, opacity=0.12, line_width=0, **place)
        figure.update_yaxes(range=[-0.2, 8.0], **place)  # rise that is shown
    figure.update_yaxes(title_text="rise", col=1)
    return style.styled(figure, 110 + 250 * rows, hovermode="closest")


def _edges(x: np.ndarray) -> np.ndarray:
    # without the outermost draws
    low, high = np.quantile(x, [0.002, 0.998])
    away = 0.0 if high > low else 1e-3  # all the same
    return np.linspace(low - away, high + away, 33)


def plot_answers(found: Identification) -> Any:
    """Measured channels over the band in which 95 % of the answers to all draws lie."""
    assert found.uncertainty is not None
    recording = found.recording
    comparison = found.model.compare(recording, found.actuator)
    bands = predicted(found.uncertainty.draws, found.estimate.held, comparison)
    measured, captions = comparison.measured(), comparison.captions()
    # more points make the page slow and show nothing more
    thin = slice(None, None, max(1, len(recording) // 5_000))
    time = recording.time[thin]
    titles, units = ([captions[name][k] for name in bands] for k in (0, 1))
    shown = [preferred(unit) for unit in units]
    figure = style.stacked(titles, [unit for unit, _ in shown], "time, s", 330 * len(bands))
    for row, (name, (_, factor)) in enumerate(zip(bands, shown, strict=True), start=1):
        low, middle, high = factor * bands[name][:, thin]
        style.line(figure, row, time, factor * measured[name][thin], "measured", style.GREY)
        edge = {"row": row, "col": 1, "mode": "lines", "line": {"width": 0}}
        figure.add_scatter(x=time, y=high, showlegend=False, hoverinfo="skip", **edge)
        figure.add_scatter(
            x=time, y=low, fill="tonexty", fillcolor="rgba(213, 94, 0, 0.3)", showlegend=row == 1,
            name="95 % of answers", **edge,
        )  # fmt: skip
        style.line(figure, row, time, middle, "median answer", style.ORANGE)
    return figure
