"""``ematwin actuators`` and ``ematwin scenarios``: what is shipped."""

from typing import Annotated

import typer

from ematwin.cli.options import print_json


def actuators(
    name: Annotated[
        str | None, typer.Argument(help="Show all parameters of this set or TOML file.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """List the shipped actuator parameter sets, or show one with units and sources."""
    from ematwin.plant.kinds import load_actuator, shipped_actuators

    if name is None:
        sets = {key: load_actuator(key).description for key in shipped_actuators()}
        if json:
            print_json(sets)
        else:
            for key, description in sets.items():
                typer.echo(f"{key:<12} {description}")
        return
    actuator = load_actuator(name)
    rows = list(actuator.parameters())
    if json:
        print_json(
            {
                "name": actuator.name,
                "description": actuator.description,
                "parameters": {
                    place: {"value": value, "unit": unit, "meaning": meaning, "source": source}
                    for place, value, unit, meaning, source in rows
                },
            }
        )
        return
    typer.echo(f"{actuator.name}: {actuator.description}\n")
    for place, value, unit, meaning, source in rows:
        typer.echo(f"{place:<34} {value:>10.4g} {unit:<10} {meaning}  [{source}]")


def scenarios(
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """List the shipped scenarios."""
    from ematwin.plant.scenario import Scenario, shipped_scenarios

    found = [Scenario.load_file(key) for key in shipped_scenarios()]
    if json:
        print_json({s.name: {"duration": s.duration, "description": s.description} for s in found})
        return
    for s in found:
        typer.echo(f"{s.name:<10} {s.duration:>5.4g} s  {s.description}")
