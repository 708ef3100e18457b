"""Two ways to a faster search that were tried and left out, with what they cost in error.

    python benchmarks/tried.py tangents
    python benchmarks/tried.py single

``tangents``: Jacobians by forward sensitivities are the limit of differences over vanishing steps,
so the default search is run with steps of 1e-7 of a range in place of its own. What sensitivities
would save in time cannot make up for what is seen here.

``single``: the monitor model step by step in single precision, beside double; plain numpy, which
shares no code with the lanes.
"""

import argparse
import statistics
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.identification import one_run, random_faults
from benchmarks.peers.numpy_batch import currents
from benchmarks.peers.task import Task

from ematwin import Noise
from ematwin.estimation import levenberg_marquardt
from ematwin.numerics.low_pass import LowPass

_SHORT = 1e-7  # share of a range: the tangent, but for rounding


def tangents(count: int, seed: int) -> str:
    """Err% of the default search with its own differences and with tangents."""
    noise = Noise.parse("white=0.02,bits=12")
    lines = [
        "| differences | median Err% | P90 | worst | simulations |",
        "|---|--:|--:|--:|--:|",
    ]
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
        errors = [float(run["err_wrapped"]) for run in runs]  # type: ignore[arg-type]
        spent = [float(run["evaluations"]) for run in runs]  # type: ignore[arg-type]
        lines.append(
            f"| {title} | {statistics.median(errors):.2f} | {np.quantile(errors, 0.9):.2f} | "
            f"{max(errors):.2f} | {statistics.fmean(spent):.0f} |"
        )
    return "\n".join(lines)


def single(count: int, seed: int) -> str:
    """How far the filtered current in single precision is from that in double."""
    task = Task.make()
    k = np.stack([faults.vector for faults in random_faults(count, seed)])

    def filtered(vectors: np.ndarray, precision: type) -> np.ndarray:
        rate = 1.0 / (task.step * task.substeps)
        return np.stack([LowPass().apply(row, rate) for row in currents(task, vectors, precision)])

    double, half = filtered(k, np.float64), filtered(k, np.float32)
    weights = task.weights[1:]
    size = np.sqrt((weights * double**2).sum(axis=1))
    apart = 100.0 * np.sqrt((weights * (half - double) ** 2).sum(axis=1)) / size
    # what the shortest difference of a Jacobian changes, and how much of it is rounding
    beside = k.copy()
    step = levenberg_marquardt._SHORTEST_DIFFERENCE
    beside[:, 7] += np.where(beside[:, 7] < 0.5, step, -step)
    change, rounded = filtered(beside, np.float64) - double, filtered(beside, np.float32) - half
    lost = np.sqrt(
        (weights * (rounded - change) ** 2).sum(axis=1) / (weights * change**2).sum(axis=1)
    )
    return "\n".join([
        "| of single precision | median | worst |",
        "|---|--:|--:|",
        f"| current apart from double, % of the current | {np.median(apart):.3f} | "
        f"{apart.max():.3f} |",
        f"| error of a column of the Jacobian (gain, step {step:g}), % of it | "
        f"{100.0 * np.median(lost):.0f} | {100.0 * lost.max():.0f} |",
    ])  # fmt: skip


def main() -> int:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("tangents", "single"))
    parser.add_argument("--count", type=int, default=12, help="fault vectors")
    parser.add_argument("--seed", type=int, default=2026)
    chosen = parser.parse_args()
    print({"tangents": tangents, "single": single}[chosen.what](chosen.count, chosen.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
