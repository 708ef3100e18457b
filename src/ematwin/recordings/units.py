"""Units of channels: where they are written, and the factor to SI.

A unit stands in the map, in an attribute of the file, or in the name of the channel: in brackets
or parentheses (``Phase A [mA]``), behind a slash (``I_a / mA``, DIN 461), or behind the last
underscore (``set_point_mm``, ``motor_speed_deg_s``).
"""

import re
from collections.abc import Collection, Iterator
from functools import cache

from ematwin.errors import ParameterError, RecordError
from ematwin.quantities import ANGULAR, to_si, turns_a_minute

# Spellings met in files of test benches that pint reads as something else or not at all.
# (pint takes Nm for "N times milli-nothing".)
_SPELLINGS = {
    "nm": "N*m", "knm": "kN*m", "mnm": "mN*m", "n-m": "N*m",
    "rev": "turn", "rev/s": "turn/s", "u/s": "turn/s", "r/s": "turn/s",
    "a": "A", "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "ma": "mA",
    "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "usec": "us",
    "rads": "rad", "rad/sec": "rad/s", "deg/sec": "deg/s", "degrees": "deg",
    "grad": "deg",  # German for degree; pint's grad is the gon
}  # fmt: skip
_BRACKETED = re.compile(r"\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SLASHED = re.compile(r"\s+/\s*(\S+)\s*$")  # "I_a / mA", as DIN 461 writes it
_WORD = re.compile("[A-Za-zµμ°]+")
_NONE = {"", "-", "--", "none", "1", "[]", "n/a"}
_KINDS = ("s", "rad", "m", "N*m", "N", "A", "rad/s", "m/s")  # of what recordings usually hold
_OTHERS = ("kg", "V", "W", "K", "Pa", "Hz", "m/s^2")  # a letter alone is more often a name


def unit_factor(unit: str, si_unit: str, what: str) -> float:
    """The number that turns ``unit`` into ``si_unit``; `RecordError` if it does not fit."""
    factor = _factor(unit.strip(), si_unit)
    if factor is None:
        raise RecordError(
            f"{what} must have a unit of the kind {si_unit}; received {unit!r}. Give its unit in "
            f'the map, such as unit = "{example(si_unit)}", or a scale to {si_unit}.'
        )
    return factor


def fits(unit: str, si_unit: str) -> bool:
    """Whether a unit is of the kind of an SI unit."""
    return _factor(unit.strip(), si_unit) is not None


def is_unit(text: str) -> bool:
    """Whether a text, in brackets or not, is a unit."""
    unit = unbracketed(text)
    return any(fits(unit, kind) for kind in _KINDS + (_OTHERS if len(unit) > 1 else ()))


def unbracketed(text: str) -> str:
    """``"[mA]"`` as ``"mA"``."""
    match = _BRACKETED.fullmatch(text)
    return match[1] if match else text.strip()


def bare(name: str) -> str:
    """The name without a unit in brackets or behind a slash: ``"Phase A [mA]"``: "Phase A"."""
    return beside(name)[0]


def beside(name: str) -> tuple[str, str]:
    """Stem, and the text in brackets or the unit behind a slash at the end of a name; or ""."""
    for pattern in (_BRACKETED, _SLASHED):
        match = pattern.search(name)
        if match and (pattern is _BRACKETED or is_unit(match[1])):
            return name[: match.start()].strip(), match[1]
    return name.strip(), ""


def suffixes(name: str, names: Collection[str] = ()) -> Iterator[tuple[str, str]]:
    """Yield stem and what may be a unit: behind the last underscore, behind the last but one.

    A letter of a series (``phase_a``, ``phase_b`` among all ``names`` of the file) is no unit.
    """
    if name.isupper():  # SET_POINT_MM is in mm, not in megametres
        name = name.casefold()
    stem, _, last = name.rpartition("_")
    siblings = last in ("a", "A") and any(f"{stem}_b".casefold() == n.casefold() for n in names)
    if not stem or siblings or not _WORD.fullmatch(last):
        return
    yield stem, last
    head, _, over = stem.removesuffix("_per").rpartition("_")
    if head and _WORD.fullmatch(over):
        yield head, f"{over}/{last}"  # motor_speed_rad_s, motor_speed_deg_per_s


def unit_in_name(name: str, si_unit: str, names: Collection[str] = ()) -> tuple[str, str]:
    """Stem and unit of a name with a unit that fits ``si_unit``; else the name and ""."""
    first = beside(name)
    found = (one for one in (first, *suffixes(first[0], names)) if fits(one[1], si_unit))
    stem, unit = next(found, (name, ""))
    return stem, "A" if unit == "a" else unit


def says_nothing(unit: str | None) -> bool:
    """Whether the unit that a file states is empty."""
    return unit is None or unit.strip().casefold() in _NONE


def example(si_unit: str) -> str:
    """A unit of that kind that needs converting, for messages."""
    return {"s": "ms", "rad": "deg", "A": "mA", "rad/s": "rpm", "m": "mm"}.get(si_unit, si_unit)


@cache
def _factor(unit: str, si_unit: str) -> float | None:
    if unit == si_unit:
        return 1.0
    if not unit or len(unit) > 30 or (unit[0].isdigit() and not unit.startswith("1/")):
        return None
    unit = unit.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    unit = unit.replace("\N{MIDDLE DOT}", "*")
    if not (si_unit == "m" and unit == "nm"):  # a nanometre there, a newton metre elsewhere
        unit = _SPELLINGS.get(unit.casefold() if unit != "MA" else unit, unit)
    if "rad" in si_unit:
        unit = turns_a_minute(unit)
    # pint holds that a radian is nothing, so that percent and Hz would pass for rad and rad/s
    if ("rad" in si_unit) != bool(ANGULAR.search(unit)):
        return None
    try:
        return to_si(1.0, unit, si_unit, "unit")
    except ParameterError:
        return None
