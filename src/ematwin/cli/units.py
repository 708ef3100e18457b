"""``ematwin units``: the units in which a user wants to see values, kept in the settings."""

import tomllib

import tomli_w
import typer

from ematwin.cli.options import JSON, argument, print_json
from ematwin.errors import FileError, InputError
from ematwin.files import write_text
from ematwin.quantities import QUANTITIES, parse_units, settings_file, units_in_settings


def units(
    keep: str | None = argument(
        'Units to keep, e.g. "angle=mrad, torque=mN m"; SI forgets them.', None
    ),
    json: bool = JSON,
) -> None:
    """List or keep the units in which values are shown, on pages as well.

    Tables, JSON and DataFrames stay SI.
    """
    path = settings_file()
    if keep is not None:
        if "=" not in keep and keep.strip().casefold() != "si":
            raise InputError(
                f'Give units such as "angle=mrad, torque=mN m", or SI; received {keep!r}.'
            )
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
        print_json({"file": str(path), "units": known, "quantities": list(QUANTITIES)})
        return
    for name, own in QUANTITIES.items():
        typer.echo(f"{name:<15} {known.get(name, own[0].replace('*', ' '))}")
    typer.echo(f"Kept in {path}." if known else f"SI; ematwin units keeps others in {path}.")
