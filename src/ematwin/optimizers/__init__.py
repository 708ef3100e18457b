"""Optimisers: six metaheuristics and a baseline, adapters to other libraries, one search loop.

They know no actuator: any function of a box-bounded batch can be minimised. Names are loaded when
they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ematwin.optimizers.base import Box, Optimizer, OptimizerFactory
    from ematwin.optimizers.catalogue import Algorithm
    from ematwin.optimizers.differential_evolution import DifferentialEvolution
    from ematwin.optimizers.dragonfly import Dragonfly
    from ematwin.optimizers.genetic_algorithm import GeneticAlgorithm
    from ematwin.optimizers.grey_wolf import GreyWolf
    from ematwin.optimizers.loop import History, LimitedObjective, MinimizeResult, minimize
    from ematwin.optimizers.particle_swarm import ParticleSwarm
    from ematwin.optimizers.random_search import RandomSearch
    from ematwin.optimizers.registry import algorithms, create
    from ematwin.optimizers.stopping import Progress, Stagnation, Stop, Target
    from ematwin.optimizers.whale import Whale

_HOMES = {
    "Algorithm": "ematwin.optimizers.catalogue",
    "Box": "ematwin.optimizers.base",
    "DifferentialEvolution": "ematwin.optimizers.differential_evolution",
    "Dragonfly": "ematwin.optimizers.dragonfly",
    "GeneticAlgorithm": "ematwin.optimizers.genetic_algorithm",
    "GreyWolf": "ematwin.optimizers.grey_wolf",
    "History": "ematwin.optimizers.loop",
    "LimitedObjective": "ematwin.optimizers.loop",
    "MinimizeResult": "ematwin.optimizers.loop",
    "Optimizer": "ematwin.optimizers.base",
    "OptimizerFactory": "ematwin.optimizers.base",
    "ParticleSwarm": "ematwin.optimizers.particle_swarm",
    "Progress": "ematwin.optimizers.stopping",
    "RandomSearch": "ematwin.optimizers.random_search",
    "Stagnation": "ematwin.optimizers.stopping",
    "Stop": "ematwin.optimizers.stopping",
    "Target": "ematwin.optimizers.stopping",
    "Whale": "ematwin.optimizers.whale",
    "algorithms": "ematwin.optimizers.registry",
    "create": "ematwin.optimizers.registry",
    "minimize": "ematwin.optimizers.loop",
}

__all__ = [
    "Algorithm",
    "Box",
    "DifferentialEvolution",
    "Dragonfly",
    "GeneticAlgorithm",
    "GreyWolf",
    "History",
    "LimitedObjective",
    "MinimizeResult",
    "Optimizer",
    "OptimizerFactory",
    "ParticleSwarm",
    "Progress",
    "RandomSearch",
    "Stagnation",
    "Stop",
    "Target",
    "Whale",
    "algorithms",
    "create",
    "minimize",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'ematwin.optimizers' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
