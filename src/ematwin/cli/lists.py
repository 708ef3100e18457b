"""``ematwin actuators``, ``scenarios``, ``algorithms``, ``channels``, ``units``: lists."""

import tomllib
from pathlib import Path
from typing import Any

import tomli_w
import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, file_to_write, option
from ematwin.errors import FileError, InputError
from ematwin.files import check_target, write_text
from ematwin.quantities import QUANTITIES, parse_units, preferred, settings_file, units_in_settings
from ematwin.showing.text import capital


def actuators(
    name: str | None = argument(
        "Show all parameters of this set or TOML file.", None, autocompletion=options.ACTUATORS
    ),
    out: Path | None = option(
        "Write its parameters to this file (.toml), as a start for your own."
    ),
    force: bool = options.FORCE,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """List the actuators of all kinds, or show one: parameters, channels, faults."""
    from ematwin.models.parameter_file import parameter_table
    from ematwin.models.registry import broken_kinds, model_of, shipped_actuators

    if name is None:
        if out is not None:
            raise InputError("--out needs the name of an actuator; see ematwin actuators.")
        found = [ematwin.load_actuator(key) for key in shipped_actuators()]
        if json:
            answers.print_json({one.name: one.description for one in found})
        else:
            for one in found:
                typer.echo(f"{one.name:<12} {one.kind:<12} {one.description}")
            answers.print_notes("Warning", broken_kinds())
        return
    actuator = ematwin.load_actuator(name)
    model = model_of(actuator)
    rows = list(actuator.parameters())
    if out is not None:
        check_target(out, (".toml",), replace=force)
        write_text(out, actuator.template(parameter_table(name, shipped_actuators())))
    told = ("role", "unit", "meaning", "healthy", "lower", "upper")
    plain = {
        "name": actuator.name, "kind": model.kind, "description": actuator.description,
        "parameters": {
            place: {
                "value": value, "unit": unit, "meaning": meaning, "source": source,
                "tolerance": actuator.tolerance(place), "drift": actuator.drift(place),
            }
            for place, value, unit, meaning, source in rows
        },
        "channels": {
            one.name: {"unit": one.unit, "meaning": one.meaning} for one in model.channels
        },
        "unknowns": {
            one.name: {key: getattr(one, key) for key in told} for one in model.unknowns(actuator)
        },
        "out": out,
    }  # fmt: skip

    def tell() -> None:
        typer.echo(f"{actuator.name}: {actuator.description}\nkind {model.kind}: {model.title}\n")
        for place, value, unit, meaning, source in rows:
            tolerance = actuator.tolerance(place)
            off = "" if tolerance is None else f"±{100.0 * tolerance:.3g} %"
            shown, factor = preferred(unit)
            number = f"{factor * value:>10.4g} {shown:<10}"
            typer.echo(f"{place:<34} {number} {off:<7} {meaning}  [{source}]")
        typer.echo(
            "± tolerance: 95 % of such actuators lie between the value divided by and multiplied "
            "with 1 + tolerance\n\nFaults and other unknowns: healthy value and range"
        )
        for one in model.unknowns(actuator):
            reach = f"{one.lower:.4g} to {one.upper:.4g} {one.unit}".rstrip()
            typer.echo(f"{one.name:<20} {one.healthy:>10.4g}   {reach:<24} {one.meaning}")
        typer.echo("\nChannels of a recording")
        for channel in model.channels:
            typer.echo(f"{channel.name:<20} {channel.unit:<8} {channel.meaning}")

    answers.give(json, lambda: plain, tell, out)


def scenarios(json: bool = options.JSON) -> None:
    """List the shipped scenarios of all kinds."""
    from ematwin.models.registry import models

    found = [(kind, m.load_scenario(key)) for kind, m in models().items() for key in m.scenarios()]
    if json:
        answers.print_json({
            s.name: {"duration": s.duration, "description": s.description, "kind": kind}
            for kind, s in found
        })  # fmt: skip
        return
    for kind, s in found:
        typer.echo(f"{s.name:<14} {kind:<12} {s.duration:>5.4g} s  {s.description}")


def algorithms(json: bool = options.JSON) -> None:
    """List the search algorithms with sources, departures and tuning, and the presets."""
    from ematwin.estimation.search import methods
    from ematwin.optimizers.base import EXTRA
    from ematwin.optimizers.registry import PRESETS

    found = methods()
    if json:
        told = ("name", "title", "source", "origin", "installed", "departures", "tuned_on")
        answers.print_json([
            {**{name: getattr(one, name) for name in told}, "aliases": list(one.aliases)}
            for one in found
        ])  # fmt: skip
        return
    for one in found:
        state = "" if one.installed else f'  not installed: pip install "ematwin[{EXTRA}]"'
        typer.echo(f"{one.name:<20} {one.title}{state}")
        typer.echo(f"{'':<20}   from: {one.source}")
        typer.echo(f"{'':<20}   departures: {one.departures}")
        typer.echo(f"{'':<20}   tuned on: {one.tuned_on}")
    for name, members in PRESETS.items():
        typer.echo(f"{name:<20} in a study: {', '.join(members)}")


def units(
    keep: str | None = argument(
        'Units to keep, e.g. "angle=mrad, torque=mN m"; SI forgets them.', None
    ),
    json: bool = options.JSON,
) -> None:
    """List or keep the units in which values are shown, on pages as well.

    Tables, JSON and DataFrames stay SI.
    """
    path = settings_file()
    if keep is not None:
        if "=" not in keep and keep.strip().casefold() != "si":
            example = '"angle=mrad, torque=mN m"'
            raise InputError(f"Give units such as {example}, or SI; received {keep!r}.")
        given = {} if keep.strip().casefold() == "si" else parse_units(keep)
        kept = {**units_in_settings(), **given} if given else {}
        others = tomllib.loads(path.read_text("utf-8")) if path.is_file() else {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(f"Cannot keep units in {path}: {error.strerror}.") from None
        write_text(path, tomli_w.dumps({**others, "units": kept}))
    known = units_in_settings()
    if json:
        answers.print_json({"file": str(path), "units": known, "quantities": list(QUANTITIES)})
        return
    for name, own in QUANTITIES.items():
        typer.echo(f"{name:<15} {known.get(name, own[0].replace('*', ' '))}")
    typer.echo(f"Kept in {path}." if known else f"SI; ematwin units keeps others in {path}.")


def channels(
    file: Path = argument("CSV, Parquet, Excel, MAT, MDF4, TDMS, HDF5, ULog or MCAP."),
    actuator: str | None = options.RECORDED_ACTUATOR,
    write: Path | None = option("Write the proposed map here (.toml), for identify --map."),
    plot: Path | None = file_to_write("Write a page with every channel here (.html).", ".html"),
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
    chosen = ematwin.load_actuator(actuator or options.meant([file], None, None))
    with answers.progress_bar(f"Reading {file.name}", not json) as progress:
        found = survey(file, progress=progress)
        proposal = ematwin.propose_map(file, chosen, found)
    if write is not None:
        write_text(write, proposal.as_toml())
    plain = {
        "file": file, "format": found.kind, "channels": [one.as_dict() for one in found.channels],
        "assumed": list(found.assumed), "map": proposal.as_dict(), "written": write, "plot": plot,
    }  # fmt: skip

    def tell() -> None:
        shown = channels_table(found, proposal, _sparkline)
        answers.print_table(f"Channels of {file.name}", shown, whole=["shape"], width=160)
        answers.print_notes("Assumed", (f"{capital(text)}." for text in found.assumed))
        _print_proposal(proposal, file, actuator or chosen.name, write)

    page = (plot, lambda path: write_text(path, channels_page(found, proposal)))
    answers.give(json, lambda: plain, tell, page)


def _print_proposal(proposal: Any, file: Path, actuator: str, written: Path | None) -> None:
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


def _sparkline(one: Any) -> str:
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
