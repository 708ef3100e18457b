"""Whether a designed command keeps its promise: docs/design.md.

    python benchmarks/design.py --recordings 40

The command for the weakest fault of an actuator that is known by its data sheet, within the travel,
speed, current and load of the default command and in its 0.5 s. Both commands are then recorded
from simulated actuators with other faults, parameters and noise than those of the search, by the
reference model at half its step, and identified. Printed are the errors promised and observed.
"""

import argparse
import time

import ematwin
from ematwin.estimation.design import BUDGET
from ematwin.recordings.noise import Noise

NOISE = Noise(white=0.02, bits=12)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=40)
    parser.add_argument("--budget", type=int, default=BUDGET)
    parser.add_argument("--fault", default=None)
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--check-seed", type=int, default=101)
    parser.add_argument("--out", default="designed.toml")
    given = parser.parse_args()
    started = time.process_time()
    found = ematwin.design(
        "servo48", fault=given.fault, exact=given.exact, noise=NOISE, budget=given.budget,
        seed=given.seed,
    )  # fmt: skip
    spent = time.process_time() - started
    found.save(given.out)
    print(
        f"{found.sentence} {found.evaluations} commands, {found.seconds:.0f} s, {spent:.0f} s CPU"
    )
    step = 0.5 * found.actuator.value("steps.reference")
    found = found.check(given.recordings, seed=given.check_seed, step=step)
    print("| fault | default | designed | times | default, observed | designed, observed | times |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for name in found.promised.errors:
        told = [found.default.errors[name], found.promised.errors[name]]
        seen = [found.default.observed[name], found.promised.observed[name]]
        cells = [f"{told[0]:.2g} | {told[1]:.2g} | {told[0] / told[1]:.2f}"]
        cells.append(f"{seen[0]:.2g} | {seen[1]:.2g} | {seen[0] / seen[1]:.2f}")
        print(f"| {name} | {' | '.join(cells)} |")
    print(f"largest: promised {found.gain:.2f}, observed {found.observed_gain:.2f} times")
    print("limits", found.limits, "\ndemands", found.promised.demands)


if __name__ == "__main__":
    main()
