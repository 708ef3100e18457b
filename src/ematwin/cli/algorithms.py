"""``ematwin algorithms``: what can search, where it comes from, whether it is installed."""

import typer

from ematwin.cli.options import JsonOption, print_json


def algorithms(
    json: JsonOption = False,
) -> None:
    """List the search algorithms: sources, departures, what they were tuned on, presets."""
    from ematwin.estimation.search import methods
    from ematwin.optimizers.base import EXTRA
    from ematwin.optimizers.registry import PRESETS

    found = methods()
    if json:
        print_json([{**vars(one), "aliases": list(one.aliases)} for one in found])
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
