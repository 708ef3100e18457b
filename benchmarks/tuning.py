"""How the preset `improved` was tuned: one effort for each of the six, on no actuator.

    python benchmarks/tuning.py [--json] [--configurations 32] [--seeds 5] [ga pso de gwo da woa]

Each method has a space of settings. Its published form and 31 configurations drawn from the space
(seed 2026) run on eight functions in 8 dimensions with 5 seeds, 10,000 evaluations in batches of
50: 12.8 million evaluations a method. The configurations are ranked on each function by the median
of their final values; the one with the least mean rank is the tuned form. Shifts and rotations of
the functions are drawn here and stand in no study: neither fault cases nor functions of BBOB.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import ortho_group, rankdata

from ematwin.optimizers import (
    DifferentialEvolution,
    Dragonfly,
    GeneticAlgorithm,
    GreyWolf,
    ParticleSwarm,
    Whale,
    minimize,
)
from ematwin.optimizers.differential_evolution import (
    Dither,
    Either,
    best_1,
    others,
    rand_1,
)
from ematwin.optimizers.genetic_algorithm import (
    HOLLAND,
    Polynomial,
    Real,
    SimulatedBinary,
    Tournament,
)
from ematwin.optimizers.particle_swarm import (
    CONSTRICTION,
    INERTIA_1998,
    STANDARD_2006,
    Global,
    GrowingRing,
    Ring,
)
from optimizers import DIMENSION, ITERATIONS, POPULATION, Costs, ackley, rastrigin, rosenbrock

SEED = 2026
Settings = dict[str, Any]


def functions() -> dict[str, Costs]:
    """Eight functions of [0, 1]^8, each with its own place of the minimum, which is zero."""
    rng = np.random.default_rng(SEED)

    def shifted(formula: Costs, width: float, turned: bool) -> Costs:
        # some coordinates of the minimum on a bound, as healthy values of an actuator are
        centre = np.where(rng.random(DIMENSION) < 0.25, 0.0, rng.uniform(0.1, 0.9, DIMENSION))
        turn = ortho_group.rvs(DIMENSION, random_state=rng) if turned else np.eye(DIMENSION)
        return lambda points: formula(width * (points - centre) @ turn)

    def ellipsoid(z: np.ndarray) -> np.ndarray:
        return (z**2) @ 1e4 ** np.linspace(0.0, 1.0, DIMENSION)

    def griewank(z: np.ndarray) -> np.ndarray:
        waves = np.cos(z / np.sqrt(np.arange(1, DIMENSION + 1))).prod(axis=1)
        return (z**2).sum(axis=1) / 4000.0 - waves + 1.0

    def cliffs(z: np.ndarray) -> np.ndarray:
        return np.floor(np.abs(z)).sum(axis=1) + 0.1 * (z**2).sum(axis=1)

    return {
        "ellipsoid": shifted(ellipsoid, 10.0, False),
        "ellipsoid, turned": shifted(ellipsoid, 10.0, True),
        "rosenbrock": shifted(rosenbrock, 4.0, False),
        "rastrigin": shifted(rastrigin, 10.0, False),
        "rastrigin, turned": shifted(rastrigin, 10.0, True),
        "ackley, turned": shifted(ackley, 60.0, True),
        "griewank, turned": shifted(griewank, 200.0, True),
        "cliffs": shifted(cliffs, 10.0, False),
    }


def current_to_best_1(rng, parents, best, F):
    """DE/current-to-best/1: a step towards the best vector and one difference."""
    r1, r2 = others(rng, len(parents), 2)
    steps = (parents[best] - parents) + (parents[r1] - parents[r2])
    return parents + F * steps, parents


def best_2(rng, parents, best, F):
    """DE/best/2: two differences added to the best vector."""
    r1, r2, r3, r4 = others(rng, len(parents), 4)
    bases = np.broadcast_to(parents[best], parents.shape)
    steps = parents[r1] + parents[r2] - parents[r3] - parents[r4]
    return bases + F * steps, bases


def one_of(rng: np.random.Generator, *choices: Any) -> Any:
    return choices[rng.integers(len(choices))]


def ga(rng: np.random.Generator) -> Settings:
    crossover = SimulatedBinary(
        eta=round(rng.uniform(1.0, 20.0), 1),
        probability=round(rng.uniform(0.6, 1.0), 2),
        whole=round(rng.uniform(0.0, 1.0), 2),
    )
    return {
        "encoding": Real(crossover, Polynomial(eta=round(rng.uniform(5.0, 60.0), 1))),
        "selection": Tournament(one_of(rng, 2, 3, 4, 6, 8)),
    }


def pso(rng: np.random.Generator) -> Settings:
    share = one_of(rng, 0.0, 0.05, 0.1, 0.2)
    return {
        "topology": one_of(
            rng, Global(), Ring(1), Ring(3), GrowingRing(1.0), GrowingRing(2.0), GrowingRing(3.0)
        ),
        "coefficients": one_of(rng, INERTIA_1998, CONSTRICTION, STANDARD_2006),
        "crazy": share,
    }


def de(rng: np.random.Generator) -> Settings:
    return {
        "strategy": one_of(rng, rand_1, best_1, current_to_best_1, best_2),
        "F": one_of(rng, round(rng.uniform(0.3, 0.9), 2), Dither()),
        "CR": one_of(
            rng, round(rng.uniform(0.1, 1.0), 2), Either(share=round(rng.uniform(0.1, 0.9), 2))
        ),
    }


def gwo(rng: np.random.Generator) -> Settings:
    return {
        "start": round(rng.uniform(0.5, 3.0), 2),
        "power": round(float(np.exp(rng.uniform(*np.log([0.25, 4.0])))), 2),
    }


def woa(rng: np.random.Generator) -> Settings:
    return {**gwo(rng), "spiral": round(float(np.exp(rng.uniform(*np.log([0.1, 3.0])))), 2)}


def da(rng: np.random.Generator) -> Settings:
    first = round(rng.uniform(0.4, 1.0), 2)
    return {
        "inertia": (first, round(rng.uniform(0.0, first), 2)),
        "fading": round(rng.uniform(0.1, 1.0), 2),
        "step_limit": round(float(np.exp(rng.uniform(*np.log([0.02, 0.4])))), 3),
    }


SPACES: dict[str, tuple[Any, Settings, Callable[[np.random.Generator], Settings]]] = {
    "ga": (GeneticAlgorithm, HOLLAND, ga),
    "pso": (
        ParticleSwarm,
        {"topology": Global(), "coefficients": INERTIA_1998, "crazy": 0.0},
        pso,
    ),
    "de": (DifferentialEvolution, {"strategy": rand_1, "F": 0.5, "CR": 0.9}, de),
    "gwo": (GreyWolf, {}, gwo),
    "da": (Dragonfly, {}, da),
    "woa": (Whale, {}, woa),
}


def tuned(name: str, configurations: int, seeds: int) -> dict[str, Any]:
    """The configurations of a method, best first, with their ranks and final values."""
    method, published, space = SPACES[name]
    rng = np.random.default_rng(SEED)
    candidates = [published, *(space(rng) for _ in range(configurations - 1))]
    cases = functions()
    finals = np.array([
        [
            np.median([
                minimize(
                    costs, [0.0] * DIMENSION, [1.0] * DIMENSION, partial(method, **settings),
                    POPULATION, ITERATIONS, seed,
                ).cost
                for seed in range(1, seeds + 1)
            ])
            for costs in cases.values()
        ]
        for settings in candidates
    ])  # fmt: skip
    ranks = rankdata(finals, axis=0).mean(axis=1)
    order = np.argsort(ranks, kind="stable")
    return {
        "published rank": float(ranks[0]),
        "functions": list(cases),
        "configurations": [
            {
                "settings": str(candidates[n]),
                "mean rank": float(ranks[n]),
                "published": bool(n == 0),
                "finals": finals[n].tolist(),
            }
            for n in order
        ],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--configurations", type=int, default=32)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_intermixed_args()
    found = {}
    for name in options.names or SPACES:
        found[name] = tuned(name, options.configurations, options.seeds)
        if not options.json:
            best = found[name]["configurations"][0]
            print(
                f"{name}: mean rank {best['mean rank']:.1f} of {options.configurations} "
                f"(published {found[name]['published rank']:.1f}): {best['settings']}",
                flush=True,
            )
    if options.json:
        print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
