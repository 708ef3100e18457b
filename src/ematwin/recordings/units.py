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
    "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "ma": "mA",
    "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "usec": "us",
    "rads": "rad", "rad/sec": "rad/s", "deg/sec": "deg/s", "degrees": "deg",
    "grad": "deg",  # German for degree; pint's grad is the gon
}  # fmt: skip
_BRACKETED = re.compile(r"[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SLASHED = re.compile(r"\s/\s*(\S+)\s*$")  # "I_a / mA", as DIN 461 writes it
_WORD = re.compile("[A-Za-zµμ°]+")
_NONE = {"", "-", "--", "none", "1", "[]", "n/a"}
_KINDS = ("s", "rad", "m", "N*m", "N", "A", "rad/s", "m/s")  # of what recordings usually hold
_OTHERS = ("kg", "V", "W", "K", "Pa", "Hz", "m/s^2")


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
            f'the map, such as unit = "{example(si_unit)}", or a scale to {si_unit}.'
        )
    return factor


def fits(unit: str, si_unit: str) -> bool:
    """Whether a unit is of the kind of an SI unit."""
    return _factor(unit.strip(), si_unit) is not None


def is_unit(text: str) -> bool:
    """Whether a text is the unit of something that recordings usually hold."""
    inside = unbracketed(text)
    return any(_factor(inside, si_unit) is not None for si_unit in _KINDS)


def is_other_unit(text: str) -> bool:
    """Whether a text of more than a letter, which often numbers channels, is a unit of any kind."""
    kinds = (*_KINDS, *_OTHERS)
    return len(text) > 1 and any(_factor(text, si_unit) is not None for si_unit in kinds)


def unbracketed(text: str) -> str:
    """``"[mA]"`` as ``"mA"``."""
    match = _BRACKETED.fullmatch(text.strip())
    return match[1] if match else text.strip()


def bare(name: str) -> str:
    """The name without a unit in brackets or behind a slash: ``"Phase A [mA]"``: "Phase A"."""
    text = re.sub(r"\s*(\[[^\]]*\]|\([^)]*\))\s*$", "", name).strip()
    slashed = _SLASHED.search(text)
    if slashed and is_unit(slashed[1]):
        return text[: slashed.start()].strip()
    return text


def unit_beside_name(name: str) -> str | None:
    """The text in brackets or behind a slash at the end of a name, whatever it is; or None."""
    return next(_beside(name), None) if bare(name) != name.strip() else None


def unit_in_brackets(name: str, si_unit: str) -> str | None:
    """The unit in brackets or behind a slash at the end of a name, if it fits ``si_unit``."""
    return next((text for text in _beside(name) if _factor(text, si_unit) is not None), None)


def unit_in_name(name: str, si_unit: str, names: Collection[str] = ()) -> str | None:
    """The unit at the end of a channel name, if it fits ``si_unit``: ``mm`` of ``travel_mm``.

    ``names`` are of all channels of the file: a letter of a series (``phase_a``,
    ``phase_b``) is no unit.
    """
    behind = (unit for _, unit in suffixes(name, si_unit, names))
    return unit_in_brackets(name, si_unit) or next(behind, None)


def suffixes(name: str, si_unit: str, names: Collection[str] = ()) -> Iterator[tuple[str, str]]:
    """Yield stem and unit of a name such as ``set_point_mm``, where the unit fits ``si_unit``."""
    for stem, unit in endings(name):
        if unit.casefold() == "a":  # ampere, or the first of a series
            if si_unit != "A" or _has_sibling(stem, names):
                continue
            unit = "A"
        if _factor(unit, si_unit) is not None:
            yield stem, unit


def units_behind(name: str, names: Collection[str] = ()) -> Iterator[str]:
    """Yield units of any usual kind behind the last underscore of a name.

    A single letter but A is more often a number of a series than a unit, and A only where there
    is no B.
    """
    for stem, unit in endings(name):
        if unit.casefold() == "a":
            if unit == "A" and not _has_sibling(stem, names):
                yield "A"
        elif len(unit) > 1 and is_other_unit(unit):
            yield unit


def endings(name: str) -> Iterator[tuple[str, str]]:
    """Yield stem and the text behind the last underscore, and behind the last but one."""
    name = name.strip()
    if name.isupper():  # SET_POINT_MM is in mm, not in megametres
        name = name.casefold()
    stem, _, last = name.rpartition("_")
    if not (stem and _WORD.fullmatch(last)):
        return
    yield stem, last
    head, _, first = stem.removesuffix("_per").rpartition("_")
    if head and _WORD.fullmatch(first):
        yield head, f"{first}/{last}"  # motor_speed_rad_s, motor_speed_deg_per_s


def says_nothing(unit: str | None) -> bool:
    """Whether the unit that a file states is empty."""
    return unit is None or unit.strip().casefold() in _NONE


def example(si_unit: str) -> str:
    """A unit of that kind that needs converting, for messages."""
    return {"s": "ms", "rad": "deg", "A": "mA", "rad/s": "rpm", "m": "mm"}.get(si_unit, si_unit)


def _beside(name: str) -> Iterator[str]:
    for pattern in (_BRACKETED, _SLASHED):
        match = pattern.search(name)
        if match:
            yield match[1]


def _has_sibling(stem: str, names: Collection[str]) -> bool:
    return any(name.strip().casefold() == f"{stem}_b".casefold() for name in names)


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
