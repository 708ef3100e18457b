"""``ematwin explore`` and ``ematwin serve``: the interactive twin and a fleet, on local pages."""

from pathlib import Path

import ematwin
from ematwin.cli import options
from ematwin.cli.options import argument
from ematwin.cli.recordings import map_of, meant


def explore(
    record: Path | None = argument(
        "A recording: Parquet, CSV, MAT, MDF4, TDMS or HDF5; without one the twin is "
        "shown beside the healthy one.",
        None,
    ),
    actuator: str | None = options.RECORDED_ACTUATOR,
    scenario: str | None = options.SCENARIO,
    column: list[str] | None = options.COLUMN,
    map_file: Path | None = options.MAP,
    port: int = options.PORT,
    units: str | None = options.UNITS,
    no_browser: bool = options.NO_BROWSER,
) -> None:
    """Drag the faults of the twin, and see its answer beside a recording's, in the browser."""
    from ematwin.exploring.explorer import Explorer
    from ematwin.exploring.server import Server

    recording, known = None, ematwin.Calibration.of(actuator)
    if record is not None:
        known = ematwin.Calibration.of(actuator or meant([record], column, map_file))
        columns = map_of(column, map_file, known.actuator)
        recording = ematwin.read(record, columns, actuator=known.actuator)
    options.serve_page(Server(Explorer(recording, known, scenario), port), "The twin", no_browser)


def serve(
    fleet: Path = argument("The folder of `ematwin watch --fleet`."),
    port: int = options.PORT,
    units: str | None = options.UNITS,
    no_browser: bool = options.NO_BROWSER,
) -> None:
    """Show a fleet in the browser, as it is at each moment: read only, on this machine only."""
    from ematwin.fleet.serve import FleetServer

    options.serve_page(
        FleetServer(ematwin.Fleet(fleet, create=False), port), "The fleet", no_browser
    )
