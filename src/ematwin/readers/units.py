"""Units of channels: recognised in names and attributes, turned into a factor to SI."""

import re
from functools import cache

from ematwin.errors import ParameterError, RecordError
from ematwin.quantities import to_si

# Spellings met in files of test benches that pint reads as something else or not at all.
# (pint takes Nm for "N times milli-nothing", and 1/min for 1/60 rad/s instead of a turn a minute.)
_SPELLINGS = {
    "nm": "N*m", "knm": "kN*m", "mnm": "mN*m", "n-m": "N*m",
    "u/min": "rpm", "1/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "r/min": "rpm",
    "rev/min": "rpm", "rev": "turn", "rev/s": "turn/s", "u/s": "turn/s", "r/s": "turn/s",
    "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "ma": "mA",
    "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "usec": "us",
    "rads": "rad", "rad/sec": "rad/s", "deg/sec": "deg/s", "degrees": "deg",
    "grad": "deg",  # German for degree; pint's grad is the gon
}  # fmt: skip
_ANGULAR = re.compile(r"rad|deg|°|turn|rpm|rev|arcmin|arcsec|gon|cycle", re.IGNORECASE)
_BRACKETED = re.compile(r"[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SLASHED = re.compile(r"\s/\s*(\S+)\s*$")  # "I_a / mA", as DIN 461 writes it
_NONE = {"", "-", "--", "none", "1", "[]", "n/a"}


def unit_factor(unit: str, si_unit: str, what: str) -> float:
    """The number that turns a value in ``unit`` into ``si_unit``.

    Raises
    ------
    RecordError
        If the unit is unknown or measures something else; a frequency is no angular speed.
    """
    factor = _factor(unit.strip(), si_unit)
    if factor is None:
        raise RecordError(
            f"{what} must have a unit of the kind {si_unit}; received {unit!r}. Give its unit in "
            f'the map, such as unit = "{_example(si_unit)}", or a scale to {si_unit}.'
        )
    return factor


def is_unit(text: str) -> bool:
    """Whether a text is the unit of something that a record holds."""
    from ematwin.signals.record import UNITS

    inside = unbracketed(text)
    return any(_factor(inside, si_unit) is not None for si_unit in set(UNITS.values()))


def unbracketed(text: str) -> str:
    """``"[mA]"`` as ``"mA"``."""
    match = _BRACKETED.fullmatch(text.strip())
    return match[1] if match else text.strip()


def unit_in_name(name: str, si_unit: str) -> str | None:
    """The unit at the end of a channel name such as ``"Phase A [mA]"``, if it fits ``si_unit``."""
    for pattern in (_BRACKETED, _SLASHED):
        match = pattern.search(name)
        if match and _factor(match[1], si_unit) is not None:
            return match[1]
    return None


def says_nothing(unit: str | None) -> bool:
    """Whether the unit that a file states is empty."""
    return unit is None or unit.strip().casefold() in _NONE


@cache
def _factor(unit: str, si_unit: str) -> float | None:
    if unit == si_unit:
        return 1.0
    if not unit or len(unit) > 30 or (unit[0].isdigit() and not unit.startswith("1/")):
        return None
    unit = unit.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    unit = unit.replace("\N{MIDDLE DOT}", "*")
    unit = _SPELLINGS.get(unit.casefold() if unit != "MA" else unit, unit)
    # pint holds that a radian is nothing, so that percent and Hz would pass for rad and rad/s
    if ("rad" in si_unit) != bool(_ANGULAR.search(unit)):
        return None
    try:
        return to_si(1.0, unit, si_unit, "unit")
    except ParameterError:
        return None


def _example(si_unit: str) -> str:
    return {"s": "ms", "rad": "deg", "A": "mA", "rad/s": "rpm", "N*m": "N*m"}.get(si_unit, si_unit)
