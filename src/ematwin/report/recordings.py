"""The channels of a file, and a faulty actuator beside the healthy one: pages and figures."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ematwin.models.registry import model_of
from ematwin.recordings.proposal import HEADINGS, Proposal
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey, Surveyed
from ematwin.report import style
from ematwin.report.page import Row, Section, Table, listed, render
from ematwin.report.style import BLUE, GREY, ORANGE, PALE, Panel
from ematwin.showing.text import said


def channels_page(found: Survey, proposal: Proposal) -> str:
    """HTML page: the proposed map with its reasons, open questions, a plot of every channel."""
    entries = proposal.entries.values()
    rows = [Row(cells, one.is_open) for cells, one in zip(proposal.rows, entries, strict=True)]
    taken = tuple(one.channel for one in entries)
    sections = [
        Section("Proposed map", table=Table(list(HEADINGS), rows, texts=(1, 2, 3))),
        Section("Open", points=[one.sentence for one in proposal.questions]),
        Section("Channels", table=channels_table(found, proposal)),
        Section(figure=plot_channels(found, taken, proposal.rate)),
    ]  # fmt: skip
    title = f"Channels of {found.path.name}"
    return render(title, proposal.sentence, sections, list(proposal.check))


def channels_table(
    found: Survey, proposal: Proposal, shape: Callable[[Surveyed], str] | None = None
) -> Table:
    """A row for each channel; ``shape`` draws it in a line of text, in place of its samples."""
    meant = {entry.channel: name for name, entry in proposal.entries.items()}
    rows = []
    for one in found.channels:
        rate = one.rate or proposal.rate
        said = f"{rate:.6g} Hz" if rate and one.samples and not one.is_text else ""
        reach = one.text if one.is_text else f"{one.low:.4g} to {one.high:.4g}"
        more = [str(one.samples), str(one.missing or "")] if shape is None else [shape(one)]
        cells = [one.name, one.unit or "not stated", said, reach, *more, meant.get(one.name, "")]
        rows.append(Row(cells))
    more = ["samples", "missing"] if shape is None else ["shape"]
    return Table(["channel", "unit", "rate", "range", *more, "taken for"], rows, texts=(1, -1))


def comparison_page(
    record: Recording, healthy: Recording, values: Mapping[str, float], actuator: Any
) -> str:
    """HTML page of a recording and the healthy one under the same command."""
    model = model_of(actuator)
    first, base = model.signals(record, actuator)[0], model.signals(healthy, actuator)[0]
    difference = first.values - base.values
    rms, level = (float(np.sqrt(np.mean(x**2))) for x in (difference, base.values))
    source = record.provenance
    facts = {
        "model": str(source.get("model")), "actuator": f"{actuator.name}: {actuator.description}",
        "scenario": str(source.get("scenario")),
        "samples": f"{len(record)} at {record.sample_rate:g} Hz",
        "noise": listed(source.get("noise")), "seed": str(source.get("seed")),
    }  # fmt: skip
    rows = [
        Row([row.name, f"{row.normalised:.3g}", *row.said, row.meaning], row.value != row.healthy)
        for row in model.describe(actuator, values)
    ]
    faults = Table(["fault", "k", "value", "healthy", "meaning"], rows, texts=(-1,))
    sections = [
        Section("Faults", table=faults),
        Section("Response", figure=plot_response(record, healthy, actuator)),
        Section("Where this comes from", facts=facts),
    ]
    what = first.title.partition(",")[0].lower()
    share = f"{100.0 * rms / level:.1f} % of the healthy one"
    lead = f"The faults change the {what} by {said(rms, first.unit, 3)} RMS, {share}."
    return render(f"{actuator.name}: faulty and healthy", lead, sections)


def plot_recording(recording: Recording) -> Any:
    """Every channel of a recording over time."""
    panels = []
    for name, values in recording.channels.items():
        panel = Panel(name.replace("_", " "), recording.units.get(name, ""))
        panels.append(panel.line(recording.time, values, panel.title, BLUE))
    return style.panels_drawn(panels, 120).update_layout(showlegend=False)


def plot_channels(found: Survey, taken: tuple[str, ...] = (), rate: float | None = None) -> Any:
    """Every channel of a surveyed file; those whose names are ``taken`` stand out.

    Where the ``rate`` is known, samples per second, Hz, the axis is time, else sample numbers.
    """
    shown = [one for one in found.channels if not one.is_text and one.samples][:24]
    if not shown:
        return style.empty(120)
    timed = all(one.rate or rate for one in shown)
    names, units = [one.name for one in shown], [one.unit for one in shown]
    figure = style.stacked(names, units, "time, s" if timed else "sample", 110 + 120 * len(shown))
    for n, one in enumerate(shown):
        name, color = ("in the map", ORANGE) if one.name in taken else ("not used", BLUE)
        x = one.places / ((one.rate or rate or 1.0) if timed else 1.0)
        style.line(figure, n + 1, x, one.shape, name, color, width=1.2)
    figure.update_xaxes(matches=None)
    figure.update_layout(hovermode="closest")
    return figure


def plot_response(recording: Recording, healthy: Recording, actuator: Any) -> Any:
    """Signals of a recording, beside a healthy one under the same command."""
    signals, time, panels = model_of(actuator).signals, recording.time, []
    pairs = list(zip(signals(recording, actuator), signals(healthy, actuator), strict=True))
    for one, other in pairs:
        panel = Panel(one.title, one.unit).line(time, other.values, "healthy", PALE, width=5)
        if one.reference is not None:
            panel.line(time, one.reference, "command", BLUE, dash="dot")
        panels.append(panel.line(time, one.values, "faulty", ORANGE))
    first, base = pairs[0]
    left = Panel(f"Difference of the {first.title[0].lower()}{first.title[1:]}", first.unit)
    left.line(time, first.values - base.values, "faulty - healthy", GREY)
    return style.panels_drawn([panels[0], left, *panels[1:]], 215)
