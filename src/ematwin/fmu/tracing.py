"""Follow a calculation with values that are not known yet, and write it down as one function.

A kind computes its constants from parameters and faults in Python, once for each batch. Where a
simulator changes them, Python is not there. So the calculation is run once with `Unset` values,
which note every operator and every function of numpy. These notes form a function of scalars that
numba compiles. The formula stands once, in the kind.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.errors import InputError

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
