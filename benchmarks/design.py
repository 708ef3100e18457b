"""Whether a designed command keeps its promise: docs/lab/design.md.

    python benchmarks/design.py --recordings 12

The command for the weakest fault of an actuator that is known by its data sheet, within the travel
and the current of the default command and in its 0.5 s. Speed and load may be what the rig allows
(``--speed``, ``--load``). Both commands are recorded from simulated actuators with other faults,
parameters and noise than those by which it was chosen, by the reference model at half its step, and
identified. Printed are the errors promised and observed.
"""

import argparse
import time

import numpy as np

import ematwin
from counted import NOISE
from ematwin.experiments.command_errors import expected_errors, fault_vectors, identified_errors
from ematwin.experiments.experiment import excess


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=12)
    parser.add_argument("--budget", type=int)
    parser.add_argument("--fault")
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--check-seed", type=int, default=101)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", default="designed.toml")
    parser.add_argument("--speed", type=float, default=10.0, help="rad/s")
    parser.add_argument("--load", type=float, default=40.0, help="N*m")
    given = parser.parse_args()
    started = time.process_time()
    found = ematwin.design(
        "servo48", fault=given.fault, exact=given.exact, noise=NOISE, seed=given.seed,
        budget=given.budget, threads=given.threads, speed=given.speed,
        load=given.load,
    )  # fmt: skip
    command, experiment = found.scenario, found.experiment
    spent = time.process_time() - started
    found.save(given.out)
    print(f"{found.evaluations} commands, {found.seconds:.0f} s, {spent:.0f} s of processor")
    print(found.sentence, flush=True)
    vectors = fault_vectors(
        experiment, found.draws, np.random.default_rng(given.seed + 1), {}, even=True
    )
    demands = experiment.demanded(command, fast=False)
    promised = expected_errors(experiment, command, vectors, demands)
    print("demands", demands, "beyond the limits by", excess(demands, found.limits))
    told = np.array([list(found.default.errors.values()), list(promised.errors.values())])
    print("promised", told.round(5).tolist(), flush=True)
    step = 0.5 * found.actuator.value("steps.reference")
    errors = identified_errors(
        experiment, [found.default.scenario, command], given.recordings, seed=given.check_seed,
        step=step,
    )  # fmt: skip
    seen = np.sqrt((errors**2).mean(axis=0))
    middle = np.median(np.abs(errors), axis=0)
    print("| fault | default | designed | times | default, observed | designed, observed | times |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for n, one in enumerate(experiment.magnitudes):
        cells = [f"{x[0, n]:.2g} | {x[1, n]:.2g} | {x[0, n] / x[1, n]:.2f}" for x in (told, seen)]
        print(f"| {one.name} | {' | '.join(cells)} |")
    widths = np.array([one.width for one in experiment.magnitudes])
    for what, x in (("promised", told), ("observed", seen), ("median observed", middle)):
        largest = (x / widths).max(axis=1)
        print(f"largest, {what}: {largest[0]:.2g}, {largest[1]:.2g}: {largest[0] / largest[1]:.2f}")


if __name__ == "__main__":
    main()
