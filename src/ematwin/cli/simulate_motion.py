"""``ematwin simulate`` of a ball-screw actuator: one motion out and back."""

from pathlib import Path

import typer

from ematwin.cli.options import numbers, print_json
from ematwin.errors import InputError

STROKE, SECONDS, REST = 0.12, 5.0, 3.0  # m, s one way, s between
MAGNITUDES = ("friction", "backlash", "gain", "roughness", "load")


def simulate_motion(
    actuator: str, fault: list[str] | None, out: Path | None, seed: int, json: bool
) -> None:
    """Simulate a motion and write it as a test bench would."""
    import numpy as np

    from ematwin.monitoring.simulate import out_and_back, write_motions
    from ematwin.monitoring.simulate import simulate_motion as run
    from ematwin.plant.ball_screw import BallScrew
    from ematwin.plant.kinds import load_actuator
    from ematwin.readers.files import check_target
    from ematwin.simulation import check_seed

    magnitudes = numbers(fault or [], "--fault")
    for name in magnitudes:
        if name not in MAGNITUDES:
            raise InputError(
                f"A ball-screw actuator has no fault {name!r}; there are {', '.join(MAGNITUDES)} "
                "(factors; m; share; N). Correct the name."
            )
    check_seed(seed)
    if out is not None:
        check_target(out, (".csv", ".parquet"))
    chosen = load_actuator(actuator)
    assert isinstance(chosen, BallScrew)
    set_point, interval = out_and_back(chosen, STROKE, SECONDS, REST)
    motion = run(
        chosen,
        set_point,
        interval,
        friction=magnitudes.get("friction", 1.0),
        backlash=magnitudes.get("backlash"),
        gain=magnitudes.get("gain", 1.0),
        roughness=magnitudes.get("roughness", 0.0),
        load=magnitudes.get("load", 0.0),
        seed=seed,
    )
    if out is not None:
        write_motions([motion], out)
    rms = float(np.sqrt(np.mean(motion.current**2)))
    largest = float(np.abs(motion.position_error).max())
    if json:
        print_json(
            {
                "actuator": chosen.name, "faults": magnitudes, "samples": motion.time.size,
                "sample_rate": 1.0 / interval, "current_rms": rms,
                "position_error_largest": largest, "seed": seed,
                "out": None if out is None else str(out),
            }
        )  # fmt: skip
        return
    typer.echo(
        f"{chosen.name}, {1e3 * STROKE:g} mm out and back: {motion.time.size} samples at "
        f"{1.0 / interval:g} Hz, current {rms:.3g} A RMS, position error up to "
        f"{1e3 * largest:.3g} mm"
    )
    if out is not None:
        typer.echo(f"wrote {out}")
