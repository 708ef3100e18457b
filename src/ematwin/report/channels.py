"""Page: the channels of a file, and which is proposed for which."""

from collections.abc import Callable

from ematwin.plots.recordings import plot_channels
from ematwin.recordings.proposal import HEADINGS, Proposal
from ematwin.recordings.survey import Survey, Surveyed
from ematwin.report.page import Row, Section, Table, render


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
    return Table(header, rows, last_is_text=True, texts=(1,))
