"""``ematwin store``: whether a study's store is whole, and what can be rescued if it is not."""

from typing import Annotated

import typer

from ematwin.cli.options import JsonOption, print_json
from ematwin.errors import FileError

app = typer.Typer(
    help="Check the store of a study, or rescue what is whole of a damaged one.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
_SHOWN = 20  # damaged rows that are listed

Where = Annotated[
    str, typer.Argument(help="The store of `ematwin compare`: a file or a database URL.")
]


@app.command("check")
def check(
    store: Where,
    json: JsonOption = False,
) -> None:
    """Verify every run of a store by its checksum."""
    from ematwin.comparison.study.rescue import check as looked

    found = looked(store)
    if json:
        print_json(
            {"store": store, "runs": len(found.runs), "without_checksum": found.unsealed,
             "damaged": found.damaged}
        )  # fmt: skip
    elif not found.damaged:
        typer.echo(f"{store}: {len(found.runs)} runs, all as they were written.")
    if found.unsealed and not json:
        typer.echo(
            f"{found.unsealed} of them have no checksum, because an older ematwin wrote them; "
            "repeating the study's command adds it."
        )
    if found.damaged:
        if not json:
            _list(found.damaged)
        raise FileError(
            f"The store {store} is damaged: {len(found.runs)} runs are whole, "
            f"{len(found.damaged)} are not. Rescue what is whole with: ematwin store rescue "
            f"{store} --out rescued.db"
        )


@app.command("rescue")
def rescue(
    store: Where,
    out: Annotated[str, typer.Option(help="The new store, a file or a database URL.")],
    json: JsonOption = False,
) -> None:
    """Carry what is whole to a new store; the old one is not touched."""
    from ematwin.comparison.study.rescue import rescue as carried

    found = carried(store, out)
    if json:
        print_json({"store": out, "runs": len(found.runs), "lost": found.damaged})
        return
    typer.echo(f"wrote {len(found.runs)} runs to {out}")
    if found.damaged:
        typer.echo(f"Lost, {len(found.damaged)}:")
        _list(found.damaged)
        typer.echo(f"To do these again, repeat the study's command with --store {out}")


def _list(rows: list[str]) -> None:
    for row in rows[:_SHOWN]:
        typer.echo(f"- {row}")
    if len(rows) > _SHOWN:
        typer.echo(f"- and {len(rows) - _SHOWN} more")
