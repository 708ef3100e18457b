"""Declaration of an FMU's variables in a TOML file, checked against the FMU."""

import difflib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ematwin.errors import ParameterError
from ematwin.models.fmu.archive import Archive, Scale, number, scale_of, stated
from ematwin.models.scenario import Finite, Hertz, Seconds
from ematwin.models.unknown import Times, Unknown
from ematwin.quantities import parse_quantity, to_si
from ematwin.showing.text import in_unit
from ematwin.validation import all_at_once, findings

TABLES = ("fmu", "inputs", "outputs", "nominal", "faults", "nuisances")
ENTRY = ("value", "unit", "source", "tolerance")  # of a parameter in any parameter file


class Table(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Fmu(Table):
    """The archive, and how it is run."""

    file: str  # absolute, or from the folder of the TOML file
    sha256: str | None = None
    step: Seconds | None = Field(None, gt=0)  # longest communication step
    sample_rate: Hertz | None = Field(None, gt=0)  # of simulations
    time_limit: Seconds = Field(60.0, gt=0)  # of one run


class Signal(Table):
    """An input or output, or a parameter."""

    variable: str
    unit: str | None = None
    meaning: str | None = None


class Output(Signal):
    """An output: standard deviation of its sensor, and what sets its first value."""

    noise: float | str | None = None
    start: str | None = None


class Inputs(Table):
    """What drives the FMU."""

    command: Signal
    load: Signal | None = None


class Parameter(Signal):
    """A parameter; value, source and tolerance as in any parameter file."""

    lower: Finite | None = None
    upper: Finite | None = None
    drift: float | str | None = None
    # what every parameter file has (`ENTRY`)
    value: Any = Field(None, exclude=True)
    source: Any = Field(None, exclude=True)
    tolerance: Any = Field(None, exclude=True)


class Free(Table):
    """A fault or nuisance: a variable, or a factor on a parameter (``times``)."""

    variable: str | None = None
    times: str | None = None
    unit: str | None = None
    meaning: str | None = None
    healthy: Finite | None = None
    lower: Finite | None = None
    upper: Finite | None = None
    logarithmic: bool | None = None
    spread: Finite | None = None


class Declared(Table):
    """All tables; paths are absolute."""

    fmu: Fmu
    inputs: Inputs
    outputs: dict[str, Output] = Field(min_length=1)
    nominal: dict[str, Parameter] = Field(min_length=1)
    faults: dict[str, Free] = Field(min_length=1)
    nuisances: dict[str, Free] = {}

    def as_text(self, **left_out: Any) -> str:
        """The tables as JSON, equal for equal ones."""
        return json.dumps(self.model_dump(exclude_none=True, exclude=left_out), sort_keys=True)

    def simulated(self) -> str:
        """What of them a simulation depends on, as JSON."""
        return self.as_text(
            fmu={"file", "sha256", "time_limit"},
            nominal={"__all__": {"unit", "lower", "upper", "drift"}},
        )

    def named(self) -> Iterator[tuple[str, Any, tuple[str, ...]]]:
        """Place of each variable, its entry, and the causality that it may have."""
        yield "inputs.command", self.inputs.command, ("input", "independent")
        if self.inputs.load is not None:
            yield "inputs.load", self.inputs.load, ("input",)
        for name, output in self.outputs.items():
            yield f"outputs.{name}", output, ("output", "local")
            if output.start is not None:
                start = Signal(variable=output.start)
                yield f"outputs.{name}.start", start, ("parameter", "output", "local")
        tables: Any = {"nominal": self.nominal, "faults": self.faults, "nuisances": self.nuisances}
        for table, entries in tables.items():
            for name, entry in entries.items():
                if entry.variable is not None:
                    yield f"{table}.{name}", entry, ("parameter", "input")


def declared_in(table: Mapping[str, Any], what: str) -> Declared:
    """The tables of a parameter file; ``what`` is its path, or names it."""
    tables = {name: table[name] for name in TABLES if name in table}
    try:
        found = Declared.model_validate(tables)
    except ValidationError as error:
        raise all_at_once([text for _, text in findings(error, what)], what) from None
    named = [*found.faults, *found.nuisances]
    for name in [*found.outputs, *found.nominal, *named]:
        if not name.isidentifier():
            raise ParameterError(
                f"{what}: {name!r} must be a name of letters, digits and underscores; correct it."
            )
    if len({*named}) < len(named) or {"time", "command", "load"} & {*found.outputs, *named}:
        raise ParameterError(
            f"{what}: faults and nuisances must have different names, and time, command and load "
            f"are no names for them or for outputs, received {', '.join([*found.outputs, *named])}."
        )
    file = (Path(what).parent / found.fmu.file).absolute()
    return found.model_copy(update={"fmu": found.fmu.model_copy(update={"file": str(file)})})


class Used(NamedTuple):
    """A variable of the FMU that the file names, how its unit is scaled, and bounds, SI."""

    variable: Any  # of FMPy
    scale: Scale
    meaning: str
    lower: float
    upper: float


def used_by(declared: Declared, archive: Archive, what: str) -> dict[str, Used]:
    """The variables that a file names, by their place in it.

    `ParameterError` if the FMU has no such variable, or its unit or bounds are others.
    """
    found: dict[str, Used] = {}
    places: dict[str, str] = {}  # by variable
    for place, entry, causes in declared.named():
        name = entry.variable
        variable = archive.variables.get(name)
        if variable is None:
            close = difflib.get_close_matches(name, archive.variables, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise ParameterError(
                f"{what}: {place} names a variable {name!r}, which {archive.path.name} does not "
                f"have.{hint}"
            )
        is_real = variable.type in ("Real", "Float64") and not variable.dimensions
        causality = variable.causality or "local"
        if causality not in causes or not is_real:
            raise ParameterError(
                f"{what}: {place} must be a real {' or '.join(causes)} of the FMU, and {name} is "
                f"{'a' if is_real else 'no real'} {causality}; name another variable."
            )
        if not place.endswith(".start") and places.setdefault(name, place) != place:
            raise ParameterError(
                f"{what}: {place} and {places[name]} are one variable, {name}; a fault that "
                'changes a parameter is stated by times = "parameter".'
            )
        scale = scale_of(archive, variable, entry.unit, f"{what}: {place}")
        bounds = _bounds(entry, variable, scale, place, what)
        meaning = entry.meaning or variable.description or name
        found[place] = Used(variable, scale, meaning, *bounds)
    return found


def _bounds(entry: Any, variable: Any, scale: Scale, place: str, what: str) -> tuple[float, float]:
    """Bounds of an entry, SI: those of the FMU's variable if it gives none."""
    found, si_unit = [], scale.unit
    for side, named, sign in (("lower", "min", -1.0), ("upper", "max", 1.0)):
        limit = scale.to_si(number(stated(variable, named), sign * math.inf))
        own = getattr(entry, side, None)
        value = limit if own is None else to_si(own, entry.unit or si_unit, si_unit, place)
        if sign * (value - limit) > 1e-9 * abs(limit):  # units are converted
            raise ParameterError(
                f"{what}: the {side} bound of {place} is {in_unit(f'{value:g}', si_unit)} and the "
                f"FMU allows {in_unit(f'{limit:g}', si_unit)}; bring it within."
            )
        found.append(value)
    return found[0], found[1]


def unknowns_of(declared: Declared, used: Mapping[str, Used], what: str) -> tuple[Unknown, ...]:
    """Faults and nuisances of a file, in its order."""
    found = []
    for role, entries in (("fault", declared.faults), ("nuisance", declared.nuisances)):
        for name, entry in entries.items():
            place = f"{role}s.{name}"
            if entry.times is not None:
                found.append(_factor(name, entry, role, declared, used, f"{what}: {place}"))
            elif entry.variable is not None:
                found.append(_variable(name, entry, role, used[place], f"{what}: {place}"))
            else:
                raise ParameterError(
                    f'{what}: {place} needs variable = "..." of the FMU, or times = "..." of a '
                    "parameter; give one of them."
                )
    return tuple(found)


def _factor(
    name: str, one: Free, role: Any, declared: Declared, used: Mapping[str, Used], what: str
) -> Unknown:
    if one.times not in declared.nominal or one.unit or one.variable:
        raise ParameterError(
            f"{what} must multiply one of the parameters {', '.join(declared.nominal)}, and has no "
            "unit and no variable; correct it."
        )
    place = f"nominal.{one.times}"
    healthy, lower, upper = (
        usual if value is None else value
        for value, usual in ((one.healthy, 1.0), (one.lower, 0.25), (one.upper, 4.0))
    )
    return Unknown(
        name, "", one.meaning or f"factor on {one.times}", healthy, lower, upper, role,
        spread=one.spread, logarithmic=one.logarithmic is not False,
        physical_unit=used[place].scale.unit, physical=Times(place),
    )  # fmt: skip


def _variable(name: str, one: Free, role: Any, used: Used, what: str) -> Unknown:
    _, scale, meaning, lower, upper = used
    own = one.unit or scale.unit
    if not (lower < upper and math.isfinite(upper - lower)):
        raise ParameterError(
            f"{what} needs a finite range, received [{lower:g}, {upper:g}] {scale.unit}; state "
            "lower and upper."
        )
    if one.healthy is not None:
        healthy = to_si(one.healthy, own, scale.unit, what)
    else:
        start = number(used.variable.start)
        healthy = 0.0 if start is None else scale.to_si(start)
    spread = None if one.spread is None else deviation(f"{one.spread} {own}", scale.unit, what)
    return Unknown(
        name, scale.unit, meaning, healthy, lower, upper, role, spread=spread,
        logarithmic=bool(one.logarithmic),
    )  # fmt: skip


def deviation(given: float | str, unit: str, what: str) -> float:
    """A standard deviation in SI, of whichever unit: 1 degC is 1 K."""
    if isinstance(given, str):
        own = given.strip().partition(" ")[2]
        given = parse_quantity(given, unit, what) - parse_quantity(f"0 {own}", unit, what)
    if not given > 0.0:
        raise ParameterError(f"{what} must be a positive deviation, received {given:g}.")
    return given
