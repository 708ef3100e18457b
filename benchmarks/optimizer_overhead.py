"""The optimisers' own time: ask and tell at 50 x 8, in microseconds an evaluation.

python benchmarks/optimizer_overhead.py [--repeats 5] [NAME ...]

Processor time; the objective's is left out. Each figure is the least of the repeats: what else ran
on the machine only adds to it.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from ematwin.optimizers import Box, algorithms
from ematwin.optimizers.registry import find

POPULATION, ITERATIONS, DIMENSION = 50, 200, 8
OPTIMUM = np.array([0.3, 0.62, 0.41, 0.77, 0.55, 0.23, 0.68, 0.36])


def microseconds(name: str, seed: int) -> float:
    box = Box(np.zeros(DIMENSION), np.ones(DIMENSION))
    make = find(name).factory()
    optimizer = make(box, population=POPULATION, iterations=ITERATIONS, seed=seed)
    spent, evaluations = 0.0, 0
    try:
        while evaluations < POPULATION * ITERATIONS:
            started = time.process_time()
            points = optimizer.ask()
            spent += time.process_time() - started
            costs = ((points - OPTIMUM) ** 2).sum(axis=1)
            started = time.process_time()
            optimizer.tell(points, costs)
            spent += time.process_time() - started
            evaluations += len(points)
    finally:
        optimizer.close()
    return 1e6 * spent / evaluations


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_intermixed_args()
    names = options.names or [found.name for found in algorithms() if found.installed]
    print("| algorithm | own time, us an evaluation |\n|---|---|")
    for name in names:
        figure = min(microseconds(name, seed) for seed in range(1, options.repeats + 1))
        print(f"| `{name}` | {figure:.2f} |", flush=True)


if __name__ == "__main__":
    main()
