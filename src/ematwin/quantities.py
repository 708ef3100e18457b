"""Numbers with units: those in files become SI, checked for the right dimension.

Sentences, tables and figures show SI, or the units that a user prefers (`use_units`); files, JSON
and DataFrames are SI always.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from ematwin.errors import FileError, InputError, ParameterError

# pint holds that a radian is nothing, so that Hz passes for rad/s and a bare number for rad.
ANGULAR = re.compile(r"rad|deg|°|turn|rpm|rev|arcmin|arcsec|gon|cycle", re.IGNORECASE)
# Factors of usual units, as pint has them: importing it takes longer than reading a file.
_USUAL = {
    ("ms", "s"): 1e-3, ("us", "s"): 1e-6, ("mm", "m"): 1e-3, ("um", "m"): 1e-6,
    ("mm/s", "m/s"): 1e-3, ("mA", "A"): 1e-3, ("mV", "V"): 1e-3, ("kN", "N"): 1e3,
    ("mN*m", "N*m"): 1e-3, ("mohm", "ohm"): 1e-3, ("mH", "H"): 1e-3, ("uH", "H"): 1e-6,
    ("deg", "rad"): math.pi / 180.0, ("mrad", "rad"): 1e-3, ("deg/s", "rad/s"): math.pi / 180.0,
    ("rpm", "rad/s"): math.pi / 30.0, ("kHz", "Hz"): 1e3,
    ("g*cm^2", "kg*m^2"): 1.0000000000000001e-07, ("kg*cm^2", "kg*m^2"): 1e-4,
}  # fmt: skip
# Quantities that are shown, with the units in which kinds give them, SI first. The turns of a
# winding are no angle.
QUANTITIES = {
    "angle": ("rad", "deg"), "angular speed": ("rad/s",), "torque": ("N*m",),
    "length": ("m", "mm"), "speed": ("m/s",), "force": ("N",), "current": ("A",),
    "voltage": ("V",), "resistance": ("ohm",), "inductance": ("H",), "mass": ("kg",),
    "inertia": ("kg*m^2",), "time": ("s", "ms"),
}  # fmt: skip
LARGEST_SHARE = 2.0  # of a tolerance: up to three times too small or too large


@cache
def _registry() -> Any:
    import pint  # where it is needed: importing ematwin stays quick

    return pint.UnitRegistry(cache_folder=None)


def to_si(value: float, unit: str, si_unit: str, what: str) -> float:
    """``value`` in ``unit`` converted to ``si_unit``.

    Raises `ParameterError` if the unit is unknown or measures something else; a frequency is no
    angular speed.
    """
    if unit == si_unit:
        return value
    if isinstance(unit, str) and (unit, si_unit) in _USUAL:
        return float(value * _USUAL[unit, si_unit])
    kind = "unit '', a ratio" if si_unit == "" else f"unit of the kind {si_unit}"
    try:
        if not isinstance(unit, str):
            raise ValueError(unit)
        spelled = turns_a_minute(unit) if "rad" in si_unit else unit
        if _is_mistaken(spelled, si_unit):
            raise ValueError(unit)
        return float(_registry().Quantity(value, spelled_out(spelled)).to(si_unit).magnitude)
    except Exception:
        # pint raises a family of unrelated types here (undefined unit, dimension, syntax)
        received = f"received {value:g} {unit!r}"
        raise ParameterError(f"{what} must have a {kind}; {received}. Correct the unit.") from None


def spelled_out(unit: str) -> str:
    """A unit with products as pint spells them: ``Nm`` as ``N*m``."""
    # Nm is a nautical mile to pint
    unit = re.sub(r"\b([kmu\N{MICRO SIGN}]?)N([cm]?)m\b", r"\1N*\2m", unit)
    unit = re.sub(r"\b(m?)Vs\b", r"\1V*s", unit)
    # gcm², kgcm2 and kgm² of data sheets; the dot and the space are left to pint
    return re.sub(r"\b([mk]?g)\s?([cm]?m)(?:\^2|2|\N{SUPERSCRIPT TWO})(?!\d)", r"\1*\2^2", unit)


def turns_a_minute(unit: str) -> str:
    """A unit with its turns a minute as pint spells them: ``V/(1000 1/min)`` as ``V/(krpm)``."""
    # pint takes 1/min for 1/60 rad/s instead of a turn a minute
    unit = re.sub(r"(?i)\b(?:u|r|rev|1)/min\b|\bmin\^?-1(?!\d)|\b[ru]pm\b", "rpm", unit)
    return re.sub(r"\b1000\s*rpm\b", "krpm", unit)


def _is_mistaken(unit: str, si_unit: str) -> bool:
    """Whether pint would convert what means something else: Hz, rad/s and 1/s are one to it."""
    angular = ANGULAR.search(unit) is not None
    if si_unit in ("rad", "rad/s"):
        return not angular
    if si_unit == "1/s":
        return "hz" in unit.lower() or "hertz" in unit.lower()
    return si_unit in ("", "Hz", "s") and angular


def parse_quantity(text: str, si_unit: str, what: str) -> float:
    """A string such as ``"25 Hz"`` or ``"0.3 deg"`` as a number in ``si_unit``."""
    head, _, unit = text.strip().partition(" ")
    try:
        value = float(head)
    except ValueError:
        like = si_unit and f' or a number with a unit such as "5 {si_unit}"'
        said = f"{what} must be a number{like}; received {text!r}"
        raise ParameterError(f"{said}. Correct it.") from None
    if not math.isfinite(value):
        raise ParameterError(f"{what} must be a finite number, received {text!r}. Correct it.")
    return to_si(value, unit.strip() or si_unit, si_unit, what)


def base_units(unit: str) -> dict[str, int]:
    """Powers of the SI base units, and of the angle, that make a unit such as ``N*m/rad``."""
    pint = _registry()
    given = pint.Quantity(1.0, spelled_out(turns_a_minute(unit)))
    powers = dict(given.to_base_units().unit_items())
    base = [name for name in powers if pint.get_dimensionality(name)]  # no radian, no bit
    found = {pint.get_symbol(name): int(powers[name]) for name in base}
    angular = [n for n, _ in given.unit_items() if ANGULAR.search(n) and "Celsius" not in n]
    angle = sum(power for name, power in given.unit_items() if name in angular)
    return found | ({"rad": int(angle)} if angle else {})


def parse_share(given: object, what: str) -> float:
    """A tolerance such as ``"5 %"`` or ``0.05``, as a share above 0 and at most `LARGEST_SHARE`.

    Raises `ParameterError` if it is anything else, a text without a per cent sign among it.
    """
    share: float = math.nan
    if isinstance(given, str) and given.strip().endswith("%"):
        with suppress(ValueError):
            share = float(given.strip()[:-1]) / 100.0
    elif isinstance(given, int | float) and not isinstance(given, bool):
        share = given
    if not 0.0 < share <= LARGEST_SHARE:
        raise ParameterError(
            f"{what} must be above 0 % and at most {100.0 * LARGEST_SHARE:g} %, such as "
            f'"5 %" or 0.05, received {given!r}; correct it.'
        )
    return float(share)


def as_percent(share: float) -> str | float:
    """A share as people write it, ``"5 %"``; the bare number where that would round it."""
    text = f"{100.0 * share:.12g} %"
    return text if parse_share(text, "it") == share else share


_preferred: dict[str, str] | None = None  # unit by quantity; None: not asked for yet


def use_units(units: str | Mapping[str, str] | None = None) -> None:
    """Show values in these units from now on, in this process.

    ``units`` are such as ``"angle=mrad, torque=mN m"``, or a mapping; "" is SI; None takes those of
    the user's settings. Raises `InputError` if a quantity or unit is unknown.
    """
    global _preferred
    _preferred = None if units is None else parse_units(units)
    preferred.cache_clear()


def parse_units(units: str | Mapping[str, str], what: str = "units") -> dict[str, str]:
    """Units by quantity, checked; raises as `use_units` does."""
    if isinstance(units, str):
        parts = [part.partition("=") for part in units.split(",") if part.strip()]
        if not all(sign for _, sign, _ in parts):
            example = 'such as "angle=mrad, torque=mN m"'
            raise InputError(f"{what} must be quantity=unit, {example}, received {units!r}.")
        units = {name: unit for name, _, unit in parts}
    found = {str(name).strip(): str(unit).strip() for name, unit in units.items()}
    for name, unit in found.items():
        if name not in QUANTITIES:
            known = ", ".join(QUANTITIES)
            raise InputError(f"{what} must name quantities of {known}; received {name!r}.")
        try:
            to_si(1.0, unit, QUANTITIES[name][0], name)
        except ParameterError as error:
            raise InputError(f"{what}: {error}") from None
    return found


def settings_file() -> Path:
    """Where a user's settings are kept; the file need not exist."""
    import typer  # knows the folder for settings on each system

    return Path(typer.get_app_dir("ematwin")) / "settings.toml"


def units_in_settings() -> dict[str, str]:
    """The units of the user's settings; empty without a file. Raises if it cannot be used."""
    path = settings_file()
    if not path.is_file():
        return {}
    try:
        table = tomllib.loads(path.read_text("utf-8")).get("units", {})
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise FileError(f"Cannot read the settings {path}: {reason}. Correct it.") from None
    if not isinstance(table, dict):
        raise InputError(f'{path} must hold a table [units]; write angle = "mrad" below it.')
    return parse_units(table, f"{path}, units")


@cache
def preferred(unit: str) -> tuple[str, float]:
    """The unit in which values in ``unit`` are shown, and the factor to it."""
    global _preferred
    if _preferred is None:
        _preferred = units_in_settings()
    for name, shown in _preferred.items():
        own = unit.replace(" ", "*")
        if own in QUANTITIES[name]:
            si = QUANTITIES[name][0]
            return shown, to_si(1.0, own, si, name) / to_si(1.0, shown, si, name)
    return unit, 1.0
