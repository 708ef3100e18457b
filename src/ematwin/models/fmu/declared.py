"""What a TOML file says of an FMU: which of its variables are what, checked against the FMU."""

import difflib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ematwin.errors import FileError, ParameterError
from ematwin.models.fmu.archive import Archive, Scale, Variable, archive_at, scale_of
from ematwin.models.scenario import Finite, Hertz, Seconds
from ematwin.models.unknown import Unknown
from ematwin.quantities import parse_quantity, to_si
from ematwin.validation import all_at_once, findings

TABLES = ("fmu", "inputs", "outputs", "nominal", "faults", "nuisances")
ENTRY = ("value", "unit", "source", "tolerance")  # of a parameter in any parameter file
_FACTOR = 0.25, 4.0  # bounds of a fault that multiplies a parameter, unless it states others


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
    """A parameter; value, source and tolerance are those of any parameter file."""

    lower: Finite | None = None
    upper: Finite | None = None
    drift: float | str | None = None


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


class Wanted(NamedTuple):
    """A parameter in the FMU; bounds in SI."""

    variable: Variable
    scale: Scale
    lower: float
    upper: float


class Settable(NamedTuple):
    """A variable that a candidate sets, and how its unit is scaled."""

    name: str
    reference: int
    scale: Scale


def declared_in(table: Mapping[str, Any], what: str) -> Declared:
    """The tables of a parameter file; ``what`` is its path, or names it.

    Raises
    ------
    ParameterError
        If something is missing or not known; the message lists all that is to be corrected.
    """
    tables = {name: table[name] for name in TABLES if name in table}
    given = tables.get("nominal")
    if isinstance(given, dict):
        tables["nominal"] = {name: _own(entry) for name, entry in given.items()}
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
    twice = [name for name in named if named.count(name) > 1]
    if twice or {"time", "command", "load"} & {*found.outputs, *named}:
        raise ParameterError(
            f"{what}: faults and nuisances must have different names, and time, command and load "
            f"are no names for them or for outputs, received {', '.join([*found.outputs, *named])}."
        )
    file = Path(what).parent / found.fmu.file
    return found.model_copy(
        update={"fmu": found.fmu.model_copy(update={"file": str(file.absolute())})}
    )


def _own(entry: Any) -> Any:
    """An entry of a parameter without what every parameter file has; the unit is needed twice."""
    if not isinstance(entry, dict):
        return entry
    return {k: one for k, one in entry.items() if k == "unit" or k not in ENTRY}


class Described:
    """The declared variables as the FMU has them: references, scales, bounds.

    Attributes
    ----------
    archive : Archive
    channels : by name, the variable with its scale, inputs first
    starts : by output, the variable that sets its first value
    parameters : by name
    unknowns : faults and nuisances
    settings : by name of the parameter or unknown
    factors : of each parameter, the faults that multiply it
    """

    def __init__(self, declared: Declared, what: str) -> None:
        self.declared, self._what = declared, what
        self.archive: Archive = archive_at(Path(declared.fmu.file))
        if declared.fmu.sha256 not in (None, self.archive.digest):
            raise FileError(
                f"{self.archive.path} is not the FMU for which {what} was written: it has changed "
                "since. Calibrate anew, or remove sha256 from the file."
            )
        self._variables = dict(self.archive.variables)
        self._used: dict[str, str] = {}
        self.channels: dict[str, tuple[Variable, Scale]] = {}
        for name, one in declared.inputs:
            if one is not None:
                causes = ("input", "independent") if name == "command" else ("input",)
                self.channels[name] = self._found(one, f"inputs.{name}", causes)
        self.starts: dict[str, Settable] = {}
        for name, output in declared.outputs.items():
            place = f"outputs.{name}"
            self.channels[name] = self._found(output, place, ("output", "local"))
            if output.start is not None:
                signal = Signal(variable=output.start, unit=output.unit)
                found = self._found(signal, f"{place}.start", ("parameter", "output", "local"), 1)
                self.starts[name] = Settable(output.start, found[0].reference, found[1])
        self.settings: dict[str, Settable] = {}
        self.parameters: dict[str, Wanted] = {}
        for name, parameter in declared.nominal.items():
            place = f"nominal.{name}"
            variable, scale = self._found(parameter, place, ("parameter", "input"))
            self.settings[place] = Settable(parameter.variable, variable.reference, scale)
            lower, upper = self._bounds(parameter, variable, scale, place)
            self.parameters[name] = Wanted(variable, scale, lower, upper)
        self.factors: dict[str, list[str]] = {name: [] for name in declared.nominal}
        self.unknowns = tuple(
            self._unknown(name, one, role)
            for role, group in (("fault", declared.faults), ("nuisance", declared.nuisances))
            for name, one in group.items()
        )

    def noise(self, name: str) -> float | None:
        """Standard deviation of an output's sensor, SI; None where the file gives none."""
        given, scale = self.declared.outputs[name].noise, self.channels[name][1]
        if given is None or isinstance(given, int | float):
            return given
        return parse_quantity(given, scale.unit, f"{self._what}: noise of {name}")

    def _found(
        self, one: Signal, place: str, causes: tuple[str, ...], shared: int = 0
    ) -> tuple[Variable, Scale]:
        """A variable of the FMU and its scale."""
        what = f"{self._what}: {place}"
        found = self._variables.get(one.variable)
        if found is None:
            close = difflib.get_close_matches(one.variable, self._variables, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise ParameterError(
                f"{what} names a variable {one.variable!r}, which {self.archive.path.name} does "
                f"not have.{hint}"
            )
        if found.causality not in causes or not found.is_real:
            raise ParameterError(
                f"{what} must be a real {' or '.join(causes)} of the FMU, and {one.variable} is "
                f"{'a' if found.is_real else 'no real'} {found.causality}; name another variable."
            )
        if not shared and self._used.setdefault(one.variable, place) != place:
            raise ParameterError(
                f"{what} and {self._used[one.variable]} are one variable, {one.variable}; a fault "
                'that changes a parameter is stated by times = "parameter".'
            )
        return found, scale_of(self.archive, found, one.unit, what)

    def _bounds(self, one: Any, variable: Variable, scale: Scale, place: str) -> list[float]:
        """Bounds of a parameter or unknown, SI; those of the FMU if the file gives none."""
        found = []
        for side, least in (("lower", variable.lower), ("upper", variable.upper)):
            own = getattr(one, side)
            limit = scale.to_si(least)
            value = limit if own is None else to_si(own, one.unit or scale.unit, scale.unit, place)
            slack = 1e-9 * abs(limit)  # units are converted
            beyond = value < limit - slack if side == "lower" else value > limit + slack
            if beyond:
                raise ParameterError(
                    f"{self._what}: the {side} bound of {place} is {value:g} {scale.unit} and the "
                    f"FMU allows {limit:g} {scale.unit}; bring it within."
                )
            found.append(value)
        return found

    def _unknown(self, name: str, one: Free, role: Any) -> Unknown:
        place = f"{role}s.{name}"
        if (one.variable is None) == (one.times is None):
            raise ParameterError(
                f'{self._what}: {place} needs either variable = "..." of the FMU or times = "..." '
                "of a parameter; give one of them."
            )
        if one.times is not None:
            if one.times not in self.factors or one.unit:
                raise ParameterError(
                    f"{self._what}: {place} must multiply one of the parameters "
                    f"{', '.join(self.factors)} and has no unit, received {one.times!r} and "
                    f"{one.unit or ''!r}."
                )
            self.factors[one.times].append(name)
            scale = self.parameters[one.times].scale
            lower, upper = (
                usual if own is None else own
                for usual, own in zip(_FACTOR, (one.lower, one.upper), strict=True)
            )
            healthy = 1.0 if one.healthy is None else one.healthy
            return Unknown(
                name, "", one.meaning or f"factor on {one.times}", healthy, lower, upper, role,
                spread=one.spread, logarithmic=one.logarithmic is not False,
                physical_unit=scale.unit,
                physical=_Times(one.times),
            )  # fmt: skip
        assert one.variable is not None
        signal = Signal(variable=one.variable, unit=one.unit)
        variable, scale = self._found(signal, place, ("parameter", "input"))
        lower, upper = self._bounds(one, variable, scale, place)
        unit = one.unit or scale.unit
        start = scale.from_si(0.0) if variable.start is None else variable.start
        healthy = (
            scale.to_si(start) if one.healthy is None
            else to_si(one.healthy, unit, scale.unit, place)
        )  # fmt: skip
        if not (lower < upper and abs(lower) < float("inf") and abs(upper) < float("inf")):
            raise ParameterError(
                f"{self._what}: {place} needs a finite range, and the FMU gives "
                f"[{lower:g}, {upper:g}] {scale.unit}; state lower and upper."
            )
        self.settings[name] = Settable(one.variable, variable.reference, scale)
        return Unknown(
            name, scale.unit, one.meaning or variable.meaning, healthy, lower, upper, role,
            spread=None if one.spread is None else to_si(one.spread, unit, scale.unit, place),
            logarithmic=bool(one.logarithmic),
        )  # fmt: skip


@dataclass(frozen=True)
class _Times:
    """A factor on a parameter as the parameter's value; it travels between processes."""

    parameter: str

    def __call__(self, actuator: Any, factor: Any) -> Any:
        return factor * actuator.value(f"nominal.{self.parameter}")


def as_text(declared: Declared, without: tuple[str, ...] = ()) -> str:
    """The tables as JSON, equal for equal ones; ``without`` some entries of ``fmu``."""
    table = declared.model_dump(exclude_none=True, exclude={"fmu": set(without)})
    return json.dumps(table, sort_keys=True)
