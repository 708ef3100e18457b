"""``ematwin demo``: the whole path on an actuator with three faults."""

from pathlib import Path
from typing import Annotated

import typer

from ematwin.cli.identify import print_findings, search_bar
from ematwin.cli.options import print_json, progress_bar

FAULTS = {"friction": 0.3, "short_b": 0.2, "eccentricity": 0.4, "eccentricity_phase": 0.7}


def demo(
    folder: Annotated[Path, typer.Option(help="Write the record and the pages here.")] = Path(
        "ematwin-demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the sensor noise and of the search.")] = 1,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Simulate a faulty actuator with sensor noise, find its faults, write a report."""
    from ematwin import BldcActuator, Faults, Noise, error_percent, simulate
    from ematwin.errors import FileError
    from ematwin.estimation.identify import identify
    from ematwin.files import write_text
    from ematwin.models.reading import read, write
    from ematwin.report.comparison import comparison_page
    from ematwin.report.identification import identification_page

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as refusal:
        raise FileError(
            f"Cannot make the folder {folder}: {refusal.strerror}. Choose another with --folder."
        ) from None
    actuator = BldcActuator.load()
    injected = Faults.of(FAULTS)
    sensor = Noise(white=0.02, bits=12)
    with progress_bar("Compiling (first run only) and simulating the faulty actuator") as progress:
        faulty = simulate("reference", faults=injected, noise=sensor, seed=seed, progress=progress)
        healthy = simulate("reference", noise=sensor, seed=seed)
    record_file = folder / "record.parquet"
    write(faulty, record_file)
    page = comparison_page(faulty, healthy, injected.as_dict(), actuator)
    write_text(folder / "simulated.html", page)
    with search_bar(not json) as progress_of_search:
        record = read(record_file)
        found = identify(record, actuator, seed=seed, progress=progress_of_search)
    write_text(folder / "report.html", identification_page(found, record))
    error = float(error_percent(found.faults.vector, injected.vector))
    if json:
        print_json(
            {
                **found.as_dict(),
                "injected": injected.as_dict(),
                "error_percent": error,
                "record": str(record_file),
                "report": str(folder / "report.html"),
            }
        )
        return
    text = ", ".join(f"{name} {value:g}" for name, value in FAULTS.items())
    typer.echo(f"injected: {text}; sensor: 2 % white noise, 12 bits, 20 kHz\n")
    print_findings(found)
    typer.echo(f"Err% of the paper against the injected faults: {error:.2f}")
    typer.echo(f"wrote {record_file}, {folder / 'simulated.html'} and {folder / 'report.html'}")
