"""``ematwin actuators``, ``scenarios`` and ``algorithms``: lists of all that can be named."""

from pathlib import Path

import typer

import ematwin
from ematwin.cli import complete, options
from ematwin.cli.options import argument, option
from ematwin.errors import InputError
from ematwin.files import check_target, write_text
from ematwin.quantities import preferred


def actuators(
    name: str | None = argument(
        "Show all parameters of this set or TOML file.", None, autocompletion=complete.actuators
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
            options.print_json({one.name: one.description for one in found})
        else:
            for one in found:
                typer.echo(f"{one.name:<12} {one.kind:<12} {one.description}")
            options.print_notes("Warning", broken_kinds())
        return
    actuator = ematwin.load_actuator(name)
    model = model_of(actuator)
    rows = list(actuator.parameters())
    if out is not None:
        check_target(out, (".toml",), replace=force)
        write_text(out, actuator.template(parameter_table(name, shipped_actuators())))
    plain = {
        "name": actuator.name,
        "kind": model.kind,
        "description": actuator.description,
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
            one.name: {
                key: getattr(one, key)
                for key in ("role", "unit", "meaning", "healthy", "lower", "upper")
            }
            for one in model.unknowns(actuator)
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

    options.answer(json, lambda: plain, tell, out)


def scenarios(json: bool = options.JSON) -> None:
    """List the shipped scenarios of all kinds."""
    from ematwin.models.registry import models

    found = [
        (model.kind, model.load_scenario(key))
        for model in models().values()
        for key in model.scenarios()
    ]
    if json:
        options.print_json({
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
        options.print_json([
            {**{name: getattr(one, name) for name in told}, "aliases": list(one.aliases)}
            for one in found
        ])  # fmt: skip
        return
    for one in found:
        state = "" if one.installed else f'  not installed: pip install "ematwin[{EXTRA}]"'
        typer.echo(f"{one.name:<20} {one.title}{state}")
        for label, text in (
            ("from", one.source), ("departures", one.departures), ("tuned on", one.tuned_on)
        ):  # fmt: skip
            typer.echo(f"{'':<20}   {label}: {text}")
    for name, members in PRESETS.items():
        typer.echo(f"{name:<20} in a study: {', '.join(members)}")
