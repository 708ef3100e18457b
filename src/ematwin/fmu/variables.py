"""The variables of an exported actuator, in one table that XML and C header follow."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from ematwin.fmu.tracing import followed
from ematwin.models.base import Model
from ematwin.models.stepped import Stepped

# role: causality and variability by FMI; in C one letter, where parameters of both kinds share
# their places
ROLES = {
    "time": ("independent", "continuous", "s"),
    "input": ("input", "continuous", "i"),
    "output": ("output", "continuous", "o"),
    "fixed": ("parameter", "fixed", "f"),
    "tunable": ("parameter", "tunable", "t"),
    "constant": ("local", "constant", "c"),
}


class Variable(NamedTuple):
    """A variable; its place in the table is its value reference.

    ``start`` is None where a value is calculated; the bounds are included.
    """

    name: str
    role: str
    unit: str
    meaning: str
    start: float | None = None
    lower: float = -math.inf
    upper: float = math.inf


class Table(NamedTuple):
    """Variables in the order of their references, and what fills the constants from parameters."""

    variables: list[Variable]
    constants_from: Any

    def of(self, *roles: str) -> list[Variable]:
        """Variables of some roles, in order."""
        return [one for one in self.variables if one.role in roles]


def table_of(model: Model, actuator: Any, stepped: Stepped) -> Table:
    """Time, inputs, outputs, tunable faults, fixed parameters, and constants, in this order.

    An input of the simulation that its constants do not depend on is no variable. Parameters that
    set the grid of steps, or that a fault states in their place, are constants.
    """
    known = model.values_of(actuator, {})
    unknowns = [(one, "tunable") for one in model.unknowns(actuator) if one.name in known]
    named = [
        Variable(one.name, role, one.unit, one.meaning, one.healthy, one.lower, one.upper)
        for one, role in (*unknowns, *((start, "fixed") for start in stepped.starts))
    ]
    nominals = [_nominal(actuator, row) for row in actuator.parameters()]
    held = {*model.fixed, *stepped.fixed}
    free = [*named, *(one for one in nominals if one.name not in held)]
    _, used = followed(stepped.constants, [one.name for one in free])
    settable = [one for one in free if one.name in used]
    constants_from, _ = followed(
        _with_rest(stepped.constants, free, used), [one.name for one in settable]
    )
    fixed = [one._replace(role="constant") for one in nominals if one.name not in used]
    variables = [
        Variable("time", "time", "s", "simulation time"),
        *(_channel(model, name, "input", 0.0) for name in stepped.inputs),
        *(_channel(model, name, "output") for name in stepped.outputs),
        *settable,
        *fixed,
    ]
    return Table(variables, constants_from)


def _with_rest(constants: Any, free: Sequence[Variable], used: set[str]) -> Any:
    """The calculation with all variables outside ``used`` at their start values."""
    rest = {one.name: one.start for one in free if one.name not in used}
    return lambda values: constants({**rest, **values})


def _channel(model: Model, name: str, role: str, start: float | None = None) -> Variable:
    channel = model.channel(name)
    return Variable(name, role, channel.unit, channel.meaning, start)


def _nominal(actuator: Any, row: tuple[str, float, str, str, str]) -> Variable:
    place, value, unit, meaning, source = row
    lower, upper = actuator.limits(place)
    section, _, name = place.partition(".")
    for rule in type(getattr(actuator, section)).model_fields[name].metadata:
        # bounds of FMI are included
        lower = math.nextafter(lower, math.inf) if getattr(rule, "gt", None) == lower else lower
        upper = math.nextafter(upper, -math.inf) if getattr(rule, "lt", None) == upper else upper
    return Variable(
        place, "fixed", unit, f"{meaning} (source: {source})", float(value), lower, upper
    )
