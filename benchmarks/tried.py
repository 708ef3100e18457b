"""A way to a faster search that was tried and left out, with what it costs in error.

    python benchmarks/tried.py

Jacobians by forward sensitivities are the limit of differences over vanishing steps, so the default
search is run with steps of 1e-7 of a range in place of its own.
"""

import argparse
import statistics

import numpy as np

from counted import table
from ematwin import Noise
from ematwin.estimation import levenberg_marquardt
from identification import one_run, random_faults

_SHORT = 1e-7  # share of a range: the tangent, but for rounding


def tangents(count: int, seed: int) -> str:
    """Err% of the default search with its own differences and with tangents."""
    noise = Noise.parse("white=0.02,bits=12")
    lines = []
    own = levenberg_marquardt.LONGEST_DIFFERENCE, levenberg_marquardt._SHORTEST_DIFFERENCE
    for title, (longest, shortest) in (
        (f"{own[1]:g} to {own[0]:g} of a range", own),
        (f"{_SHORT:g}: tangents", (_SHORT, _SHORT)),
    ):
        levenberg_marquardt.LONGEST_DIFFERENCE = longest
        levenberg_marquardt._SHORTEST_DIFFERENCE = shortest
        runs = [
            one_run(str(n), faults, "multistart", n + 1, noise)
            for n, faults in enumerate(random_faults(count, seed))
        ]
        errors = [run["err_wrapped"] for run in runs]
        spent = [run["evaluations"] for run in runs]
        lines.append([
            title, f"{statistics.median(errors):.2f}", f"{np.quantile(errors, 0.9):.2f}",
            f"{max(errors):.2f}", f"{statistics.fmean(spent):.0f}",
        ])  # fmt: skip
    return table(["differences", "median Err%", "P90", "worst", "simulations"], lines)


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=12, help="fault vectors")
    parser.add_argument("--seed", type=int, default=2026)
    chosen = parser.parse_args()
    print(tangents(chosen.count, chosen.seed))


if __name__ == "__main__":
    main()
