"""Optimisers of other libraries behind the same ask and tell, and their names.

Nothing here imports such a library before one of its algorithms is made.
"""

from functools import partial
from typing import Any

from ematwin.optimizers.adapters.cma_es import CmaEs
from ematwin.optimizers.adapters.nevergrad import Nevergrad
from ematwin.optimizers.adapters.pygmo import Pygmo
from ematwin.optimizers.adapters.pymoo import MODULE, Pymoo
from ematwin.optimizers.adapters.worker import ScipyDifferentialEvolution
from ematwin.optimizers.base import Algorithm, OptimizerFactory


def _of(
    library: str, name: str, title: str, source: str, departures: str, factory: OptimizerFactory,
    *aliases: str,
) -> Algorithm:  # fmt: skip
    """An algorithm of a library, with the library's settings."""
    return Algorithm(
        name, title, source, library, lambda: factory, library, aliases, departures,
        "nothing here: the library's own settings",
    )  # fmt: skip


def _pymoo(name: str, title: str) -> Algorithm:
    return _of(
        "pymoo", f"pymoo-{name.lower()}", f"{title} of pymoo", f"{MODULE}.{name.lower()}.{name}",
        "restarts where it has no new point left", partial(Pymoo, name=name),
    )  # fmt: skip


def _pygmo(name: str, title: str, batched: bool = False, **options: float) -> Algorithm:
    alone = "; asks for one point at a time, so that its seconds say little of the method"
    return _of(
        "pygmo", f"pygmo-{name.replace('_', '-')}", f"{title} of pygmo", f"pygmo.{name}",
        f"goes on, or restarts, where it ends{'' if batched else alone}",
        partial(Pygmo, name=name, batched=batched, options=options),
    )  # fmt: skip


def _nevergrad(name: str, registered: str, title: str) -> Algorithm:
    return _of(
        "nevergrad", f"nevergrad-{name}", f"{title} of nevergrad",
        f"nevergrad.optimizers.registry[{registered!r}]", "none",
        partial(Nevergrad, name=registered),
    )  # fmt: skip


_ENDLESS: Any = {"ftol": 0.0, "xtol": 0.0}

ALGORITHMS = (
    _of(
        "cma", "cma", "CMA-ES of the package cma",
        "Hansen and Ostermeier (2001), Evol. Comput. 9(2), 159-195; pycma",
        "first mean and step as this package draws them; restarts", CmaEs, "cma-es", "cmaes",
    ),
    _of(
        "scipy", "scipy-de", "Differential evolution of SciPy",
        "scipy.optimize.differential_evolution", "no convergence test, no polishing; restarts",
        ScipyDifferentialEvolution,
    ),
    _pymoo("GA", "Genetic algorithm"),
    _pymoo("DE", "Differential evolution"),
    _pymoo("PSO", "Particle swarm"),
    _pygmo("sga", "Genetic algorithm"),
    _pygmo("de", "Differential evolution", **_ENDLESS),
    _pygmo("sade", "Self-adaptive differential evolution", **_ENDLESS),
    _pygmo("de1220", "Differential evolution, adaptive variant", **_ENDLESS),
    _pygmo("pso", "Particle swarm"),
    _pygmo("pso_gen", "Generational particle swarm", batched=True),
    _pygmo("gwo", "Grey wolf"),
    _nevergrad("de", "TwoPointsDE", "Differential evolution"),
    _nevergrad("pso", "PSO", "Particle swarm"),
    _nevergrad("oneplusone", "OnePlusOne", "(1+1) evolution strategy"),
)  # fmt: skip
