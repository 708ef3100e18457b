"""The names of the algorithms, where each comes from, and whether it can be run here.

Names are for the command line and for files; programs may pass classes and objects instead.
A further method is registered by an entry point of the group ``ematwin.optimizers`` that names a
class of `Optimizer` or a function ``(box, *, population, iterations, seed)``.
"""

import difflib
import importlib.metadata
from functools import partial

import numpy as np

from ematwin.errors import InputError
from ematwin.optimizers import adapters, own
from ematwin.optimizers.base import Algorithm, Box, Optimizer, OptimizerFactory

ENTRY_POINT_GROUP = "ematwin.optimizers"

PRESETS = {
    "paper": ("ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa"),
    "improved": ("ga-tuned", "pso-tuned", "de-tuned", "gwo-tuned", "da-tuned", "woa-tuned"),
    "best": ("multistart", "scipy-trf", "cma", "scipy-de", "ga", "pso", "de"),
}
"""Methods that a study compares under one name: the six of the ESREL paper as first published, or
as the author's program has them; the same six, tuned with one effort for all; what one would use.
"""

_SHIPPED = (*own.ALGORITHMS, *adapters.ALGORITHMS)
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
    for point in importlib.metadata.entry_points(group=ENTRY_POINT_GROUP):
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
