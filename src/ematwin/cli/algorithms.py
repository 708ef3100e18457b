"""``ematwin algorithms``: what can search, where it comes from, whether it is installed."""

from typing import Annotated

import typer

from ematwin.cli.options import print_json


def algorithms(
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """List the search algorithms, their sources, and whether each is installed."""
    from ematwin.estimation.search import methods
    from ematwin.optimizers.catalogue import EXTRA

    found = methods()
    if json:
        print_json([{**vars(one), "aliases": list(one.aliases)} for one in found])
        return
    for one in found:
        state = "" if one.installed else f'  not installed: pip install "ematwin[{EXTRA}]"'
        typer.echo(f"{one.name:<16} {one.title}  [{one.source}]{state}")
