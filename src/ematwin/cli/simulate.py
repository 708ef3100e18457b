"""``ematwin simulate``."""

from pathlib import Path
from typing import Annotated

import typer

from ematwin.cli.options import numbers, print_json, progress_bar


def simulate(
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="A fault and its magnitude in [0, 1], e.g. friction=0.25; of a ball screw in its "
            "own unit, e.g. friction=1.3 times healthy. Repeatable."
        ),
    ] = None,
    model: Annotated[str, typer.Option(help="reference or monitor.")] = "reference",
    scenario: Annotated[
        str, typer.Option(help="A shipped scenario, or a TOML, CSV or Parquet file.")
    ] = "default",
    actuator: Annotated[
        str, typer.Option(help="A shipped parameter set, or a TOML file.")
    ] = "servo48",
    out: Annotated[
        Path | None, typer.Option(help="Write the record here (.parquet or .csv).")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Write a page here that shows the record beside the healthy one (.html)."
        ),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(help="Current sensor, e.g. white=0.02,offset=0.05,bits=12,full_scale=25."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    sample_rate: Annotated[float, typer.Option(help="Samples per second, Hz.")] = 20_000.0,
    step: Annotated[
        float | None, typer.Option(help="Step of the model, s; the actuator's if not given.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Answer as JSON.")] = False,
) -> None:
    """Simulate an actuator with any mix of the eight faults."""
    import numpy as np

    from ematwin import Actuator, Faults, Noise, Scenario
    from ematwin import simulate as run
    from ematwin.errors import InputError
    from ematwin.plant.kinds import kind_of
    from ematwin.readers.files import check_target
    from ematwin.readers.records import WRITTEN, write
    from ematwin.signals.envelope import current_envelope

    if kind_of(actuator) == "ball-screw":
        given = (model, scenario, plot, noise, sample_rate, step)
        if given != ("reference", "default", None, None, 20_000.0, None):
            raise InputError(
                f"{actuator} is a ball-screw actuator, which goes out and back once; of the "
                "options only --fault, --out, --seed and --json apply."
            )
        from ematwin.cli.simulate_motion import simulate_motion

        simulate_motion(actuator, fault, out, seed, json)
        return
    faults = Faults.of(numbers(fault or [], "--fault"))
    chosen = Actuator.load(actuator)
    asked = Scenario.load_file(scenario)
    sensor = None if noise is None else Noise.parse(noise)
    if out is not None:
        check_target(out, WRITTEN)
        for source in (scenario, actuator):
            if Path(source).exists() and out.exists() and out.samefile(source):
                raise InputError(f"--out {out} would overwrite its own input. Give another name.")
    if plot is not None:
        check_target(plot, (".html",))
    with progress_bar(f"Simulating {asked.duration:g} s") as progress:
        record = run(
            model,
            asked,
            faults,
            chosen,
            noise=sensor,
            seed=seed,
            progress=progress,
            sample_rate=sample_rate,
            step=step,
        )
    if out is not None:
        write(record, out)
    if plot is not None:
        from ematwin.readers.files import write_text
        from ematwin.report.comparison import comparison_page

        with progress_bar("Simulating healthy") as progress:
            healthy = run(
                model,
                asked,
                None,
                chosen,
                noise=sensor,
                seed=seed,
                progress=progress,
                sample_rate=sample_rate,
                step=step,
            )
        write_text(plot, comparison_page(record, healthy, faults, chosen))
    envelope = current_envelope(record)
    rms = float(np.sqrt(np.mean(envelope**2)))
    peak = float(envelope.max())
    if json:
        print_json(
            {
                "model": model,
                "actuator": chosen.name,
                "scenario": asked.name,
                "faults": faults.as_dict(),
                "physical": {
                    row.name: {"value": row.value, "healthy": row.healthy, "unit": row.unit}
                    for row in faults.physical(chosen)
                },
                "samples": len(record),
                "sample_rate": record.sample_rate,
                "current_rms": rms,
                "current_peak": peak,
                "seed": seed,
                "out": None if out is None else str(out),
                "plot": None if plot is None else str(plot),
            }
        )
        return
    typer.echo(faults.describe(chosen))
    typer.echo(
        f"\n{model} model of {chosen.name}, scenario {asked.name}: {len(record)} samples at "
        f"{record.sample_rate:g} Hz, equivalent current {rms:.3g} A RMS, {peak:.3g} A peak"
    )
    for path in (out, plot):
        if path is not None:
            typer.echo(f"wrote {path}")
