"""``ematwin export-fmu``: an actuator as a Functional Mock-up Unit."""

from pathlib import Path
from typing import Annotated

import typer

from ematwin.cli import complete, options


def export_fmu(
    actuator: Annotated[
        str,
        typer.Argument(
            help="A shipped parameter set of any kind, a TOML file, or a calibration.",
            autocompletion=complete.actuators,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Write the archive here (.fmu).")],
    fidelity: Annotated[
        str | None,
        typer.Option(help="reference or monitor, where a kind has both; its first if not given."),
    ] = None,
    fmi: Annotated[int, typer.Option(help="Version of the standard: 3 or 2.")] = 3,
    json: options.JsonOption = False,
) -> None:
    """Export an actuator for co-simulation elsewhere: an FMU that needs no Python."""
    from ematwin.fmu.export import export_fmu as export
    from ematwin.models.registry import load_actuator, model_of

    chosen = load_actuator(actuator)
    written = export(chosen, out, fidelity=fidelity, fmi=fmi)
    form = fidelity or model_of(chosen).fidelities[0]
    plain = {
        "out": written, "actuator": chosen.name, "kind": chosen.kind, "fidelity": form, "fmi": fmi,
        "fingerprint": chosen.fingerprint,
    }  # fmt: skip
    told = f"{form} model of {chosen.name} as FMI {fmi}.0 co-simulation"
    options.answer(json, lambda: plain, lambda: typer.echo(told), written)
