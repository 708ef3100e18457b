"""What it gains to stop candidates whose cost no longer matters, method by method.

    python benchmarks/early_stopping.py [--repeats 3] [METHOD ...]

Each search is run with limits and without, turn by turn, in seconds of one core; both must end the
same bit for bit.
"""

import argparse
import time

import numpy as np

import ematwin
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Population
from ematwin.optimizers.base import FloatArray

METHODS = ("gwo", "pso", "woa", "de", "random")


class WithoutLimits(Problem):
    """A problem that gives all costs, whatever their limits."""

    def costs(self, points: FloatArray, limits: FloatArray | None = None) -> FloatArray:
        return super().costs(points)


def timed(problem: Problem, method: str) -> tuple[float, Found]:
    """Seconds of one core that a search took, and what it found."""
    start = time.process_time()
    found = Population(method).run(problem, budget=None, seed=1, report=lambda *now: None)
    return time.process_time() - start, found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("methods", nargs="*", metavar="METHOD")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    record = ematwin.simulate("reference", faults={"friction": 0.25})
    problems = [kind.of(record, "servo48", threads=1) for kind in (WithoutLimits, Problem)]
    for problem in problems:
        problem.costs(problem.healthy[None])
    print("| method | without limits, s | with limits, s | gain |\n|---|--:|--:|--:|")
    for method in options.methods or METHODS:
        runs = [[timed(problem, method) for problem in problems] for _ in range(options.repeats)]
        for (_, plain), (_, limited) in runs:
            assert (plain.point == limited.point).all()
            assert (plain.history == limited.history).all()
        without, limited = (
            float(np.median([pair[n][0] for pair in runs])) for n in range(len(problems))
        )
        print(f"| {method} | {without:.2f} | {limited:.2f} | {without / limited:.2f} |", flush=True)


if __name__ == "__main__":
    main()
