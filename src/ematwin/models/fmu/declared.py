"""Declaration of an FMU's variables in a TOML file, checked against the FMU."""

import difflib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ematwin.errors import FileError, ParameterError
from ematwin.models.fmu.archive import Archive, Scale, Variable, archive_at, scale_of
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

    def as_text(self) -> str:
        """The tables as JSON, equal for equal ones."""
        return json.dumps(self.model_dump(exclude_none=True), sort_keys=True)

    def simulated(self) -> str:
        """What of them a simulation depends on, as JSON."""
        left_out: Any = {
            "fmu": {"file", "sha256", "time_limit"},
            "nominal": {"__all__": {"unit", "lower", "upper", "drift"}},
        }
        return json.dumps(self.model_dump(exclude_none=True, exclude=left_out), sort_keys=True)


class Used(NamedTuple):
    """A variable of the FMU that the file names, and how its unit is scaled."""

    name: str
    variable: Variable
    scale: Scale


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


class Described:
    """The declared variables as the FMU has them: references, scales, bounds."""

    def __init__(self, declared: Declared, what: str) -> None:
        self._what = what
        self.archive: Archive = archive_at(Path(declared.fmu.file))
        if declared.fmu.sha256 not in (None, self.archive.digest):
            raise FileError(
                f"{self.archive.path} is not the FMU for which {what} was written: it has changed "
                "since. Calibrate anew, or remove sha256 from the file."
            )
        self._places: dict[str, str] = {}  # by variable
        self.channels: dict[str, Used] = {}  # inputs first
        for name, one in declared.inputs:
            if one is not None:
                causes = ("input", "independent") if name == "command" else ("input",)
                self.channels[name] = self._found(one, f"inputs.{name}", causes)
        self.starts: dict[str, Used] = {}  # by output, what sets its first value
        self.noise: dict[str, float] = {}  # by output, standard deviation of its sensor, SI
        for name, output in declared.outputs.items():
            place = f"outputs.{name}"
            self.channels[name] = self._found(output, place, ("output", "local"))
            if output.start is not None:
                self.starts[name] = self._found(
                    Signal(variable=output.start), f"{place}.start",
                    ("parameter", "output", "local"), shared=True,
                )  # fmt: skip
            if output.noise is not None:
                unit = self.channels[name].scale.unit
                self.noise[name] = _deviation(output.noise, unit, f"{what}: {place}.noise")
        # by place of a parameter or name of an unknown, the variables that a candidate sets
        self.settings: dict[str, Used] = {}
        self.bounds: dict[str, tuple[float, float]] = {}  # of each parameter, SI
        for name, parameter in declared.nominal.items():
            place = f"nominal.{name}"
            self.settings[place] = self._found(parameter, place, ("parameter", "input"))
            self.bounds[name] = self._bounds(parameter, self.settings[place], place)
        # of each parameter, the faults that multiply it
        self.factors: dict[str, list[str]] = {name: [] for name in declared.nominal}
        self.unknowns = tuple(
            (self._variable if free.times is None else self._factor)(name, free, role)
            for role, group in (("fault", declared.faults), ("nuisance", declared.nuisances))
            for name, free in group.items()
        )

    def _found(
        self, one: Signal, place: str, causes: tuple[str, ...], shared: bool = False
    ) -> Used:
        """A variable of the FMU and its scale."""
        what = f"{self._what}: {place}"
        found = self.archive.variables.get(one.variable)
        if found is None:
            close = difflib.get_close_matches(one.variable, self.archive.variables, n=1)
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
        if not shared and self._places.setdefault(one.variable, place) != place:
            raise ParameterError(
                f"{what} and {self._places[one.variable]} are one variable, {one.variable}; a "
                'fault that changes a parameter is stated by times = "parameter".'
            )
        return Used(one.variable, found, scale_of(self.archive, found, one.unit, what))

    def _bounds(self, one: Any, used: Used, place: str) -> tuple[float, float]:
        """Bounds of a parameter or unknown, SI; from the FMU if the file gives none."""
        (_, variable, scale), found = used, []
        for side, sign in (("lower", -1.0), ("upper", 1.0)):
            own, limit = getattr(one, side), scale.to_si(getattr(variable, side))
            value = limit if own is None else to_si(own, one.unit or scale.unit, scale.unit, place)
            if sign * (value - limit) > 1e-9 * abs(limit):  # units are converted
                raise ParameterError(
                    f"{self._what}: the {side} bound of {place} is "
                    f"{in_unit(f'{value:g}', scale.unit)} and the FMU allows "
                    f"{in_unit(f'{limit:g}', scale.unit)}; bring it within."
                )
            found.append(value)
        return found[0], found[1]

    def _factor(self, name: str, one: Free, role: Any) -> Unknown:
        """A factor on a parameter."""
        if one.times not in self.factors or one.unit or one.variable:
            raise ParameterError(
                f"{self._what}: {role}s.{name} must multiply one of the parameters "
                f"{', '.join(self.factors)}, and has no unit and no variable; correct it."
            )
        self.factors[one.times].append(name)
        return Unknown(
            name, "", one.meaning or f"factor on {one.times}",
            1.0 if one.healthy is None else one.healthy, 0.25 if one.lower is None else one.lower,
            4.0 if one.upper is None else one.upper, role, spread=one.spread,
            logarithmic=one.logarithmic is not False,
            physical_unit=self.settings[f"nominal.{one.times}"].scale.unit,
            physical=Times(f"nominal.{one.times}"),
        )  # fmt: skip

    def _variable(self, name: str, one: Free, role: Any) -> Unknown:
        """A variable of the FMU."""
        place = f"{role}s.{name}"
        if one.variable is None:
            raise ParameterError(
                f'{self._what}: {place} needs variable = "..." of the FMU, or times = "..." of a '
                "parameter; give one of them."
            )
        signal = Signal(variable=one.variable, unit=one.unit)
        used = self.settings[name] = self._found(signal, place, ("parameter", "input"))
        variable, scale = used.variable, used.scale
        lower, upper = self._bounds(one, used, place)
        if not (lower < upper and math.isfinite(upper - lower)):
            raise ParameterError(
                f"{self._what}: {place} needs a finite range, received [{lower:g}, {upper:g}] "
                f"{scale.unit}; state lower and upper."
            )
        if one.healthy is not None:
            healthy = to_si(one.healthy, one.unit or scale.unit, scale.unit, place)
        else:
            healthy = 0.0 if variable.start is None else scale.to_si(variable.start)
        spread = None
        if one.spread is not None:
            spread = _deviation(f"{one.spread} {one.unit or scale.unit}", scale.unit, place)
        return Unknown(
            name, scale.unit, one.meaning or variable.meaning, healthy, lower, upper, role,
            spread=spread, logarithmic=bool(one.logarithmic),
        )  # fmt: skip


def _deviation(given: float | str, unit: str, what: str) -> float:
    """A standard deviation in SI, of whichever unit: 1 degC is 1 K."""
    if isinstance(given, str):
        own = given.strip().partition(" ")[2]
        given = parse_quantity(given, unit, what) - parse_quantity(f"0 {own}", unit, what)
    if not given > 0.0:
        raise ParameterError(f"{what} must be a positive deviation, received {given:g}.")
    return given
