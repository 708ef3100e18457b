"""``ematwin serve``: the pages of a fleet, on this machine."""

from pathlib import Path
from typing import Annotated

import typer


def serve(
    fleet: Annotated[Path, typer.Argument(help="The folder of `ematwin watch --fleet`.")],
    port: Annotated[
        int, typer.Option(help="Port of the page on this machine; 0 takes a free one.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address and open nothing.")
    ] = False,
) -> None:
    """Show a fleet in the browser, as it is at each moment: read only, on this machine only."""
    import webbrowser

    from ematwin.fleet.fleet import Fleet
    from ematwin.fleet.serve import FleetServer

    with FleetServer(Fleet(fleet, create=False), port) as server:
        typer.echo(f"{server.address}\nThe fleet is on this page. Ctrl-C ends it.")
        if not no_browser:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("Ended.")
