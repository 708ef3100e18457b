"""The BBOB suite of COCO: shares of targets met, for the table of docs/optimizers.md.

    pip install coco-experiment
    python benchmarks/bbob.py [--dimensions 2,5,10] [--instances 5] [--data FOLDER] [NAME ...]

NAME is a method or a preset of ``ematwin algorithms``; paper and improved if none is given. All 24
functions, one run an instance, population 50, a budget of 1,000 evaluations a variable. As COCO
does, a target is a distance from the optimum: 51 of them, evenly spaced in their logarithm from 100
to 1e-8 (Hansen et al. 2021, Optim. Methods Softw. 36, 114-144). Cells are the share of all pairs of
run and target met within the budget, in per cent, with 95 % bootstrap intervals over the instances.
``--data`` has COCO's observer record each method, for ``python -m cocopp FOLDER``.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.estimation.search import expanded
from ematwin.optimizers import minimize

POPULATION, PER_VARIABLE = 50, 1000
TARGETS = np.geomspace(1e2, 1e-8, 51)
GROUPS = {
    "separable (f1-5)": range(1, 6),
    "moderate (f6-9)": range(6, 10),
    "ill-conditioned (f10-14)": range(10, 15),
    "multimodal (f15-19)": range(15, 20),
    "weak structure (f20-24)": range(20, 25),
    "all": range(1, 25),
}
_RESAMPLES = 999


def optimum(problem: Any) -> float:
    """The least value, by COCO's own least point, which it writes to the working folder."""
    where = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            problem._best_parameter("print")
            point = np.loadtxt("._bbob_problem_best_parameter.txt")
        finally:
            os.chdir(where)
    return float(problem(point))


def least_values(dimension: int, instances: int) -> dict[str, float]:
    """By the problem's id; on a suite of its own, so that no observed run has seen the optimum."""
    return {problem.id: optimum(problem) for problem in suite(dimension, instances)}


def suite(dimension: int, instances: int) -> Iterator[Any]:
    import cocoex

    where = f"dimensions:{dimension} instance_indices:1-{instances}"
    yield from cocoex.Suite("bbob", "", where)


def gap(problem: Any, name: str, least: float) -> float:
    """Distance from the optimum at the end of the budget."""

    def costs(points: np.ndarray) -> np.ndarray:
        return np.array([problem(point) for point in points])

    budget = PER_VARIABLE * problem.dimension
    found = minimize(
        costs, problem.lower_bounds, problem.upper_bounds, name, POPULATION,
        seed=problem.id_instance, budget=budget,
    )  # fmt: skip
    distance = found.cost - least
    assert distance > -1e-8, f"{problem.id}: {found.cost} lies below the optimum {least}"
    return distance


def gaps(name: str, dimension: int, instances: int, data: Path | None) -> np.ndarray:
    """(24, instances) array."""
    import cocoex

    least = least_values(dimension, instances)
    observer = None
    if data is not None:
        folder = data / f"{name}-{dimension}"
        observer = cocoex.Observer("bbob", f"result_folder: {folder} algorithm_name: {name}")
    found = np.full((24, instances), np.nan)
    for problem in suite(dimension, instances):
        if observer is not None:
            problem.observe_with(observer)
        found[problem.id_function - 1, problem.id_instance - 1] = gap(
            problem, name, least[problem.id]
        )
    return found


def shares(found: np.ndarray) -> dict[str, tuple[float, float, float]]:
    """Share of targets met by group of functions, with its interval, per cent."""
    met = 100.0 * (found[..., None] <= TARGETS).mean(axis=-1)
    rng = np.random.default_rng(1)
    answer = {}
    for group, numbers in GROUPS.items():
        rows = met[[number - 1 for number in numbers]]
        places = rng.integers(rows.shape[1], size=(_RESAMPLES, *rows.shape))
        drawn = np.take_along_axis(np.broadcast_to(rows, places.shape), places, axis=2)
        low, high = np.quantile(drawn.mean(axis=(1, 2)), [0.025, 0.975])
        answer[group] = float(rows.mean()), float(low), float(high)
    return answer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--dimensions", default="2,5,10")
    parser.add_argument("--instances", type=int, default=5)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_intermixed_args()
    names = expanded(options.names or ["paper", "improved"])
    answer: dict[str, Any] = {}
    for dimension in map(int, options.dimensions.split(",")):
        if not options.json:
            print(f"\n{dimension} variables\n\n| algorithm | {' | '.join(GROUPS)} |")
            print("|---|" + "--:|" * len(GROUPS))
        for name in names:
            found = gaps(name, dimension, options.instances, options.data)
            table = shares(found)
            answer[f"{name}, {dimension}"] = {"gaps": found.tolist(), "shares": table}
            if not options.json:
                cells = [
                    f"{middle:.0f} ({low:.0f} to {high:.0f})"
                    for middle, low, high in table.values()
                ]
                print(f"| `{name}` | {' | '.join(cells)} |", flush=True)
    if options.json:
        print(json.dumps(answer, indent=1))


if __name__ == "__main__":
    main()
