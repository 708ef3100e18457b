"""Optimisers: six metaheuristics and a baseline, adapters to other libraries, one search loop.

They know no actuator: any function of a box-bounded batch can be minimised.
"""

from ematwin.optimizers.base import Algorithm, Box, Optimizer, OptimizerFactory, RandomSearch
from ematwin.optimizers.differential_evolution import DifferentialEvolution
from ematwin.optimizers.dragonfly import Dragonfly
from ematwin.optimizers.genetic_algorithm import GeneticAlgorithm
from ematwin.optimizers.grey_wolf import GreyWolf
from ematwin.optimizers.loop import minimize
from ematwin.optimizers.objective import LimitedObjective
from ematwin.optimizers.particle_swarm import ParticleSwarm
from ematwin.optimizers.registry import algorithms
from ematwin.optimizers.result import History, MinimizeResult, Progress, Stop
from ematwin.optimizers.whale import Whale

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
    "Stop",
    "Whale",
    "algorithms",
    "minimize",
]
