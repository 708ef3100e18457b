"""The names of the algorithms, where each comes from, and whether it can be run here.

Names are for the command line and for files; programs may pass classes and objects instead.
A further method is registered by an entry point of the group ``ematwin.optimizers`` that names a
class of `Optimizer` or a function ``(box, *, population, iterations, seed)``.

This package's own methods have forms as first published, or as the author's program has them;
improved forms; and tuned forms, whose settings were chosen with one effort for all six methods, on
functions that stand in no study (``benchmarks/tuning.py``, docs/optimizers.md).
"""

import difflib
import importlib.metadata
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.optimizers import adapters
from ematwin.optimizers import differential_evolution as de
from ematwin.optimizers import genetic_algorithm as ga
from ematwin.optimizers import particle_swarm as pso
from ematwin.optimizers.base import Algorithm, Box, Optimizer, OptimizerFactory, RandomSearch
from ematwin.optimizers.dragonfly import Dragonfly
from ematwin.optimizers.grey_wolf import GreyWolf
from ematwin.optimizers.whale import Whale

PRESETS = {
    "paper": ("ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa"),
    "improved": ("ga-tuned", "pso-tuned", "de-tuned", "gwo-tuned", "da-tuned", "woa-tuned"),
    "best": ("multistart", "scipy-trf", "cma", "scipy-de", "ga", "pso", "de"),
}
"""Methods that a study compares under one name: the six of the ESREL paper as first published, or
as the author's program has them; the same six, tuned with one effort for all; what one would use.
"""

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


_OWN = (
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

_SHIPPED = (*_OWN, *adapters.ALGORITHMS)
_REGISTERED: dict[str, Algorithm] = {}  # of this process, by name


def register(name: str, factory: OptimizerFactory, *, title: str = "", source: str = "") -> None:
    """Give an algorithm a name, in this process and in the workers that it starts.

        ematwin.register("mine", MyOptimizer)

    Names are then used like any other: in `ematwin.minimize`, `ematwin.identify`,
    `ematwin.compare`. The same name again replaces the algorithm. A package registers by an entry
    point of the group ``ematwin.optimizers`` instead, which the command line finds as well.

    Parameters
    ----------
    name : of the algorithm; lower case, hyphens for underscores
    factory : a class of `Optimizer`, or a function ``(box, *, population, iterations, seed)``
    title, source : for tables and reports

    Raises
    ------
    InputError
        If the name is one that comes with ematwin, or the factory makes no `Optimizer`.
    """
    key = _normal(name)
    taken = {known for one in _SHIPPED for known in (one.name, *one.aliases)}
    if not key:
        raise InputError("An algorithm needs a name; received an empty one.")
    if key in taken:
        raise InputError(f"The name {name!r} is taken by an algorithm of ematwin; choose another.")
    if not callable(factory):
        raise InputError(
            f"An algorithm is a class of Optimizer or a function that makes one, received "
            f"{factory!r}."
        )
    _try(name, factory)
    said = (factory.__doc__ or "").strip().partition("\n")[0].rstrip(".")
    _REGISTERED[key] = Algorithm(
        key, title or said or name, source or getattr(factory, "__module__", ""), "registered",
        lambda: factory,
    )  # fmt: skip


def _try(name: str, factory: OptimizerFactory) -> None:
    """Make one for a small box and ask it once: a study would find out only run by run."""
    box, settings = Box(np.zeros(3), np.ones(3)), {"population": 20, "iterations": 10, "seed": 1}
    try:
        _, made = resolve(factory, box, **settings)
        batch = made.ask()
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"The algorithm {name!r} is called with (box, population=20, iterations=10, seed=1) "
            f"and asked for a batch: {type(error).__name__}: {error}. Correct the class or "
            "function."
        ) from error
    made.close()
    if np.ndim(batch) != 2 or np.shape(batch)[1] != box.dimension:
        raise InputError(
            f"The algorithm {name!r} must ask for an (N, 3) array in a box of 3 variables, but "
            f"asked for one of shape {np.shape(batch)}. Correct its ask()."
        )
    if not box.contains(batch):
        raise InputError(
            f"The algorithm {name!r} asked for points outside the box. Clip them: box.clip(points)."
        )


def registered() -> tuple[Algorithm, ...]:
    """Those of this process."""
    return tuple(_REGISTERED.values())


def algorithms() -> tuple[Algorithm, ...]:
    """All that can be named: this package's, the adapters', registered ones, entry points'."""
    listed = [*_SHIPPED, *registered()]
    taken = {name for algorithm in listed for name in (algorithm.name, *algorithm.aliases)}
    for point in importlib.metadata.entry_points(group="ematwin.optimizers"):
        package = point.dist.name if point.dist is not None else point.value.partition(".")[0]
        name = _normal(point.name)
        # A name that is taken is not taken over: the newcomer is told apart by its package.
        name = f"{package}:{name}" if name in taken else name
        taken.add(name)
        listed.append(
            Algorithm(name, point.value, package, package, partial(_load_entry_point, point))
        )
    return tuple(listed)


def find(name: str) -> Algorithm:
    """Find an algorithm by its name or alias, or suggest the closest names (`InputError`)."""
    wanted = _normal(name)
    known = {key: one for one in algorithms() for key in (one.name, *one.aliases)}
    if wanted in known:
        return known[wanted]
    close = difflib.get_close_matches(wanted, known, n=3, cutoff=0.5)
    names = ", ".join(dict.fromkeys(known[key].name for key in close or known))
    said = f"Did you mean {names}?" if close else f"Known are {names}."
    raise InputError(f"There is no algorithm {name!r}. {said}")


def resolve(
    algorithm: str | Optimizer | OptimizerFactory,
    box: Box,
    *,
    population: int,
    iterations: int,
    seed: int,
) -> tuple[str, Optimizer]:
    """Make an optimiser of a name, an object or a factory; give what to call it, and itself."""
    settings = {"population": population, "iterations": iterations, "seed": seed}
    if isinstance(algorithm, str):
        found = find(algorithm)
        return found.name, found.factory()(box, **settings)
    if isinstance(algorithm, Optimizer):
        if not np.array_equal([algorithm.box.lower, algorithm.box.upper], [box.lower, box.upper]):
            raise InputError(
                "The optimiser was made for a different box from the bounds given here. "
                "Make both from the same bounds."
            )
        return type(algorithm).__name__, algorithm
    if not callable(algorithm):
        raise InputError(
            f"An algorithm is a name, an Optimizer or a factory of one, received {algorithm!r}."
        )
    made = algorithm(box, **settings)
    if not isinstance(made, Optimizer):
        raise InputError(
            f"The factory {algorithm!r} must make an ematwin.optimizers.Optimizer, "
            f"but made {type(made).__name__}."
        )
    return type(made).__name__, made


def _normal(name: str) -> str:
    return name.strip().lower().replace("_", "-")


def _load_entry_point(point: importlib.metadata.EntryPoint) -> OptimizerFactory:
    try:
        factory: OptimizerFactory = point.load()
    except Exception as error:
        raise InputError(
            f"The algorithm {point.name!r} cannot be loaded from {point.value}: {error}. "
            "Repair or remove the package that registers it."
        ) from error
    return factory
