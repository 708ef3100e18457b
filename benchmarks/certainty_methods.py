"""Whether intervals of the three methods hold the truth on the same recordings: docs/certainty.md.

    python benchmarks/certainty_methods.py calibrated --actuators 4 --faulty 3 --first 300
    python benchmarks/certainty_methods.py uncalibrated --actuators 4 --faulty 3 --first 300

Actuators, faults and recordings (reference model, 2 % noise, 12 bits) are those of
benchmarks/unknown_actuator.py. Prints a line for each recording, then how often each method held
the truth, how wide its intervals were beside Laplace's, and seconds of processor time, the search
included.
"""

import argparse
import time
from typing import Any

import numpy as np

import unknown_actuator as rig
from counted import MAGNITUDES, holds, table
from ematwin import identify
from ematwin.estimation.posterior import Posterior
from ematwin.estimation.profile import Profiles

METHODS = ("laplace", "profile", "posterior")


def main() -> None:
    """Compare on some actuators."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("mode", choices=("calibrated", "uncalibrated"))
    parser.add_argument("--actuators", type=int, default=4)
    parser.add_argument("--faulty", type=int, default=3, help="recordings of each actuator")
    parser.add_argument("--first", type=int, default=300, help="seed of the first actuator")
    parser.add_argument("--most", type=int, default=60_000, help="simulations of a posterior")
    given = parser.parse_args()
    rows: dict[str, list[Any]] = {name: [] for name in METHODS}
    for seed in range(given.first, given.first + given.actuators):
        true = rig.actuator_off(seed)
        known: Any = rig.SHEET
        if given.mode == "calibrated":
            healthy = [rig.recorded(true, {}, 10 + n, {}) for n in range(rig.HEALTHY_RECORDINGS)]
            known = rig.learnt(healthy, rig.SHEET)
        for n, faults in enumerate(rig.cases(given.faulty, seed)):
            record = rig.recorded(true, faults, 100 + n, {})
            injected = {name: 0.5 if name == "gain" else 0.0 for name in MAGNITUDES} | faults
            widths: dict[str, float] = {}
            for method in (*METHODS[:1], Profiles(), Posterior(most=given.most)):
                name = method if isinstance(method, str) else method.name
                started = time.process_time()
                sure = identify(record, known, uncertainty=method).uncertainty
                spent = time.process_time() - started
                ends = sure.intervals
                out = [
                    f"{one} {injected[one]:.3f} not in {ends[one][0]:.4f} to {ends[one][1]:.4f}"
                    for one in MAGNITUDES
                    if not holds(ends[one], injected[one])
                ]
                size = {one: ends[one][1] - ends[one][0] for one in MAGNITUDES}
                widths = widths or size
                beside = float(np.median([size[one] / widths[one] for one in MAGNITUDES]))
                finished = not any("not converged" in one for one in sure.doubts)
                rows[name].append((len(out), beside, spent, finished))
                print(
                    f"{seed} {n} {name} {spent:.0f} s {'' if finished else 'not converged '}"
                    f"width {beside:.2f} {'; '.join(out) or 'all held'}",
                    flush=True,
                )
    lines = []
    for name, found in rows.items():
        out, beside, spent, finished = (np.array(one) for one in zip(*found, strict=True))
        count = len(out) * len(MAGNITUDES)
        lines.append([
            name, f"{100.0 * (1.0 - out.sum() / count):.1f} of {count}", f"{np.median(beside):.2f}",
            f"{np.median(spent):.0f}", f"{100.0 * finished.mean():.0f}",
        ])  # fmt: skip
    columns = ("intervals that hold, %", "median width over Laplace's", "s", "converged, %")
    print(table(["", *columns], lines))


if __name__ == "__main__":
    main()
