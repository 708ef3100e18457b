"""``ematwin channels``: the channels of a file and a proposed map."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, option
from ematwin.files import check_target, write_text
from ematwin.showing.text import capital


def channels(
    file: Path = argument("CSV, Parquet, Excel, MAT, MDF4, TDMS, HDF5, ULog or MCAP."),
    actuator: str | None = options.RECORDED_ACTUATOR,
    write: Path | None = option("Write the proposed map here (.toml), for identify --map."),
    plot: Path | None = option("Write a page with every channel here (.html)."),
    force: bool = options.FORCE,
    json: bool = options.JSON,
) -> None:
    """List the channels of a file, and propose which is which, with reasons.

    Names, units, rates, ranges and a small plot of each. Open choices are asked.
    """
    from ematwin.recordings.survey import survey
    from ematwin.report.recordings import channels_page, channels_table

    if write is not None:
        check_target(write, (".toml",), replace=force)
    options.check_outputs(plot)
    chosen = ematwin.load_actuator(actuator or options.meant([file], None, None))
    with answers.progress_bar(f"Reading {file.name}", not json) as progress:
        found = survey(file, progress=progress)
        proposal = ematwin.propose_map(file, chosen, found)
    if write is not None:
        write_text(write, proposal.as_toml())
    if plot is not None:
        write_text(plot, channels_page(found, proposal))

    def plain() -> dict[str, Any]:
        return {
            "file": file, "format": found.kind,
            "channels": [one.as_dict() for one in found.channels],
            "assumed": list(found.assumed), "map": proposal.as_dict(), "written": write,
            "plot": plot,
        }  # fmt: skip

    def tell() -> None:
        title = f"Channels of {file.name}"
        answers.print_table(
            title, channels_table(found, proposal, sparkline), whole=["shape"], width=160
        )
        answers.print_notes("Assumed", (f"{capital(text)}." for text in found.assumed))
        print_proposal(proposal, file, actuator or chosen.name, write)

    answers.give(json, plain, tell, plot)


def print_proposal(proposal: Any, file: Path, actuator: str, written: Path | None) -> None:
    """Print the map with its reasons, open questions, and the next command."""
    typer.echo(f"\nProposed map for the kind {proposal.kind}:")
    for name, entry in proposal.entries.items():
        unit = f"{' or '.join(entry.units)}: which?" if entry.is_open else entry.unit
        typer.echo(f'  {name} = "{entry.channel}"{unit and ", "}{unit}')
        typer.echo(f"      {' '.join(entry.reasons)}")
    for question in proposal.questions:
        typer.echo(f"Open: {question.sentence}")
        for line in question.lines:
            typer.echo(f"      {line}")
    if proposal.unused:
        typer.echo(f"Not used: {', '.join(proposal.unused)}")
    doubt = "A recording read so would be refused" if proposal.refused else "Warning"
    answers.print_notes(doubt, proposal.check)
    if written is None:
        typer.echo(f"Next: ematwin channels {file} --actuator {actuator} --write map.toml")
        return
    typer.echo(f"wrote {written}")
    if proposal.is_complete:
        typer.echo(f"Next: ematwin identify {file} --actuator {actuator} --map {written}")
    else:
        typer.echo(f"Next: answer what is open in {written}.")


def sparkline(one: Any) -> str:
    """A channel in one line of blocks: the mean over each piece, from its least to its largest."""
    import numpy as np

    if one.is_text or not np.isfinite(one.low):
        return ""
    count, blocks = 28, "▁▂▃▄▅▆▇█"  # characters
    edges = np.linspace(0, max(one.samples - 1, 1), count + 1)
    place = np.clip(np.searchsorted(edges, one.places, side="right") - 1, 0, count - 1)
    heights = [one.shape[(place == n) & np.isfinite(one.shape)] for n in range(count)]
    means = np.array([piece.mean() if piece.size else np.nan for piece in heights])
    low, high = np.nanmin(means), np.nanmax(means)
    if not high > low:
        return "".join(" " if np.isnan(mean) else "─" for mean in means)
    steps = np.rint((means - low) / (high - low) * (len(blocks) - 1))
    return "".join(" " if np.isnan(step) else blocks[int(step)] for step in steps)
