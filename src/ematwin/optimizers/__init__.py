"""Optimisers: six metaheuristics and a baseline, adapters to other libraries, one search loop.

They know no actuator: any function of a box-bounded batch can be minimised.
"""

from ematwin.optimizers.base import Algorithm as Algorithm
from ematwin.optimizers.base import Box as Box
from ematwin.optimizers.base import Optimizer as Optimizer
from ematwin.optimizers.base import OptimizerFactory as OptimizerFactory
from ematwin.optimizers.base import RandomSearch as RandomSearch
from ematwin.optimizers.differential_evolution import DifferentialEvolution as DifferentialEvolution
from ematwin.optimizers.dragonfly import Dragonfly as Dragonfly
from ematwin.optimizers.genetic_algorithm import GeneticAlgorithm as GeneticAlgorithm
from ematwin.optimizers.grey_wolf import GreyWolf as GreyWolf
from ematwin.optimizers.loop import LimitedObjective as LimitedObjective
from ematwin.optimizers.loop import minimize as minimize
from ematwin.optimizers.particle_swarm import ParticleSwarm as ParticleSwarm
from ematwin.optimizers.registry import algorithms as algorithms
from ematwin.optimizers.result import History as History
from ematwin.optimizers.result import MinimizeResult as MinimizeResult
from ematwin.optimizers.result import Progress as Progress
from ematwin.optimizers.whale import Whale as Whale
