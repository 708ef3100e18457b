"""Scenarios: what an actuator is asked to do, as a command and a load over time.

A history is the sum of its components. In a TOML file a value is a number in SI or a string with
a unit; from Python the same components are objects:

    Scenario(duration=0.5, command=[Chirp(amplitude=0.005, f_start=5, f_end=25)],
             load=[Step(value=10, time=0.25)])
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from ematwin.errors import ParameterError
from ematwin.models.parameter_set import folder_of
from ematwin.models.recorded import recorded_columns
from ematwin.quantities import parse_quantity
from ematwin.validation import load_toml, one_sentence

DEFAULT_SCENARIO = "default"
Units = tuple[str, str]  # of command and load; "" where there is no load
ROTARY: Units = ("rad", "N*m")
_TIMES = ("time", "start", "stop", "duration")  # of components
KINDS_OF_HISTORY = ("rad", "N*m", "m", "N", "rad/s", "m/s", "V", "A")  # of a recorded column


def _unit(si_unit: str) -> Any:
    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return parse_quantity(value, si_unit, "it")
        except ParameterError as error:
            raise ValueError(str(error)) from None

    return BeforeValidator(convert)


Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, _unit("s"), Field(allow_inf_nan=False)]
Hertz = Annotated[float, _unit("Hz"), Field(allow_inf_nan=False, ge=0)]


class Component(BaseModel):
    """A part of a history. Amplitudes are in SI: rad for the command of a rotary actuator.

    ``designed`` says which of its numbers a design may choose, and what each is: a "size" or "rate"
    of the history, which has a sign; an "amplitude", which has none; a "frequency"; a "time"; or a
    "phase".
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    designed: ClassVar[Mapping[str, str]] = {}

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise one_sentence(error, type(self).__name__.lower()) from None

    def within(self, duration: float) -> Self:
        """The component as it is in a scenario of this duration, s."""
        return self

    def stretched(self, factor: float) -> Self:
        """The component with all its times multiplied by a factor; frequencies stay."""
        times = {name: value for name, value in self if name in _TIMES and value is not None}
        return self.model_copy(update={name: factor * value for name, value in times.items()})

    def at(self, time: np.ndarray) -> np.ndarray:
        """Values at times (s) from the start of the scenario."""
        raise NotImplementedError(f"{type(self).__name__} does not say what it is over time")


class Step(Component):
    """Zero until ``time``, then ``value``."""

    type: Literal["step"] = "step"
    value: Finite
    time: Seconds = 0.0
    designed: ClassVar[Mapping[str, str]] = {"value": "size", "time": "time"}

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        return np.where(time >= self.time, self.value, 0.0)


class Ramp(Component):
    """Zero until ``start``, then ``rate`` per second until ``stop``, then held."""

    type: Literal["ramp"] = "ramp"
    rate: Finite
    start: Seconds = 0.0
    stop: Seconds | None = None
    designed: ClassVar[Mapping[str, str]] = {"rate": "rate", "start": "time", "stop": "time"}

    def stretched(self, factor: float) -> Self:  # noqa: D102
        return super().stretched(factor).model_copy(update={"rate": self.rate / factor})

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        stop = np.inf if self.stop is None else self.stop
        return self.rate * (np.clip(time, self.start, stop) - self.start)


class Sine(Component):
    """``amplitude sin(2 pi frequency (t - start) + phase)`` from ``start`` on; phase in rad."""

    type: Literal["sine"] = "sine"
    amplitude: Finite
    frequency: Hertz
    phase: Finite = 0.0
    start: Seconds = 0.0
    designed: ClassVar[Mapping[str, str]] = {
        "amplitude": "amplitude", "frequency": "frequency", "phase": "phase",
    }  # fmt: skip

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        wave = np.sin(2.0 * np.pi * self.frequency * (time - self.start) + self.phase)
        return np.where(time >= self.start, self.amplitude * wave, 0.0)


class Chirp(Component):
    """A sine whose frequency runs linearly from ``f_start`` to ``f_end`` within ``duration``.

    It ends with the scenario if no duration is given, and keeps its last value if it ends before.
    """

    type: Literal["chirp"] = "chirp"
    amplitude: Finite
    f_start: Hertz
    f_end: Hertz
    start: Seconds = 0.0
    duration: Annotated[float, _unit("s"), Field(gt=0, allow_inf_nan=False)] | None = None
    designed: ClassVar[Mapping[str, str]] = {
        "amplitude": "amplitude", "f_start": "frequency", "f_end": "frequency",
    }  # fmt: skip

    def within(self, duration: float) -> Self:  # noqa: D102
        if self.duration is not None:
            return self
        if self.start >= duration:
            raise ValueError(
                f"a chirp starts at {self.start:g} s, but the scenario ends at {duration:g} s; "
                "start it earlier"
            )
        return self.model_copy(update={"duration": duration - self.start})

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        span = float(time[-1]) - self.start if self.duration is None else self.duration
        since = np.clip(time - self.start, 0.0, span)
        # not scipy.signal.chirp: importing that takes longer than a simulation
        turns = (self.f_start + 0.5 * (self.f_end - self.f_start) * since / span) * since
        return self.amplitude * np.sin(2.0 * np.pi * turns)


class Profile(Component):
    """Straight lines through ``(time, value)`` points, from a list or a recorded file.

    ``file`` is a recorded file (CSV, Parquet) with a column ``time`` and the column named by
    ``column``, both in SI unless their name or the file gives a unit, as in ``command [deg]``.
    """

    type: Literal["profile"] = "profile"
    time: list[float] | None = None
    value: list[float] | None = None
    file: Path | None = None
    column: str | None = None
    designed: ClassVar[Mapping[str, str]] = {"value": "size"}

    def stretched(self, factor: float) -> Self:  # noqa: D102
        if self.time is None:
            raise ValueError(
                "a profile from a file has the times of the file; give time and value instead"
            )
        return self.model_copy(update={"time": [factor * t for t in self.time]})

    @model_validator(mode="after")
    def _has_one_source(self) -> Self:
        given = sorted(name for name, value in self if value is not None and name != "type")
        if given not in (["time", "value"], ["column", "file"]):
            raise ValueError(
                "it needs either time and value, or file and column, received "
                f"{', '.join(given) or 'neither'}; give one of the two"
            )
        if self.time is not None and self.value is not None:
            check_profile(np.asarray(self.time), np.asarray(self.value))
        return self

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        if self.time is not None:
            return np.interp(time, self.time, np.asarray(self.value, dtype=float))
        assert self.file is not None
        assert self.column is not None
        columns = recorded_columns(
            self.file, {"time": ("s",), self.column: KINDS_OF_HISTORY}, optional={}
        )
        since, value = columns["time"] - columns["time"][0], columns[self.column]
        check_profile(since, value)
        return np.interp(time, since, value)


def check_profile(time: np.ndarray, value: np.ndarray) -> None:
    """Raise ValueError unless time increases, all is finite, and both are equally long."""
    if time.size != value.size or time.size < 2:
        raise ValueError(
            f"it needs as many times as values and at least two, received {time.size} and "
            f"{value.size}; complete it"
        )
    if not (np.isfinite(time).all() and np.isfinite(value).all()):
        raise ValueError("it holds NaN or infinite values; remove them")
    falls = np.flatnonzero(np.diff(time) <= 0.0)
    if falls.size:
        n = int(falls[0])
        raise ValueError(
            f"time must increase: point {n + 1} ({time[n + 1]:g} s) follows {time[n]:g} s; sort it"
        )


History = list[Annotated[Step | Ramp | Sine | Chirp | Profile, Field(discriminator="type")]]


class Scenario(BaseModel):
    """Command and load over time, SI; rad and N m on the output for a rotary actuator."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    name: str = "scenario"
    description: str = ""
    duration: Annotated[float, _unit("s"), Field(gt=0, allow_inf_nan=False)]
    command: History = Field(min_length=1)
    load: History = []

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise one_sentence(error, f"scenario {values.get('name', '')}".rstrip()) from None

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        for part in (*self.command, *self.load):
            part.within(self.duration)
        return self

    @classmethod
    def load_file(
        cls,
        name_or_path: "str | Path | Scenario | None" = None,
        shipped: Mapping[str, Path] | None = None,
        units: Units = ROTARY,
    ) -> "Scenario":
        """A shipped scenario by name, a TOML file, or a recorded CSV or Parquet file.

        ``shipped`` are the scenarios of a kind of actuator, the first its default, and ``units``
        the SI units of its command and load; rad and N m if not given
        (`ematwin.models.base.Model.load_scenario` gives both).

        A recorded file needs columns ``time`` and ``command``, and may have ``load``; their names
        or the file may give units, as in ``command [deg]``.

        Raises
        ------
        ParameterError
            If there is no such scenario, or it is impossible or incomplete.
        FileError
            If the file cannot be read.
        """
        if isinstance(name_or_path, Scenario):
            return name_or_path
        shipped = shipped_scenarios() if shipped is None else shipped
        if name_or_path is None:
            if not shipped:
                raise ParameterError(
                    "This kind of actuator comes with no scenario; give one, or put one into the "
                    "folder scenarios beside its model."
                )
            name_or_path = DEFAULT_SCENARIO if DEFAULT_SCENARIO in shipped else next(iter(shipped))
        if not isinstance(name_or_path, str | Path):
            raise ParameterError(
                "A scenario is a Scenario, the name of a shipped one, or the path of a file; "
                f"received {type(name_or_path).__name__}."
            )
        path, (unit, load_unit) = Path(name_or_path), units
        if path.suffix and path.suffix != ".toml":
            load = {"load": (load_unit,)} if load_unit else {}
            columns = recorded_columns(path, {"time": ("s",), "command": (unit,)}, load)
            try:
                return cls.from_columns(
                    columns["time"], columns["command"], columns.get("load"), name=path.stem
                )
            except ParameterError as error:
                raise ParameterError(f"{path}: {error}") from None
        if not path.suffix:
            if str(name_or_path) not in shipped:
                raise ParameterError(
                    f"There is no scenario {str(name_or_path)!r}. Shipped: {', '.join(shipped)}; "
                    "or give the path of a TOML, CSV or Parquet file."
                )
            path = shipped[str(name_or_path)]
        table = load_toml(path, "scenario")
        name = table.setdefault("name", path.stem)
        return cls(**_units_resolved(table, path.parent, f"scenario {name}", units))

    @classmethod
    def from_columns(
        cls,
        time: np.ndarray,
        command: np.ndarray,
        load: np.ndarray | None = None,
        name: str = "recorded",
    ) -> "Scenario":
        """A scenario from recorded columns: time (s), command (rad) and load (N m).

        Raises
        ------
        ParameterError
            If time does not increase, a value is not finite, or lengths differ.
        """
        time = np.asarray(time, dtype=float)
        start = (time - time[:1]).tolist()
        histories: dict[str, Any] = {
            "command": [Profile(time=start, value=np.asarray(command, dtype=float).tolist())]
        }
        if load is not None:
            histories["load"] = [Profile(time=start, value=np.asarray(load, dtype=float).tolist())]
        return cls(name=name, duration=start[-1], **histories)

    def lasting(self, duration: float) -> "Scenario":
        """The scenario in another duration, s: times in proportion, frequencies as they are.

        Raises
        ------
        ParameterError
            If its times come from a file.
        """
        if duration == self.duration:
            return self
        factor = duration / self.duration
        try:
            command, load = (
                [part.stretched(factor) for part in parts] for parts in (self.command, self.load)
            )
        except ValueError as error:
            raise ParameterError(f"scenario {self.name}: {error}.") from None
        return Scenario(
            name=self.name, description=self.description, duration=duration, command=command,
            load=load,
        )  # fmt: skip

    def save(self, path: str | Path) -> None:
        """Write a TOML file, whole or not at all; numbers are in SI.

        Raises
        ------
        InputError
            If the name has another ending than .toml.
        FileError
            If it cannot be written.
        """
        import tomli_w

        from ematwin.files import check_target, write_text

        check_target(Path(path), (".toml",))
        table = self.model_dump(mode="json", exclude_none=True)
        if not table["load"]:
            del table["load"]
        write_text(path, tomli_w.dumps(table))

    def histories(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Command (rad) and load (N m) at times (s) from the start."""
        try:
            command, load = (
                sum((part.within(self.duration).at(time) for part in parts), np.zeros(time.shape))
                for parts in (self.command, self.load)
            )
        except ValueError as error:
            raise ParameterError(f"scenario {self.name}: {str(error).rstrip('.')}.") from None
        return command, load


def _units_resolved(table: dict[str, Any], folder: Path, what: str, units: Units) -> dict[str, Any]:
    """Amplitudes with units as SI numbers; paths of profiles relative to the scenario file."""
    for history, unit in zip(("command", "load"), units, strict=True):
        parts = table.get(history, [])
        if not isinstance(parts, list):
            continue  # validation will say so
        for n, part in enumerate(parts):
            if not isinstance(part, dict):
                continue
            fields = {"value": unit, "amplitude": unit, "rate": f"{unit}/s", "phase": "rad"}
            for name in fields.keys() & part.keys():
                if isinstance(part[name], str):
                    part[name] = parse_quantity(
                        part[name], fields[name], f"{what}: {history}.{n}.{name}"
                    )
            if isinstance(part.get("file"), str):
                part["file"] = folder / part["file"]
    return table


def shipped_scenarios(module: str = "ematwin.models.bldc") -> dict[str, Path]:
    """Names and files of the scenarios in the folder ``scenarios`` beside a module."""
    folder = folder_of(module) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
