"""How the error of both models falls with their step, in a smooth case and in the default case.

    python benchmarks/convergence.py [--json]

The smooth case has no dry friction, no backlash and no hysteresis: a step command that keeps the
bridge at full voltage, watched until the first commutation. The default case is the shipped
actuator on the shipped scenario, events and all. An error is the RMS difference to a run with a
much shorter step, as a share of that run's RMS: of the current in the smooth case, and of the
filtered equivalent current, which is what identification compares, in the default case.
"""

import argparse
import json
import math
from dataclasses import asdict, dataclass

import numpy as np

from ematwin.models.bldc.envelope import signed_current
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario, Step
from ematwin.models.simulating import simulate
from ematwin.numerics.low_pass import LowPass
from ematwin.recordings.recording import Recording

SAMPLE_RATE = 25_000.0  # Hz: 40 us, a multiple of all steps
STEPS = {"reference": (2e-6, 1e-6, 0.5e-6, 0.25e-6), "monitor": (40e-6, 20e-6, 10e-6, 5e-6, 2.5e-6)}
FINEST = {"reference": 0.03125e-6, "monitor": 0.15625e-6}
CUTOFF = 500.0  # Hz


@dataclass(frozen=True)
class Row:
    """Error at one step; ``order`` compares it with the step before, None for the first."""

    model: str
    case: str
    step: float  # s
    error: float  # share of RMS
    order: float | None


def smooth_actuator() -> BldcActuator:
    """The default actuator without dry friction and backlash."""
    return BldcActuator.load().changed(
        {
            "motor.friction_torque": 0.0,
            "transmission.friction_torque": 0.0,
            "transmission.efficiency_opposing": 1.0,
            "transmission.efficiency_aiding": 1.0,
            "transmission.backlash": 0.0,
        }
    )


# 0.26 rad on the motor, where the first commutation waits, are passed after about 1.3 ms.
SMOOTH = Scenario(name="smooth", duration=1e-3, command=[Step(value=0.5)])


def _current(record: Recording, pole_pairs: int) -> np.ndarray:
    signed = signed_current(record, pole_pairs)
    if signed is None:  # a monitor current that never was negative
        assert record.current is not None
        return record.current
    return signed


def response(model: str, case: str, step: float) -> np.ndarray:
    """The compared signals, (S,) or longer: current, and motor speed in the smooth case."""
    if case == "smooth":
        actuator = smooth_actuator()
        record = simulate(model, SMOOTH, None, actuator, sample_rate=SAMPLE_RATE, step=step)
        return _current(record, actuator.motor.pole_pairs)
    record = simulate(model, sample_rate=SAMPLE_RATE, step=step)
    current = _current(record, BldcActuator.load().motor.pole_pairs)
    return LowPass(CUTOFF).apply(current, SAMPLE_RATE)


def table(model: str, case: str) -> list[Row]:
    """Errors of a model at falling steps against its finest run."""
    finest = response(model, case, FINEST[model])
    rows: list[Row] = []
    for step in STEPS[model]:
        difference = response(model, case, step) - finest
        error = float(np.sqrt(np.mean(difference**2) / np.mean(finest**2)))
        order = None
        if rows:
            order = math.log(rows[-1].error / error) / math.log(rows[-1].step / step)
        rows.append(Row(model, case, step, error, order))
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="for programs")
    as_json = parser.parse_args().json
    rows = [row for model in STEPS for case in ("smooth", "default") for row in table(model, case)]
    if as_json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
        return
    print("| model | case | step, us | error, % of RMS | order |")
    print("|---|---|---|---|---|")
    for row in rows:
        order = "" if row.order is None else f"{row.order:.2f}"
        print(
            f"| {row.model} | {row.case} | {1e6 * row.step:g} | {100.0 * row.error:.3g} | {order} |"
        )


if __name__ == "__main__":
    main()
