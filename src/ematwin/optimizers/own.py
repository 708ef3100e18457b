"""The forms of this package's own methods that can be named, with their sources and departures.

Forms as first published, or as the author's program has them; this package's own improved forms;
and tuned forms, whose settings were chosen with one effort for all six methods, on functions that
stand in no study (``benchmarks/tuning.py``, docs/optimizers.md).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from ematwin.optimizers import differential_evolution as de
from ematwin.optimizers import genetic_algorithm as ga
from ematwin.optimizers import particle_swarm as pso
from ematwin.optimizers.base import Algorithm, RandomSearch
from ematwin.optimizers.dragonfly import Dragonfly
from ematwin.optimizers.grey_wolf import GreyWolf
from ematwin.optimizers.whale import Whale

_DEB = "Deb and Agrawal (1995), Complex Syst. 9, 115-148"
_CLERC = "Clerc (2006), Particle Swarm Optimization, ISTE"
_STORN = "Storn and Price (1997), J. Global Optim. 11, 341-359"
_WOLF = "Mirjalili, Mirjalili and Lewis (2014), Adv. Eng. Softw. 69, 46-61"
_DRAGONFLY = "Mirjalili (2016), Neural Comput. Appl. 27, 1053-1073"
_WHALE = "Mirjalili and Lewis (2016), Adv. Eng. Softw. 95, 51-67"

_BOUND = "stops at a bound, where the source has none"
_BOUNCE = "bounces back from a bound, where the source has none"
_REAL = "real numbers for bits, tournaments, best of parents and children survive (after Holland)"
_CRAZY = "10 % of the particles are crazy"
_PUBLISHED = "nothing: settings as published"
_FOUR = "the four functions of docs/optimizers.md"
_TUNED = "eight functions, 32 settings (benchmarks/tuning.py)"


def _own(
    name: str, title: str, source: str, departures: str, tuned_on: str,
    factory: Callable[..., Any], *aliases: str, **settings: Any,
) -> Algorithm:  # fmt: skip
    made: Any = partial(factory, **settings) if settings else factory
    return Algorithm(
        name, title, source, "ematwin", lambda: made, None, aliases, departures, tuned_on
    )


ALGORITHMS = (
    _own(
        "ga", "Genetic algorithm, real encoding", _DEB, _REAL, _FOUR, ga.GeneticAlgorithm,
        "genetic", "genetic-algorithm", "ga-real",
    ),
    _own(
        "ga-holland", "Genetic algorithm, bits, roulette, one-point crossover",
        "Holland (1973), SIAM J. Comput. 2(2), 88-105; rates of De Jong (1975)",
        "fitness is the distance from the worst cost (Goldberg 1989); 16 bits a variable",
        _PUBLISHED, ga.GeneticAlgorithm, **ga.HOLLAND,
    ),
    _own(
        "ga-binary", "Genetic algorithm, Gray code, tournaments",
        "Holland (1973), SIAM J. Comput. 2(2), 88-105",
        "Gray code, tournaments of 4, best of parents and children survive", _FOUR,
        ga.GeneticAlgorithm, encoding=ga.Binary(),
    ),
    _own(
        "ga-tuned", "Genetic algorithm, tuned", _DEB, _REAL, _TUNED, ga.GeneticAlgorithm,
        encoding=ga.Real(
            ga.SimulatedBinary(eta=12.4, probability=0.93, whole=0.13), ga.Polynomial(eta=38.9)
        ),
        selection=ga.Tournament(2),
    ),
    _own(
        "pso", "Particle swarm, growing ring", _CLERC,
        f"a ring that grows (after Suganthan 1999); {_CRAZY}",
        "coefficients: the four functions of docs/optimizers.md; ring and craziness: these and "
        "cases of Table 1 of ESREL 2020, with other seeds",
        pso.ParticleSwarm, "particle-swarm",
    ),
    _own(
        "pso-inertia", "Particle swarm, whole swarm informed, falling inertia",
        "Kennedy and Eberhart (1995), Proc. IEEE ICNN 4, 1942-1948; inertia of Shi and Eberhart "
        "(1998, 1999)",
        _BOUND, _PUBLISHED, pso.ParticleSwarm,
        topology=pso.Global(), coefficients=pso.INERTIA_1998, crazy=0.0,
    ),
    _own(
        "pso-1995", "Particle swarm, whole swarm informed, no inertia weight",
        "Kennedy and Eberhart (1995), Proc. IEEE ICNN 4, 1942-1948",
        f"{_BOUND}; speed limit of half the box", _PUBLISHED, pso.ParticleSwarm,
        topology=pso.Global(), coefficients=pso.ORIGINAL_1995, crazy=0.0,
    ),
    _own(
        "pso-global", "Particle swarm, whole swarm informed, crazy particles", _CLERC,
        f"whole swarm informed; {_CRAZY}", _FOUR, pso.ParticleSwarm, topology=pso.Global(),
    ),
    _own(
        "pso-ring", "Particle swarm, ring topology", _CLERC,
        f"ring of one neighbour on either side; {_CRAZY}", _FOUR, pso.ParticleSwarm,
        topology=pso.Ring(),
    ),
    _own(
        "pso-plain", "Particle swarm, whole swarm informed, constriction",
        "Clerc and Kennedy (2002), IEEE Trans. Evol. Comput. 6, 58-73", _BOUND, _PUBLISHED,
        pso.ParticleSwarm, topology=pso.Global(), coefficients=pso.CONSTRICTION, crazy=0.0,
    ),
    _own(
        "pso-tuned", "Particle swarm, tuned", _CLERC,
        "neighbourhood and crazy particles as tuned", _TUNED, pso.ParticleSwarm,
        topology=pso.GrowingRing(3.0), coefficients=pso.STANDARD_2006, crazy=0.1,
    ),
    _own(
        "de", "Differential evolution, best/1/bin, mixed CR", _STORN,
        f"CR is drawn between the two of the source for each trial; {_BOUNCE}", _FOUR,
        de.DifferentialEvolution, "differential-evolution",
    ),
    _own(
        "de-rand", "Differential evolution, rand/1/bin, F 0.5, CR 0.9", _STORN, _BOUNCE,
        _PUBLISHED, de.DifferentialEvolution, strategy=de.rand_1, CR=0.9,
    ),
    _own(
        "de-best", "Differential evolution, best/1/bin, F 0.8, CR 0.9", _STORN, _BOUNCE,
        _PUBLISHED, de.DifferentialEvolution, strategy=de.best_1, F=0.8, CR=0.9,
    ),
    _own(
        "de-tuned", "Differential evolution, tuned", _STORN,
        f"strategy, F and CR as tuned; {_BOUNCE}", _TUNED, de.DifferentialEvolution,
        strategy=de.best_1, F=de.Dither(), CR=de.Either(share=0.73),
    ),
    _own(
        "gwo", "Grey wolf optimiser", _WOLF, "none from the author's program", _PUBLISHED,
        GreyWolf, "grey-wolf",
    ),
    _own(
        "gwo-tuned", "Grey wolf optimiser, tuned", _WOLF, "start and fall of a as tuned", _TUNED,
        GreyWolf, start=1.67, power=0.7,
    ),
    _own(
        "da", "Dragonfly algorithm", _DRAGONFLY, "none from the author's program", _PUBLISHED,
        Dragonfly, "dragonfly",
    ),
    _own(
        "da-tuned", "Dragonfly algorithm, tuned", _DRAGONFLY,
        "inertia, fading of the neighbours and step limit as tuned", _TUNED, Dragonfly,
        inertia=(0.8, 0.7), fading=0.42, step_limit=0.052,
    ),
    _own(
        "woa", "Whale optimisation algorithm", _WHALE, "none from the author's program",
        _PUBLISHED, Whale, "whale",
    ),
    _own(
        "woa-tuned", "Whale optimisation algorithm, tuned", _WHALE,
        "start and fall of a, and the spiral, as tuned", _TUNED, Whale,
        start=2.09, power=2.02, spiral=0.58,
    ),
    _own(
        "random", "Random search", "Brooks (1958), Oper. Res. 6, 244-251", "none",
        "nothing: no settings", RandomSearch, "random-search",
    ),
)  # fmt: skip
