"""``ematwin simulate``, ``explore`` and ``export-fmu``: an actuator as recording, page, FMU."""

from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, option
from ematwin.errors import InputError
from ematwin.files import check_target, write_text
from ematwin.showing.text import said


def simulate(
    fault: list[str] | None = option(
        "A fault and its magnitude, e.g. friction=0.25: in [0, 1] for the brushless "
        "actuator, for other kinds in its own unit (`ematwin actuators NAME`). Repeatable."
    ),
    model: str | None = option("For the brushless actuator: reference (default) or monitor."),
    scenario: str | None = options.SCENARIO,
    actuator: str = options.ACTUATOR,
    out: Path | None = option("Write the record here (.parquet or .csv)."),
    plot: Path | None = option(
        "Write a page here that shows the record beside the healthy one (.html)."
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
    from ematwin.models.reading import WRITTEN
    from ematwin.models.registry import model_of
    from ematwin.models.unknown import table_of

    chosen = ematwin.load_actuator(actuator)
    kind = model_of(chosen)
    values = kind.values_of(chosen, options.numbers(fault or [], "--fault"))
    asked = kind.load_scenario(scenario)
    if out is not None:
        check_target(out, WRITTEN)
        for source in (scenario or "", actuator):
            if Path(source).is_file() and out.exists() and out.samefile(source):
                raise InputError(f"--out {out} would overwrite its own input. Give another name.")
    options.check_outputs(plot)
    more = [] if also is None else [name.strip() for name in also.split(",") if name.strip()]
    settings: dict[str, Any] = {
        "noise": noise, "seed": seed, "sample_rate": sample_rate, "step": step, "also": more,
    }  # fmt: skip
    with answers.progress_bar(f"Simulating {asked.duration:g} s", not json) as progress:
        record = ematwin.simulate(model, asked, values, chosen, progress=progress, **settings)
    if out is not None:
        ematwin.write(record, out)
    if plot is not None:
        from ematwin.report.recordings import comparison_page

        with answers.progress_bar("Simulating healthy", not json) as progress:
            healthy = ematwin.simulate(model, asked, None, chosen, progress=progress, **settings)
        write_text(plot, comparison_page(record, healthy, values, chosen))
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
    told = (
        f"{table_of(described)}\n\n{fidelity} model of {chosen.name}, scenario {asked.name}: "
        f"{len(record)} samples at {record.sample_rate:g} Hz, {numbers}"
    )
    answers.give(json, lambda: plain, lambda: typer.echo(told), out, plot)


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
