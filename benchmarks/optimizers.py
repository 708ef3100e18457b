"""Final values of the optimisers on test functions: tables for docs/optimizers.md.

python benchmarks/optimizers.py four [--seeds 15] [--json] [NAME ...]
python benchmarks/optimizers.py bbob [--seeds 15] [--json] [NAME ...]
python benchmarks/optimizers.py origin [--seeds 31] [--json] [NAME ...]

four    sphere, Rosenbrock, Rastrigin and Ackley in [0, 1]^8, optimum inside
bbob    functions of the BBOB suite in 8 dimensions, as the package ioh has them (pip install ioh)
origin  a sphere centred in the corner at zero, and the same sphere centred inside

Every algorithm has the same budget, 10,000 evaluations in batches of 50, and the same seeds.
Cells are median (lower to upper quartile) of the final cost, above the optimum's.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable

import numpy as np

from ematwin.optimizers import minimize

POPULATION, ITERATIONS, DIMENSION = 50, 200, 8
OPTIMUM = np.array([0.3, 0.62, 0.41, 0.77, 0.55, 0.23, 0.68, 0.36])
DEFAULT = (
    "ga", "ga-binary", "pso", "pso-global", "pso-ring", "pso-plain", "de", "de-rand", "gwo", "da",
    "woa", "random", "cma", "scipy-de", "pymoo-ga", "pymoo-pso", "pymoo-de",
    "pygmo-sga", "pygmo-pso", "pygmo-de",
)  # fmt: skip
BBOB = (1, 3, 8, 10, 13, 15, 17, 20, 21, 24)

Costs = Callable[[np.ndarray], np.ndarray]
Problem = tuple[Costs, float, float]


def sphere(z: np.ndarray) -> np.ndarray:
    return (z**2).sum(axis=1)


def rosenbrock(z: np.ndarray) -> np.ndarray:
    y = 1.0 + z
    return (100.0 * (y[:, 1:] - y[:, :-1] ** 2) ** 2 + (1.0 - y[:, :-1]) ** 2).sum(axis=1)


def rastrigin(z: np.ndarray) -> np.ndarray:
    return (z**2 - 10.0 * np.cos(2.0 * np.pi * z) + 10.0).sum(axis=1)


def ackley(z: np.ndarray) -> np.ndarray:
    hollow = -20.0 * np.exp(-0.2 * np.sqrt((z**2).mean(axis=1)))
    return hollow - np.exp(np.cos(2.0 * np.pi * z).mean(axis=1)) + 20.0 + np.e


def shifted(formula: Costs, width: float, centre: np.ndarray = OPTIMUM) -> Problem:
    """A function of z in [0, 1]^8, z = width (x - centre), with its minimum at the centre."""
    return lambda points: formula(width * (points - centre)), 0.0, 1.0


FOUR = {sphere: 10.24, rosenbrock: 4.096, rastrigin: 10.24, ackley: 65.536}  # widths


def bbob(number: int) -> Problem:
    import ioh

    problem = ioh.get_problem(number, 1, DIMENSION, ioh.ProblemClass.BBOB)
    least = problem.optimum.y

    def costs(points: np.ndarray) -> np.ndarray:
        return np.array([problem(point) for point in points.tolist()]) - least

    return costs, -5.0, 5.0


def problems(suite: str) -> dict[str, Problem]:
    if suite == "bbob":
        return {f"f{number}": bbob(number) for number in BBOB}
    if suite == "origin":
        corner = shifted(sphere, 10.24, np.zeros(DIMENSION))
        return {"centred in the corner": corner, "centred inside": shifted(sphere, 10.24)}
    return {formula.__name__: shifted(formula, width) for formula, width in FOUR.items()}


def finals(name: str, problem: Problem, seeds: int) -> list[float]:
    costs, lower, upper = problem
    bounds = np.full(DIMENSION, lower), np.full(DIMENSION, upper)
    return [
        minimize(costs, *bounds, name, POPULATION, ITERATIONS, seed).cost
        for seed in range(1, seeds + 1)
    ]


def cell(values: list[float]) -> str:
    low, middle, high = np.percentile(values, [25, 50, 75])
    return f"{middle:.2g} ({low:.1g} to {high:.1g})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("suite", choices=["four", "bbob", "origin"])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seeds", type=int, default=15)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_intermixed_args()
    cases = problems(options.suite)
    if not options.json:
        print("| algorithm | " + " | ".join(cases) + " |\n|---|" + "---|" * len(cases))
    found: dict[str, dict[str, list[float]]] = {}
    for name in options.names or DEFAULT:
        found[name] = {case: finals(name, cases[case], options.seeds) for case in cases}
        if not options.json:
            cells = " | ".join(cell(values) for values in found[name].values())
            print(f"| `{name}` | {cells} |", flush=True)
    if options.json:
        print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
