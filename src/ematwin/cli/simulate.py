"""``ematwin simulate``, ``demo``, ``explore``, ``export-fmu``: an actuator as recording, page, FMU.

The demo is a drive as it is built, calibrated on three healthy records. Its data sheet has motor,
gear, and the gains that the commissioning software shows. It leaves out how loops are sampled, that
they integrate, the encoders and the cogging: calibration finds them.
"""

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.diagnose import print_findings
from ematwin.cli.fleet import print_fleet
from ematwin.cli.options import argument, file_to_write, flag, option
from ematwin.errors import FileError, InputError
from ematwin.files import write_text
from ematwin.showing.text import said


def simulate(
    fault: list[str] | None = option(
        "A fault and its magnitude, e.g. friction=0.25: in [0, 1] for the brushless "
        "actuator, for other kinds in its own unit (`ematwin actuators NAME`). Repeatable."
    ),
    model: str | None = option("For the brushless actuator: reference (default) or monitor."),
    scenario: str | None = options.SCENARIO,
    actuator: str = options.ACTUATOR,
    out: Path | None = file_to_write(
        "Write the record here (.parquet or .csv).", ".parquet", ".csv"
    ),
    plot: Path | None = file_to_write(
        "Write a page here that shows the record beside the healthy one (.html).", ".html"
    ),
    noise: str | None = option("Sensor noise, e.g. white=0.02,offset=0.05,bits=12,full_scale=25."),
    seed: int = option("Seed of the noise.", 0),
    sample_rate: float | None = option("Samples per second, Hz; the kind's own if not given."),
    step: float | None = option("Step of the model, s; the actuator's if not given."),
    also: str | None = option(
        "Further channels, with commas, e.g. voltage_a,voltage_b,voltage_c or bus_current."
    ),
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Simulate an actuator with any mix of its faults."""
    from ematwin.models.registry import model_of
    from ematwin.models.unknown import table_of

    chosen = ematwin.load_actuator(actuator)
    kind = model_of(chosen)
    values = kind.values_of(chosen, options.numbers(fault or [], "--fault"))
    asked = kind.load_scenario(scenario)
    for source in (scenario or "", actuator):
        if Path(source).is_file() and out is not None and out.exists() and out.samefile(source):
            raise InputError(f"--out {out} would overwrite its own input. Give another name.")
    more = [] if also is None else [name.strip() for name in also.split(",") if name.strip()]
    settings: dict[str, Any] = {
        "noise": noise, "seed": seed, "step": step, "also": more, "sample_rate": sample_rate,
        "progress": not json,
    }  # fmt: skip
    record = ematwin.simulate(model, asked, values, chosen, **settings)

    def page(path: Path) -> None:
        from ematwin.report.recordings import comparison_page

        healthy = ematwin.simulate(model, asked, None, chosen, **settings)
        write_text(path, comparison_page(record, healthy, values, chosen))

    summary = kind.summary(record, chosen)
    described = kind.describe(chosen, values)
    fidelity = model or kind.fidelities[0]
    plain = {
        "model": fidelity, "kind": kind.kind, "actuator": chosen.name, "scenario": asked.name,
        "faults": values,
        "physical": {
            row.name: {"value": row.value, "healthy": row.healthy, "unit": row.unit}
            for row in described
        },
        "samples": len(record), "sample_rate": record.sample_rate, **summary, "seed": seed,
        "out": out, "plot": plot,
    }  # fmt: skip
    own = {one.name: one.unit for one in kind.channels}
    numbers = ", ".join(
        f"{name.replace('_', ' ')} {said(x, own.get(name.rpartition('_')[0], ''), 3)}"
        for name, x in summary.items()
    )
    what = f"{fidelity} model of {chosen.name}, scenario {asked.name}"
    samples = f"{len(record)} samples at {record.sample_rate:g} Hz"
    told = f"{table_of(described)}\n\n{what}: {samples}, {numbers}"
    files = (out, partial(ematwin.write, record)), (plot, page)
    answers.give(json, lambda: plain, lambda: typer.echo(told), *files)


def export_fmu(
    actuator: str = argument(
        "A shipped parameter set of any kind, a TOML file, or a calibration.",
        autocompletion=options.ACTUATORS,
    ),
    out: Path = option("Write the archive here (.fmu).", ...),
    fidelity: str | None = option(
        "reference or monitor, where a kind has both; its first if not given."
    ),
    fmi: int = option("Version of the standard: 3 or 2.", 3),
    json: bool = options.JSON,
) -> None:
    """Export an actuator for co-simulation elsewhere: an FMU that needs no Python."""
    from ematwin.models.registry import model_of

    chosen = ematwin.load_actuator(actuator)
    written = ematwin.export_fmu(chosen, out, fidelity=fidelity, fmi=fmi)
    form = fidelity or model_of(chosen).fidelities[0]
    plain = {
        "out": written, "actuator": chosen.name, "kind": chosen.kind, "fidelity": form, "fmi": fmi,
        "fingerprint": chosen.fingerprint,
    }  # fmt: skip
    told = f"{form} model of {chosen.name} as FMI {fmi}.0 co-simulation"
    answers.give(json, lambda: plain, lambda: typer.echo(told), written)


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
        known = ematwin.Calibration.of(actuator or options.meant([record], column, map_file))
        columns = options.map_of(column, map_file, known.actuator)
        recording = ematwin.read(record, columns, actuator=known.actuator)
    answers.serve_page(Server(Explorer(recording, known, scenario), port), "The twin", no_browser)


DRIVE, SHEET = "servo48-drive", "servo48"
KNOWN = ("controller.position_gain", "controller.speed_gain")  # as commissioned, to 1 %
# How the actuator differs from its data sheet, as factors: nobody knows these numbers.
OFF = {
    "motor.emf_constant": 0.97, "motor.inertia": 1.06, "motor.viscous_damping": 1.3,
    "motor.friction_torque": 1.2, "transmission.friction_torque": 0.8,
    "transmission.output_inertia": 1.15, "transmission.backlash": 1.25,
}  # fmt: skip
FAULTS = {"friction": 0.25, "short_b": 0.15}
# What such a drive is learnt from, beside the default command.
REVERSALS: dict[str, Any] = {  # slow ones show the gap
    "name": "reversals", "duration": 0.6,
    "command": [{"type": "sine", "amplitude": 0.004, "frequency": 4.0}],
}  # fmt: skip
RUN: dict[str, Any] = {  # at constant speed both ways: shows the cogging
    "name": "run", "duration": 0.6,
    "command": [
        {"type": "ramp", "rate": 0.2, "start": 0.05, "stop": 0.3},
        {"type": "ramp", "rate": -0.2, "start": 0.3, "stop": 0.55},
    ],
    "load": [{"type": "step", "value": 10.0, "time": 0.2}],
}  # fmt: skip


def demo(
    folder: Path = option("Write the records and the pages here.", Path("ematwin-demo")),
    seed: int = option("Seed of the sensor noise and of the search.", 1),
    fleet: bool = flag("--fleet", "Instead simulate a fleet, 60 actuators over three years."),
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Learn how a drive is built from healthy records, and find the faults of a later one."""
    from ematwin.report.recordings import comparison_page

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as refusal:
        advice = "Choose another with --folder."
        raise FileError(f"Cannot make the folder {folder}: {refusal.strerror}. {advice}") from None
    if fleet:
        _fleet(folder, seed, json)
        return
    drive = ematwin.load_actuator(DRIVE)
    sheet = ematwin.load_actuator(SHEET).changed({place: drive.value(place) for place in KNOWN})
    sheet = sheet.with_tolerances(dict.fromkeys(KNOWN, 0.01))
    actual = drive.changed({place: drive.value(place) * factor for place, factor in OFF.items()})
    injected = ematwin.Faults.of(FAULTS)
    sensor = ematwin.Noise(white=0.02, bits=12)
    commands: list[Any] = ["default", ematwin.Scenario(**REVERSALS), ematwin.Scenario(**RUN)]
    files = [folder / f"healthy-{n}.parquet" for n in range(1, len(commands) + 1)]
    record_file, twin_file = folder / "today.parquet", folder / "calibrated.toml"
    sheet_file = folder / "sheet.toml"
    sheet.save(sheet_file)
    with answers.progress_bar("Compiling (first run only) and recording", not json) as progress:
        healthy = []
        settings: dict[str, Any] = {"actuator": actual, "noise": sensor}
        for n, (command, file) in enumerate(zip(commands, files, strict=True), start=1):
            healthy.append(ematwin.simulate("reference", command, seed=10 * seed + n, **settings))
            ematwin.write(healthy[-1], file)
            progress(n / (len(files) + 1))
        faulty = ematwin.simulate("reference", faults=injected, seed=seed, **settings)
        ematwin.write(faulty, record_file)
        progress(1.0)
    page = comparison_page(faulty, healthy[0], injected.as_dict(), sheet)
    write_text(folder / "simulated.html", page)
    twin = ematwin.calibrate(files, sheet_file, name="calibrated", progress=not json)
    twin.save(twin_file)
    twin.report(folder / "calibrated.html")
    record = ematwin.read(record_file)
    found = ematwin.identify(record, twin, seed=seed, progress=not json)
    without = ematwin.identify(record, sheet_file, seed=seed, progress=not json)
    found.report(folder / "report.html")
    without.report(folder / "uncalibrated.html")
    if json:
        answers.print_json({
            **found.as_dict(), "injected": injected.as_dict(), "uncalibrated": without.as_dict(),
            "forms": twin.baseline.forms, "record": record_file, "healthy_records": files,
            "twin": twin_file, "report": folder / "report.html",
        })  # fmt: skip
        return
    off = ", ".join(f"{place} x{factor:g}" for place, factor in OFF.items())
    typer.echo(f"The actuator differs from its data sheet: {off}.")
    typer.echo("The sheet leaves out how loops are sampled and integrate, encoders and cogging.")
    fitted = {p.place: p for p in twin.parameters}
    shares = {place: fitted[place].value / sheet.value(place) for place in OFF if place in fitted}
    told = ", ".join(f"{place} x{share:.3g}" for place, share in shares.items())
    typer.echo(f"\nLearnt from {len(files)} healthy records: {told}.\n{twin.baseline.forms}")
    text = ", ".join(f"{name} {value:g}" for name, value in FAULTS.items())
    typer.echo(f"\nThen injected: {text}; sensor: 2 % white noise, 12 bits, 20 kHz.\n")
    print_findings(found)
    typer.echo(f"\nWithout calibration, from the data sheet alone:\n{without.verdict.sentence}")
    pages = ("calibrated.html", "report.html", "uncalibrated.html", "simulated.html")
    typer.echo(f"wrote {', '.join(str(folder / name) for name in (twin_file.name, *pages))}")


def _fleet(folder: Path, seed: int, json: bool) -> None:
    """Fill a fleet with simulated estimates, and write its page."""
    from ematwin.fleet.simulated import SimulatedFleet

    if any((folder / name).exists() for name in ("rows", "fleet.toml")):
        raise InputError(f"{folder} holds a fleet already. Choose another with --folder.")
    with (
        answers.progress_bar("Simulating the fleet", not json) as progress,
        TemporaryDirectory(dir=folder, prefix=".") as draft,  # gone where Ctrl-C ends this
    ):
        fleet = ematwin.Fleet(draft)
        SimulatedFleet(seed=seed).fill(fleet.store)
        progress(0.3)
        fleet.refresh()
        fleet.update()
        progress(0.7)
        fleet.report(Path(draft) / "fleet.html")
        for one in Path(draft).iterdir():
            one.rename(folder / one.name)
    if json:
        advisories = {row["serial_number"]: row["advisory"] for row in fleet.table()}
        page = folder / "fleet.html"
        answers.print_json({"fleet": folder, "report": page, "advisories": advisories})
        return
    print_fleet(fleet)
    typer.echo(f"wrote {folder / 'fleet.html'}. See it live: ematwin serve {folder}")
