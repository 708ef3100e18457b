"""``ematwin explore``: the interactive twin, on a local page."""

from pathlib import Path
from typing import Annotated

import typer

from ematwin.cli.options import (
    ColumnOption,
    MapOption,
    NoBrowserOption,
    PortOption,
    RecordedActuatorOption,
    ScenarioOption,
    serve_page,
)


def explore(
    record: Annotated[
        Path | None,
        typer.Argument(
            help="A recording: Parquet, CSV, MAT, MDF4, TDMS or HDF5; without one the twin is "
            "shown beside the healthy one."
        ),
    ] = None,
    actuator: RecordedActuatorOption = None,
    scenario: ScenarioOption = None,
    column: ColumnOption = None,
    map_file: MapOption = None,
    port: PortOption = 0,
    no_browser: NoBrowserOption = False,
) -> None:
    """Drag the faults of the twin, and see its answer beside a recording's, in the browser."""
    from ematwin.cli.channels import map_of
    from ematwin.cli.recordings import meant
    from ematwin.exploring.explorer import Explorer
    from ematwin.exploring.server import Server
    from ematwin.models.reading import read
    from ematwin.monitoring.calibration import Calibration

    recording, known = None, Calibration.of(actuator)
    if record is not None:
        known = Calibration.of(actuator or meant([record], column, map_file))
        columns = map_of(column, map_file, known.actuator)
        recording = read(record, columns, actuator=known.actuator)
    serve_page(Server(Explorer(recording, known, scenario), port), "The twin", no_browser)
