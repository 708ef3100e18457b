"""Numbers with units in files: read once, converted to SI, checked for the right dimension."""

from functools import cache
from typing import Any

from ematwin.errors import ParameterError


@cache
def _registry() -> Any:
    import pint  # where it is needed: importing ematwin stays quick

    return pint.UnitRegistry(cache_folder=None)


def to_si(value: float, unit: str, si_unit: str, what: str) -> float:
    """``value`` in ``unit`` converted to ``si_unit``.

    Raises
    ------
    ParameterError
        If the unit is unknown or measures something else.
    """
    if unit == si_unit:
        return value
    registry = _registry()
    try:
        return float(registry.Quantity(value, unit).to(si_unit).magnitude)
    except Exception as error:
        # pint raises a family of unrelated types here (undefined unit, dimension, syntax)
        raise ParameterError(
            f"{what} must have a unit of the kind {si_unit or 'no unit'}; "
            f"received {value} {unit!r} ({type(error).__name__}). Correct the unit."
        ) from None


def parse_quantity(text: str, si_unit: str, what: str) -> float:
    """A string such as ``"25 Hz"`` or ``"0.3 deg"`` as a number in ``si_unit``."""
    head, _, unit = text.strip().partition(" ")
    try:
        value = float(head)
    except ValueError:
        raise ParameterError(
            f'{what} must be a number or a number with a unit such as "5 {si_unit}"; '
            f"received {text!r}."
        ) from None
    return to_si(value, unit.strip() or si_unit, si_unit, what)
