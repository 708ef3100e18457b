"""How the error of both models falls with their step, in a smooth case and in the default case.

    python benchmarks/convergence.py
    python benchmarks/convergence.py --gap 60
    python benchmarks/convergence.py --faulty 24

The smooth case has no dry friction, no backlash and no hysteresis: a step command that keeps the
bridge at full voltage, watched until the first commutation. The default case is the shipped
actuator on the shipped scenario, events and all. An error is the RMS difference to a run with a
much shorter step, as a share of that run's RMS: of the current in the smooth case, and of the
filtered equivalent current, which is what identification compares, in the default case.

``--gap`` gives the gap between the models instead, at their default steps and with the same random
faults in both: the relative misfit of the twin to the reference model. ``--faulty`` gives the error
of the monitor model with single faults, and with so many vectors of random ones.
"""

import argparse
import math
from dataclasses import dataclass

import numpy as np

from ematwin.models.bldc.channels import signed_current
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.faults import FAULTS
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.scenario import Scenario, Step
from ematwin.models.simulating import simulate
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording

SAMPLE_RATE = 20_000.0  # Hz: 50 us, a multiple of all steps
STEPS = {
    "reference": (2e-6, 1e-6, 0.5e-6, 0.25e-6),
    "monitor": (50e-6, 25e-6, 12.5e-6, 5e-6, 2.5e-6),
}
FAULTY_STEPS = (50e-6, 25e-6, 12.5e-6)
FINEST_FAULTY = 0.25e-6
SINGLE: dict[str, dict[str, float]] = {
    "healthy": {}, "friction": {"friction": 0.3}, "backlash, small": {"backlash": 0.01},
    "backlash": {"backlash": 0.2}, "backlash, wide": {"backlash": 0.6}, "short": {"short_a": 0.3},
    "eccentricity": {"eccentricity": 0.4},
}  # fmt: skip
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


def response(
    model: str, case: str, step: float, faults: dict[str, float] | None = None
) -> np.ndarray:
    """The compared signals, (S,) or longer: current, and motor speed in the smooth case."""
    if case == "smooth":
        actuator = smooth_actuator()
        record = simulate(model, SMOOTH, None, actuator, sample_rate=SAMPLE_RATE, step=step)
        return _current(record, actuator.motor.pole_pairs)
    record = simulate(model, faults=faults, sample_rate=SAMPLE_RATE, step=step)
    current = _current(record, BldcActuator.load().motor.pole_pairs)
    return LowPass(CUTOFF).apply(current, SAMPLE_RATE)


def relative_error(seen: np.ndarray, finest: np.ndarray) -> float:
    """RMS difference as a share of the RMS of the finest."""
    return float(np.sqrt(np.mean((seen - finest) ** 2) / np.mean(finest**2)))


def table(model: str, case: str) -> list[Row]:
    """Errors of a model at falling steps against its finest run."""
    finest = response(model, case, FINEST[model])
    rows: list[Row] = []
    for step in STEPS[model]:
        error = relative_error(response(model, case, step), finest)
        order = None
        if rows:
            order = math.log(rows[-1].error / error) / math.log(rows[-1].step / step)
        rows.append(Row(model, case, step, error, order))
    return rows


def random_faults(count: int, seed: int = 99) -> list[dict[str, float]]:
    """Vectors of up to seven faults."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        k = rng.random(8) * np.array([0.7, 0.8, 0.5, 0.5, 0.5, 0.6, 1.0, 1.0])
        k[7] = 0.3 + 0.4 * rng.random()
        k[:6][rng.random(6) < 0.4] = 0.0
        found.append(dict(zip(FAULTS, k.tolist(), strict=True)))
    return found


def faulty(count: int) -> dict[str, np.ndarray]:
    """Errors of the monitor model at `FAULTY_STEPS`, a row for each fault or quantile."""

    def errors(faults: dict[str, float]) -> np.ndarray:
        finest, *others = (
            response("monitor", "default", step, faults) for step in (FINEST_FAULTY, *FAULTY_STEPS)
        )
        return np.array([relative_error(one, finest) for one in others])

    rows = {name: errors(faults) for name, faults in SINGLE.items()}
    mixed = np.array([errors(faults) for faults in random_faults(count)])
    rows[f"{count} random vectors, median"] = np.median(mixed, axis=0)
    rows[f"{count} random vectors, 90th percentile"] = np.quantile(mixed, 0.9, axis=0)
    return rows


def gaps(count: int) -> np.ndarray:
    """Relative misfits (``count``,) of the monitor model to the reference model, same faults."""
    actuator = BldcActuator.load()
    found = []
    for faults in random_faults(count):
        comparison = BldcComparison(simulate("reference", faults=faults), actuator)
        cost = comparison.costs({name: np.array([x]) for name, x in faults.items()}, 1)[0]
        found.append(float(np.sqrt(cost / comparison.scale)))
    return np.array(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gap", type=int, metavar="N", help="gap of the models over N vectors")
    parser.add_argument("--faulty", type=int, metavar="N", help="errors with faults")
    given = parser.parse_args()
    if given.faulty is not None:
        print("| monitor model, error, % of RMS | 50 us | 25 us | 12.5 us |\n|---|--:|--:|--:|")
        for name, row in faulty(given.faulty).items():
            print(f"| {name} |", " | ".join(f"{100.0 * error:.3f}" for error in row), "|")
        return
    if given.gap is not None:
        found = 100.0 * np.quantile(gaps(given.gap), [0.1, 0.5, 0.75, 0.9, 1.0])
        print("gap, % of RMS: 10th percentile, median, 75th, 90th, worst")
        print(", ".join(f"{value:.2f}" for value in found))
        return
    rows = [row for model in STEPS for case in ("smooth", "default") for row in table(model, case)]
    print("| model | case | step, us | error, % of RMS | order |")
    print("|---|---|---|---|---|")
    for row in rows:
        order = "" if row.order is None else f"{row.order:.2f}"
        print(
            f"| {row.model} | {row.case} | {1e6 * row.step:g} | {100.0 * row.error:.3g} | {order} |"
        )


if __name__ == "__main__":
    main()
