"""``ematwin bench``: the speed and memory of the twin on this machine."""

from typing import Annotated

import typer

from ematwin.cli.options import JsonOption, print_json


def bench(
    repeats: Annotated[int, typer.Option(min=1, help="Repetitions of most measurements.")] = 7,
    json: JsonOption = False,
) -> None:
    """Measure speed and memory of the twin on this machine against the project's targets."""
    from rich.console import Console

    from ematwin.bench import MEASUREMENTS, machine

    console = Console(stderr=True)
    figures = []
    for measure in MEASUREMENTS:
        with console.status(measure.__doc__ or measure.__name__):
            figures.append(measure(repeats))
    if json:
        print_json({"machine": machine(), "figures": [vars(figure) for figure in figures]})
        return
    where = machine()
    typer.echo(f"{where['processor']}, {where['cores']} cores, numba {where['numba']}\n")
    for figure in figures:
        mark = "holds" if figure.holds else "MISSED"
        typer.echo(
            f"{figure.name:<48} {figure.value:>9.4g} {figure.unit:<12} "
            f"aim {figure.aim:<16} {mark}   spread {figure.low:.4g} to {figure.high:.4g}"
        )
