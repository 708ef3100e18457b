"""An FMU as an archive: what its modelDescription.xml says, and whether it can run here."""

import hashlib
import math
import zipfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ematwin.errors import FileError, MissingExtraError, ParameterError
from ematwin.quantities import QUANTITIES, base_units, spelled_out, to_si


class Unit(NamedTuple):
    """A unit of an FMU: SI = factor value + offset, and powers of the SI base units."""

    powers: dict[str, int]
    factor: float = 1.0
    offset: float = 0.0


class Variable(NamedTuple):
    """A scalar variable of an FMU; bounds and start are in its unit."""

    reference: int
    causality: str
    is_real: bool
    unit: str
    meaning: str
    lower: float
    upper: float
    start: float | None


class Archive(NamedTuple):
    """An FMU for co-simulation. Equal ``path`` and ``digest`` are equal archives."""

    path: Path
    digest: str
    is_2: bool
    guid: str
    identifier: str
    interpolates: bool
    step_size: float | None  # s, of its default experiment
    variables: dict[str, Variable]  # by name
    units: dict[str, Unit]


def archive_at(path: Path) -> Archive:
    """Read an FMU; `FileError` if it is none, or has no binary for this platform."""
    try:
        stat = path.stat()
    except OSError as error:
        raise FileError(f"Cannot read the FMU {path}: {error.strerror}.") from None
    return _read(path, stat.st_mtime_ns, stat.st_size)


@cache
def _read(path: Path, changed: int, size: int) -> Archive:
    try:
        from fmpy import platform, platform_tuple, read_model_description
    except ImportError:
        raise MissingExtraError("fmpy", "fmi", "An FMU as an actuator") from None
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
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
    experiment = found.defaultExperiment
    return Archive(
        path=path,
        digest=digest,
        is_2=found.fmiVersion == "2.0",
        guid=found.guid,
        identifier=found.coSimulation.modelIdentifier,
        interpolates=bool(found.coSimulation.canInterpolateInputs),
        step_size=_number(experiment.stepSize) if experiment else None,
        variables={one.name: _variable(one) for one in found.modelVariables},
        units={one.name: _unit(one.baseUnit) for one in found.unitDefinitions},
    )


def _number(text: Any, missing: Any = None) -> Any:
    try:
        return float(text)
    except (TypeError, ValueError):
        return missing


def _variable(given: Any) -> Variable:
    kind = given.declaredType
    return Variable(
        reference=given.valueReference,
        causality=given.causality or "local",
        is_real=given.type in ("Real", "Float64") and not given.dimensions,
        unit=given.unit or getattr(kind, "unit", None) or "",
        meaning=given.description or given.name,
        lower=_number(given.min or getattr(kind, "min", None), -math.inf),
        upper=_number(given.max or getattr(kind, "max", None), math.inf),
        start=_number(given.start),
    )


def _unit(base: Any) -> Unit:
    if base is None:
        return Unit({})
    powers = {x: int(getattr(base, x)) for x in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    powers = {name: power for name, power in powers.items() if power}
    return Unit(powers, float(base.factor), float(base.offset))


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


def scale_of(archive: Archive, variable: Variable, written: str | None, what: str) -> Scale:
    """How a variable is scaled; ``written`` is the unit that the TOML file gives, or None.

    A variable to which the FMU gives no unit is in the SI unit of ``written``. `ParameterError` if
    the FMU's unit measures something else, or there is no such unit.
    """
    known = archive.units.get(variable.unit)
    if known is None:
        return Scale(_si_unit(_powers(written or "", what), written))
    powers = known.powers if written is None else _powers(written, what)
    if {**powers, "rad": 0} != {**known.powers, "rad": 0}:  # exporters need not count the radian
        raise ParameterError(
            f"{what} must have a unit such as {variable.unit!r}, which the FMU gives it; "
            f"received {written!r}. Correct the unit."
        )
    return Scale(_si_unit(powers, written), known.factor, known.offset)


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
