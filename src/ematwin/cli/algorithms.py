"""``ematwin algorithms``: what can search, where it comes from, whether it is installed."""

from typing import Annotated

import typer

from ematwin.cli.options import print_json


def algorithms(
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """List the search algorithms, their sources, and whether each is installed."""
    from ematwin.identification.identify import DEFAULT_ALGORITHM
    from ematwin.optimizers.registry import algorithms as listed

    rows = [
        {
            "name": DEFAULT_ALGORITHM,
            "title": "Sobol samples, then Levenberg-Marquardt (default of identify)",
            "source": "this project, docs/results.md",
            "origin": "ematwin",
            "installed": True,
            "aliases": [],
        }
    ]
    rows += [
        {
            "name": one.name,
            "title": one.title,
            "source": one.source,
            "origin": one.origin,
            "installed": one.installed,
            "aliases": list(one.aliases),
        }
        for one in listed()
    ]
    if json:
        print_json(rows)
        return
    for row in rows:
        state = "" if row["installed"] else '  not installed: pip install "ematwin[bench]"'
        typer.echo(f"{row['name']:<16} {row['title']}  [{row['source']}]{state}")
