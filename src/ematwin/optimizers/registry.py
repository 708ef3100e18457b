"""The names of the algorithms, where each comes from, and whether it can be run here.

Names are for the command line and for files; programs may pass classes and objects instead.
A further method is registered by an entry point of the group ``ematwin.optimizers`` that names a
class of `Optimizer` or a function ``(box, *, population, iterations, seed)``.
"""

from __future__ import annotations

import difflib
import importlib.metadata
from functools import partial

from ematwin.errors import InputError
from ematwin.optimizers import own
from ematwin.optimizers.adapters import cma_es, nevergrad, pygmo, pymoo, scipy_de
from ematwin.optimizers.base import Box, Optimizer, OptimizerFactory
from ematwin.optimizers.catalogue import Algorithm

ENTRY_POINT_GROUP = "ematwin.optimizers"


_ADAPTED = (
    *cma_es.ALGORITHMS,
    *scipy_de.ALGORITHMS,
    *pymoo.ALGORITHMS,
    *pygmo.ALGORITHMS,
    *nevergrad.ALGORITHMS,
)


def algorithms() -> tuple[Algorithm, ...]:
    """All algorithms that can be named: this package's, the adapters', the entry points'."""
    listed = [*own.ALGORITHMS, *_ADAPTED]
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
    """Find an algorithm by its name or alias.

    Raises
    ------
    InputError
        If there is none; the message suggests the closest names.
    """
    wanted = _normal(name)
    known: dict[str, Algorithm] = {}
    for algorithm in algorithms():
        for key in (algorithm.name, *algorithm.aliases):
            known[key] = algorithm
            if key == wanted:
                return algorithm
    close = difflib.get_close_matches(wanted, known, n=3, cutoff=0.5)
    names = ", ".join(dict.fromkeys(known[key].name for key in close))
    hint = (
        f"Did you mean {names}?"
        if names
        else (f"Known are {', '.join(algorithm.name for algorithm in algorithms())}.")
    )
    raise InputError(f"There is no algorithm {name!r}. {hint}")


def create(
    name: str, box: Box, *, population: int = 50, iterations: int = 200, seed: int = 1
) -> Optimizer:
    """Make a named optimiser.

    Raises
    ------
    InputError
        If the name is unknown or a number cannot be used.
    MissingExtraError
        If the library that it needs is not installed.
    """
    factory = find(name).factory()
    return factory(box, population=population, iterations=iterations, seed=seed)


def resolve(
    algorithm: str | Optimizer | OptimizerFactory,
    box: Box,
    *,
    population: int,
    iterations: int,
    seed: int,
) -> tuple[str, Optimizer]:
    """Make an optimiser of a name, an object or a factory; give what to call it, and itself."""
    if isinstance(algorithm, str):
        found = find(algorithm)
        factory = found.factory()
        return found.name, factory(box, population=population, iterations=iterations, seed=seed)
    if isinstance(algorithm, Optimizer):
        if algorithm.box != box:
            raise InputError(
                "The optimiser was made for a different box from the bounds given here. "
                "Make both from the same bounds."
            )
        return type(algorithm).__name__, algorithm
    if not callable(algorithm):
        raise InputError(
            f"An algorithm is a name, an Optimizer or a factory of one, received {algorithm!r}."
        )
    made = algorithm(box, population=population, iterations=iterations, seed=seed)
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
