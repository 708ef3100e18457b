"""Page: the channels of a file, and which is proposed for which."""

from ematwin.plots.channels import plot_channels
from ematwin.recordings.proposal import HEADINGS, Proposal
from ematwin.recordings.survey import Survey
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
        *([Section("Open", points=points)] if points else []),
        Section("Channels", table=_table(found, proposal)),
        Section(figure=plot_channels(found, taken, proposal.rate)),
    ]  # fmt: skip
    title = f"Channels of {found.path.name}"
    return render(title, proposal.sentence, sections, list(proposal.check))


def _table(found: Survey, proposal: Proposal) -> Table:
    meant = {entry.channel: name for name, entry in proposal.entries.items()}
    rows = [
        Row(
            [
                one.name,
                one.unit or "not stated",
                f"{rate:.6g} Hz" if (rate := one.rate or proposal.rate) and one.samples else "",
                str(one.samples),
                str(one.missing) if one.missing else "",
                one.text if one.is_text else f"{one.low:.4g} to {one.high:.4g}",
                meant.get(one.name, ""),
            ]
        )
        for one in found.channels
    ]
    header = ["channel", "unit", "rate", "samples", "missing", "range", "taken for"]
    return Table(header, rows, texts=(1, 6))
