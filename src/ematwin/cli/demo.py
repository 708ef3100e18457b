"""``ematwin demo``: an actuator off its data sheet, calibrated on three healthy records."""

from pathlib import Path
from typing import Annotated

import typer

from ematwin.cli import options
from ematwin.cli.identify import print_findings

SHEET = "servo48"
# How the actuator differs from its data sheet, as factors: nobody knows these numbers.
OFF = {
    "motor.emf_constant": 0.97,
    "motor.inertia": 1.06,
    "motor.viscous_damping": 1.3,
    "motor.friction_torque": 1.2,
    "transmission.friction_torque": 0.8,
    "transmission.output_inertia": 1.15,
    "transmission.backlash": 1.25,
    "controller.position_gain": 0.93,
}
FAULTS = {"friction": 0.25, "short_b": 0.15}
HEALTHY_RECORDINGS = 3


def demo(
    folder: Annotated[Path, typer.Option(help="Write the records and the pages here.")] = Path(
        "ematwin-demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the sensor noise and of the search.")] = 1,
    fleet: Annotated[
        bool,
        typer.Option("--fleet", help="Instead simulate a fleet, 60 actuators over three years."),
    ] = False,
    units: options.UnitsOption = None,
    json: options.JsonOption = False,
) -> None:
    """Calibrate an unknown actuator on healthy records, and find the faults of a later one."""
    if fleet:
        _fleet(folder, seed, json)
        return
    from ematwin import BldcActuator, Faults, Noise, simulate
    from ematwin.errors import FileError
    from ematwin.files import write_text
    from ematwin.models.reading import read, write
    from ematwin.monitoring.calibrate import calibrate
    from ematwin.monitoring.identify import identify
    from ematwin.report.comparison import comparison_page

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as refusal:
        raise FileError(
            f"Cannot make the folder {folder}: {refusal.strerror}. Choose another with --folder."
        ) from None
    sheet = BldcActuator.load(SHEET)
    actual = sheet.changed({place: sheet.value(place) * factor for place, factor in OFF.items()})
    injected = Faults.of(FAULTS)
    sensor = Noise(white=0.02, bits=12)
    files = [folder / f"healthy-{n}.parquet" for n in range(1, HEALTHY_RECORDINGS + 1)]
    record_file, twin_file = folder / "today.parquet", folder / "calibrated.toml"
    sheet_file = folder / "sheet.toml"
    sheet.save(sheet_file)
    with options.progress_bar("Compiling (first run only) and recording", not json) as progress:
        for n, file in enumerate(files):
            healthy = simulate("reference", actuator=actual, noise=sensor, seed=10 * seed + n)
            write(healthy, file)
            progress((n + 1) / (len(files) + 1))
        faulty = simulate("reference", faults=injected, actuator=actual, noise=sensor, seed=seed)
        write(faulty, record_file)
        progress(1.0)
    page = comparison_page(faulty, healthy, injected.as_dict(), sheet)
    write_text(folder / "simulated.html", page)
    with options.progress_bar("Calibrating on the healthy records", not json) as progress:
        twin = calibrate(files, sheet_file, name="calibrated", progress=progress)
    twin.save(twin_file)
    record = read(record_file)
    with options.progress_bar("searching", not json) as show:
        tell = options.searching(show, "simulations", "misfit")
        found = identify(record, twin, seed=seed, progress=tell)
        without = identify(record, sheet_file, seed=seed, progress=tell)
    found.report(folder / "report.html")
    without.report(folder / "uncalibrated.html")
    if json:
        options.print_json(
            {
                **found.as_dict(),
                "injected": injected.as_dict(),
                "uncalibrated": without.as_dict(),
                "record": record_file,
                "healthy_records": files,
                "twin": twin_file,
                "report": folder / "report.html",
            }
        )
        return
    off = ", ".join(f"{place} x{factor:g}" for place, factor in OFF.items())
    typer.echo(f"The actuator differs from its data sheet: {off}.")
    fitted = {p.place: p for p in twin.parameters}
    told = ", ".join(
        f"{place} x{fitted[place].value / sheet.value(place):.3g}"
        for place in OFF
        if place in fitted
    )
    typer.echo(f"Learnt from {len(files)} healthy records: {told}.")
    text = ", ".join(f"{name} {value:g}" for name, value in FAULTS.items())
    typer.echo(f"Then injected: {text}; sensor: 2 % white noise, 12 bits, 20 kHz.\n")
    print_findings(found)
    typer.echo(f"\nWithout calibration, from the data sheet alone:\n{without.verdict.sentence}")
    typer.echo(
        f"wrote {twin_file}, {folder / 'report.html'}, {folder / 'uncalibrated.html'} and "
        f"{folder / 'simulated.html'}"
    )


def _fleet(folder: Path, seed: int, json: bool) -> None:
    """Fill a fleet with simulated estimates, and write its page."""
    from ematwin.cli.fleet import print_fleet
    from ematwin.errors import InputError
    from ematwin.fleet.fleet import Fleet
    from ematwin.fleet.simulated import SimulatedFleet

    if (folder / "rows").exists():
        raise InputError(f"{folder} holds a fleet already. Choose another with --folder.")
    fleet = Fleet(folder)
    with options.progress_bar("Simulating the fleet", not json) as progress:
        SimulatedFleet(seed=seed).fill(fleet.store)
        progress(0.3)
        fleet.refresh()
        fleet.update()
        progress(0.7)
        fleet.report(folder / "fleet.html")
    if json:
        options.print_json(
            {
                "fleet": folder,
                "report": folder / "fleet.html",
                "advisories": {r["serial_number"]: r["advisory"] for r in fleet.table()},
            }
        )
        return
    print_fleet(fleet)
    typer.echo(f"wrote {folder / 'fleet.html'}. See it live: ematwin serve {folder}")
