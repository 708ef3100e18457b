"""Words and numbers for people: the digits that an interval deserves, and preferred units."""

import math
from collections.abc import Sequence

from ematwin.quantities import preferred

_MOST_DIGITS = 6  # significant ones, however narrow the interval
_PLAIN = 6  # decimals, and digits before the point, that are written without a power of ten


def with_interval(value: float, low: float, high: float) -> tuple[str, str]:
    """A value and its interval, as "0.0452" and "0.0444 to 0.0463".

    All are rounded to the same digit, so that the interval never excludes its value. Its width is
    2.5 to 25 units of that digit. Without a width there are four significant digits.
    """
    largest = max(abs(value), abs(low), abs(high))
    width = high - low
    if not math.isfinite(width + value) or width <= 0.0:
        return plain(value, 4), f"{plain(low, 4)} to {plain(high, 4)}"
    power = _power(largest)
    place = max(_power(width / 2.5), power - _MOST_DIGITS + 1)
    if _scale(power) == 0:  # what has four digits is not rounded to tens
        place = min(place, max(0, power - 3))
    said = [_fixed(x, place, _scale(power)) for x in (value, low, high)]
    return said[0], f"{said[1]} to {said[2]}"


def plain(value: float, digits: int = 3) -> str:
    """A number with some significant digits, without a power of ten where that is readable."""
    if not math.isfinite(value) or value == 0.0:
        return f"{value + 0.0:g}"
    power = _power(value)
    text = _fixed(value, power - digits + 1, _scale(power))
    mantissa, e, rest = text.partition("e")
    return (mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa) + e + rest


def apart(one: float, other: float) -> tuple[str, str]:
    """Two numbers with as many digits as tell them apart, three at least."""
    for digits in range(3, _MOST_DIGITS + 3):
        said = plain(one, digits), plain(other, digits)
        if said[0] != said[1]:
            break
    return said


def in_unit(number: str, unit: str) -> str:
    """A number with its unit, as "0.045 N m"."""
    return f"{number} {unit.replace('*', ' ')}".rstrip()


def number_of(value: float, unit: str, digits: int = 4) -> str:
    """A value in ``unit`` as a number in the unit in which it is shown."""
    return plain(preferred(unit)[1] * value, digits)


def said(value: float, unit: str, digits: int = 4) -> str:
    """The same with the unit: "45 mN m"."""
    return in_unit(number_of(value, unit, digits), preferred(unit)[0])


def said_between(value: float, low: float, high: float, unit: str) -> tuple[str, str]:
    """A value and its interval in the unit in which they are shown: "45.2 mN m", "44.4 to 46.3"."""
    shown, factor = preferred(unit)
    number, between = with_interval(factor * value, factor * low, factor * high)
    return in_unit(number, shown), between


def _power(value: float) -> int:
    """Of ten, of the first digit."""
    return math.floor(math.log10(abs(value)))


def _scale(power: int) -> int:
    """The power of ten that is written after a number; 0 writes none."""
    return 0 if -_PLAIN + 2 <= power < _PLAIN else power


def _fixed(value: float, place: int, scale: int) -> str:
    """``value`` rounded to 10^``place``, written in units of 10^``scale``."""
    if value == 0.0:
        return "0"
    rounded = round(value / 10.0**place) * 10.0**place
    text = f"{rounded / 10.0**scale + 0.0:.{max(0, scale - place)}f}"  # no minus before a zero
    return text if scale == 0 or rounded == 0.0 else f"{text}e{scale}"


def listed(names: Sequence[str], word: str = "and") -> str:
    """ "a, b and c"."""
    return ", ".join(names[:-1]) + (f" {word} " if len(names) > 1 else "") + names[-1]


def counted(number: int, noun: str) -> str:
    """ "1 case", "2 cases"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]
