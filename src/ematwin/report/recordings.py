"""Pages: the channels of a file, and a faulty actuator beside the healthy one."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ematwin.models.registry import model_of
from ematwin.plots.recordings import plot_channels, plot_response
from ematwin.recordings.proposal import HEADINGS, Proposal
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey, Surveyed
from ematwin.report.page import Row, Section, Table, listed, render
from ematwin.showing.text import said


def channels_page(found: Survey, proposal: Proposal) -> str:
    """HTML page: the proposed map with its reasons, open questions, a plot of every channel."""
    rows = [
        Row(cells, marked=entry.is_open)
        for cells, entry in zip(proposal.rows, proposal.entries.values(), strict=True)
    ]
    taken = tuple(entry.channel for entry in proposal.entries.values())
    points = [one.sentence for one in proposal.questions]
    sections = [
        Section("Proposed map", table=Table(list(HEADINGS), rows, texts=(1, 2, 3))),
        Section("Open", points=points),
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
        cells = [
            one.name,
            one.unit or "not stated",
            f"{rate:.6g} Hz" if rate and one.samples and not one.is_text else "",
            one.text if one.is_text else f"{one.low:.4g} to {one.high:.4g}",
            *([str(one.samples), str(one.missing or "")] if shape is None else [shape(one)]),
            meant.get(one.name, ""),
        ]
        rows.append(Row(cells))
    more = ["samples", "missing"] if shape is None else ["shape"]
    header = ["channel", "unit", "rate", "range", *more, "taken for"]
    return Table(header, rows, texts=(1, -1))


def fault_table(values: Mapping[str, float], actuator: Any) -> Table:
    """Each value, as it is searched and as it is measured; what differs from healthy is marked."""
    rows = []
    for row in model_of(actuator).describe(actuator, values):
        cells = [row.name, f"{row.normalised:.3g}", *row.said, row.meaning]
        rows.append(Row(cells, marked=row.value != row.healthy))
    return Table(["fault", "k", "value", "healthy", "meaning"], rows, texts=(-1,))


def comparison_page(
    record: Recording, healthy: Recording, values: Mapping[str, float], actuator: Any
) -> str:
    """HTML page of a recording and the healthy one under the same command."""
    model = model_of(actuator)
    first, base = model.signals(record, actuator)[0], model.signals(healthy, actuator)[0]
    difference = first.values - base.values
    rms = float(np.sqrt(np.mean(difference**2)))
    level = float(np.sqrt(np.mean(base.values**2)))
    source = record.provenance
    facts = {
        "model": str(source.get("model")), "actuator": f"{actuator.name}: {actuator.description}",
        "scenario": str(source.get("scenario")),
        "samples": f"{len(record)} at {record.sample_rate:g} Hz",
        "noise": listed(source.get("noise")), "seed": str(source.get("seed")),
    }  # fmt: skip
    sections = [
        Section("Faults", table=fault_table(values, actuator)),
        Section("Response", figure=plot_response(record, healthy, actuator)),
        Section("Where this comes from", facts=facts),
    ]
    what = first.title.partition(",")[0].lower()
    lead = (
        f"The faults change the {what} by {said(rms, first.unit, 3)} RMS, "
        f"{100.0 * rms / level:.1f} % of the healthy one."
    )
    return render(f"{actuator.name}: faulty and healthy", lead, sections)
