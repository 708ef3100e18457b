"""Page: the channels of a file, and which is proposed for which."""

from ematwin.plots.channels import plot_channels
from ematwin.recordings.proposal import Proposal, rate_of
from ematwin.recordings.survey import Survey
from ematwin.report.page import Row, Section, Table, render


def channels_page(found: Survey, proposal: Proposal) -> str:
    """HTML page: the proposed map with its reasons, what is open, a plot of every channel."""
    rows = [
        Row(
            [
                name,
                entry.channel,
                entry.unit or f"{' or '.join(entry.units)}?",
                " ".join(entry.reasons),
            ],
            marked=entry.is_open,
        )
        for name, entry in proposal.entries.items()
    ]
    rate = rate_of(found, proposal.entries.get("time"))
    taken = tuple(entry.channel for entry in proposal.entries.values())
    points = [one.sentence for one in proposal.questions]
    sections = [
        Section("Proposed map", table=Table(["taken for", "channel", "unit", "because"], rows,
                                            texts=(1, 2, 3))),
        *([Section("Open", points=points)] if points else []),
        Section("Channels", table=_table(found, proposal, rate)),
        Section(figure=plot_channels(found, taken, rate)),
    ]  # fmt: skip
    lead = (
        f"A map for the kind {proposal.kind} is complete."
        if proposal.is_complete
        else f"A map for the kind {proposal.kind} needs an answer to what is open."
    )
    notes = list(proposal.check)
    return render(f"Channels of {found.path.name}", lead, sections, notes)


def _table(found: Survey, proposal: Proposal, counted: float | None) -> Table:
    meant = {entry.channel: name for name, entry in proposal.entries.items()}
    rows = [
        Row(
            [
                one.name,
                one.unit or "not stated",
                f"{one.rate or counted:.6g} Hz" if (one.rate or counted) and one.samples else "",
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
