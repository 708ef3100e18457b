"""``ematwin serve``: the pages of a fleet, on this machine."""

from pathlib import Path
from typing import Annotated

import typer

from ematwin.cli.options import (
    NoBrowserOption,
    PortOption,
    UnitsOption,
    serve_page,
)


def serve(
    fleet: Annotated[Path, typer.Argument(help="The folder of `ematwin watch --fleet`.")],
    port: PortOption = 0,
    units: UnitsOption = None,
    no_browser: NoBrowserOption = False,
) -> None:
    """Show a fleet in the browser, as it is at each moment: read only, on this machine only."""
    from ematwin.fleet.fleet import Fleet
    from ematwin.fleet.serve import FleetServer

    serve_page(FleetServer(Fleet(fleet, create=False), port), "The fleet", no_browser)
