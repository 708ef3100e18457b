"""The variables of an exported actuator, in one table that XML and C header follow.

A kind computes its constants from parameters and faults in Python, once for each batch. Where a
simulator changes them, Python is not there. So the calculation is run once with `Unset` values,
which note every operator and every function of numpy. These notes form a function of scalars that
numba compiles. The formula stands once, in the kind.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import InputError
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
    rest = {one.name: one.start for one in free if one.name not in used}
    constants_from, _ = followed(
        lambda values: stepped.constants({**rest, **values}), [one.name for one in settable]
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


_OPERATORS = {
    np.add: "({} + {})", np.subtract: "({} - {})", np.multiply: "({} * {})",
    np.true_divide: "({} / {})", np.power: "({} ** {})", np.negative: "(-{})",
    np.greater: "({} > {})", np.greater_equal: "({} >= {})", np.less: "({} < {})",
    np.less_equal: "({} <= {})",
}  # fmt: skip


class Unset(np.lib.mixins.NDArrayOperatorsMixin):
    """A number that is not known yet; ``text`` is the name of its value in ``lines``."""

    def __init__(self, text: str, lines: list[str]) -> None:
        self.text, self.lines = text, lines

    def __array_ufunc__(self, ufunc: Any, method: str, *given: Any, **more: Any) -> Any:
        if method != "__call__" or more:
            return NotImplemented
        form = _OPERATORS.get(ufunc, f"np.{ufunc.__name__}({', '.join('{}' for _ in given)})")
        return self._noted(form.format(*map(_text, given)))

    def __array_function__(self, function: Any, types: Any, given: Any, more: Any) -> Any:
        if function is not np.where or more:
            return NotImplemented
        condition, one, other = map(_text, given)
        return self._noted(f"({one} if {condition} else {other})")

    def __float__(self) -> float:
        raise TypeError("its value is not known yet")

    __bool__ = __int__ = __index__ = __float__

    def _noted(self, formula: str) -> "Unset":
        name = f"v{len(self.lines)}"
        self.lines.append(f"{name} = {formula}")
        return Unset(name, self.lines)


def _text(value: Any) -> str:
    return value.text if isinstance(value, Unset) else repr(float(value))


def followed(calculation: Any, names: Sequence[str]) -> tuple[Any, set[str]]:
    """A calculation of named values as a function of arrays, and the names that it depends on.

    The calculation takes values by name and gives numbers; the function ``(p, c)``, which numba can
    compile, fills ``c`` (N, 1) from ``p`` (M, 1), values in the order of ``names``. `InputError` if
    the calculation needs a value while it is followed, as a branch on it does.
    """
    lines: list[str] = []
    values: Mapping[str, Any] = {name: Unset(f"p[{n}, 0]", lines) for n, name in enumerate(names)}
    try:
        results = [_text(one) for one in calculation(values)]
    except TypeError as error:
        raise InputError(
            f"The constants of this kind cannot be exported, as {error}: they have to be computed "
            "by operators and functions of numpy alone, without a branch on a value."
        ) from error
    lines += [f"c[{n}, 0] = {text}" for n, text in enumerate(results)]
    source = "def constants_from(p, c):\n" + "".join(f"    {line}\n" for line in lines)
    made: dict[str, Any] = {"np": np, "nan": np.nan, "inf": np.inf}
    exec(source, made)  # as `typing.NamedTuple` makes its classes
    used = {name for n, name in enumerate(names) if f"p[{n}, 0]" in source}
    return made["constants_from"], used
