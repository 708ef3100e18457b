"""An FMU as an archive: what it says of its variables, and whether it can run here."""

import hashlib
import zipfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ematwin.errors import FileError, MissingExtraError, ParameterError
from ematwin.quantities import QUANTITIES, base_units, spelled_out, to_si


class Archive(NamedTuple):
    """An FMU for co-simulation."""

    path: Path
    digest: str
    described: Any  # `fmpy.model_description.ModelDescription`
    variables: dict[str, Any]  # `fmpy.model_description.ModelVariable` by name


def archive_at(path: Path) -> Archive:
    """Read an FMU; `FileError` if it is none, or has no binary for this platform."""
    try:
        from fmpy import platform, platform_tuple, read_model_description
    except ImportError:
        raise MissingExtraError("fmpy", "fmi", "An FMU as an actuator") from None
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise FileError(f"Cannot read the FMU {path}: {error.strerror}.") from None
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        found = read_model_description(str(path), validate=False)
    except Exception as error:  # of zipfile, lxml, FMPy and the system
        raise FileError(
            f"{path} is no FMU that can be read ({str(error).splitlines()[0].rstrip('.')}); give "
            "one for co-simulation, FMI 2.0 or 3.0."
        ) from None
    if found.coSimulation is None or found.fmiVersion == "1.0":
        raise FileError(
            f"{path} is an FMU of FMI {found.fmiVersion} without co-simulation, which is needed; "
            "export it for co-simulation, FMI 2.0 or 3.0."
        )
    here = {name.split("/")[1] for name in names if name.startswith("binaries/") and "." in name}
    own = platform if found.fmiVersion == "2.0" else platform_tuple
    if own not in here:
        raise FileError(
            f"{path} runs on {', '.join(sorted(here)) or 'no platform (it has no binaries)'}, and "
            f"this is {own}; export it for this platform."
        )
    return Archive(path, digest, found, {one.name: one for one in found.modelVariables})


def stated(variable: Any, attribute: str) -> Any:
    """Unit or bound of a variable, of its type where it states none itself; else None."""
    return getattr(variable, attribute) or getattr(variable.declaredType, attribute, None)


class Scale(NamedTuple):
    """The SI unit of a quantity, and its variable's unit: SI = factor value + offset."""

    unit: str
    factor: float = 1.0
    offset: float = 0.0

    def to_si(self, value: Any) -> Any:
        """From the unit of the variable."""
        return self.factor * value + self.offset

    def from_si(self, value: Any) -> Any:
        """To the unit of the variable."""
        return (value - self.offset) / self.factor


def scale_of(archive: Archive, variable: Any, written: str | None, what: str) -> Scale:
    """How a variable is scaled; ``written`` is the unit that the TOML file gives, or None.

    A variable to which the FMU gives no unit is in the SI unit of ``written``. `ParameterError` if
    the FMU's unit measures something else, or there is no such unit.
    """
    unit = stated(variable, "unit")
    known = [one for one in archive.described.unitDefinitions if one.name == unit]
    if not known:
        return Scale(_si_unit(_powers(written or "", what), written))
    base = known[0].baseUnit
    own = {x: int(getattr(base, x, 0)) for x in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    own = {name: power for name, power in own.items() if power}
    powers = own if written is None else _powers(written, what)
    if {**powers, "rad": 0} != {**own, "rad": 0}:  # exporters need not count the radian
        raise ParameterError(
            f"{what} must have a unit such as {unit!r}, which the FMU gives it; received "
            f"{written!r}. Correct the unit."
        )
    scale = (1.0, 0.0) if base is None else (float(base.factor), float(base.offset))
    return Scale(_si_unit(powers, written), *scale)


def _powers(unit: str, what: str) -> dict[str, int]:
    try:
        return base_units(unit)
    except Exception:  # pint raises a family of unrelated types
        raise ParameterError(f"{what} has no unit that is known, received {unit!r}.") from None


@cache
def _usual() -> dict[tuple[tuple[str, int], ...], str]:
    """The usual SI units by their powers."""
    more = ("", "Hz", "K", "N*m/A", "N/A", "rad/s^2", "m/s^2", "N*m*s/rad", "N*s/m", "N/m")
    units = (*(shown[0] for shown in QUANTITIES.values()), *more)
    return {tuple(sorted(base_units(unit).items())): unit for unit in reversed(units)}


def _si_unit(powers: dict[str, int], written: str | None) -> str:
    """The SI unit for people: as written if it is one, else a usual one, else of base units."""
    key = tuple(sorted(powers.items()))
    base = "*".join(f"{name}^{power}" for name, power in key)
    with suppress(ParameterError):
        if written is not None and to_si(1.0, written, base, "it") == 1.0:
            return spelled_out(written)
    return _usual().get(key) or base


def number(text: Any, missing: Any = None) -> Any:
    """A number of a model description, which are texts."""
    try:
        return float(text)
    except (TypeError, ValueError):
        return missing
