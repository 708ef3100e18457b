"""Scenarios: what an actuator is asked to do, as a command and a load over time.

A history is the sum of its parts: steps, ramps, sines, chirps, and profiles. In a TOML file a value
is a number in SI or a string with a unit; from Python the same parts are objects:

    Scenario(duration=0.5, command=[Chirp(amplitude=0.005, f_start=5, f_end=25)],
             load=[Step(value=10, time=0.25)])
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from ematwin.errors import ParameterError, RecordError
from ematwin.files import check_target, write_text
from ematwin.models.parameter_set import shipped_scenarios
from ematwin.quantities import parse_quantity
from ematwin.recordings.formats.base import open_file
from ematwin.recordings.words import beside, unit_factor, unit_in_name
from ematwin.validation import load_toml, one_sentence


def _in_si(si_unit: str, value: Any) -> Any:
    try:
        return parse_quantity(value, si_unit, "it") if isinstance(value, str) else value
    except ParameterError as error:
        raise ValueError(str(error)) from None


Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, BeforeValidator(partial(_in_si, "s")), Field(allow_inf_nan=False)]
Duration = Annotated[float, BeforeValidator(partial(_in_si, "s")), Field(gt=0, allow_inf_nan=False)]
Hertz = Annotated[float, BeforeValidator(partial(_in_si, "Hz")), Field(allow_inf_nan=False, ge=0)]


class Component(BaseModel):
    """A part of a history. Amplitudes are in SI: rad for the command of a rotary actuator."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

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
        times = ("time", "start", "stop", "duration")
        given = {name: value for name, value in self if name in times and value is not None}
        return self.model_copy(update={name: factor * value for name, value in given.items()})

    def at(self, time: np.ndarray) -> np.ndarray:
        """Values at times (s) from the start of the scenario."""
        raise NotImplementedError(f"{type(self).__name__} does not say what it is over time")


class Step(Component):
    """Zero until ``time``, then ``value``."""

    type: Literal["step"] = "step"
    value: Finite
    time: Seconds = 0.0

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        return np.where(time >= self.time, self.value, 0.0)


class Ramp(Component):
    """Zero until ``start``, then ``rate`` per second until ``stop``, then held."""

    type: Literal["ramp"] = "ramp"
    rate: Finite
    start: Seconds = 0.0
    stop: Seconds | None = None

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
    duration: Duration | None = None

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
            _check_profile(np.asarray(self.time), np.asarray(self.value))
        return self

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (s) and values (SI) of the points, from the file where there is one."""
        if self.file is None or self.column is None:
            return np.asarray(self.time, dtype=float), np.asarray(self.value, dtype=float)
        units = ("rad", "N*m", "m", "N", "rad/s", "m/s", "V", "A")
        columns = _recorded(self.file, {"time": ("s",), self.column: units}, {})
        return columns["time"] - columns["time"][0], columns[self.column]

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        since, value = self.points()
        _check_profile(since, value)
        return np.interp(time, since, value)


def _check_profile(time: np.ndarray, value: np.ndarray) -> None:
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
    duration: Duration
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
        units: Sequence[str] = ("rad", "N*m"),
    ) -> "Scenario":
        """A shipped scenario by name, a TOML file, or a recorded CSV or Parquet file.

        ``shipped`` are the scenarios of a kind of actuator, the first its default, and ``units``
        the SI units of its command and load, "" where there is none; rad and N m if not given.

        A recorded file needs columns ``time`` and ``command``, and may have ``load``; their names
        or the file may give units, as in ``command [deg]``.

        Raises `ParameterError` if there is no such scenario, or it is impossible or incomplete;
        `FileError` if the file cannot be read.
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
            name_or_path = "default" if "default" in shipped else next(iter(shipped))
        if not isinstance(name_or_path, str | Path):
            raise ParameterError(
                "A scenario is a Scenario, the name of a shipped one, or the path of a file; "
                f"received {type(name_or_path).__name__}."
            )
        path, (unit, load_unit) = Path(name_or_path), units
        if path.suffix and path.suffix != ".toml":
            wanted = {"time": ("s",), "command": (unit,)}
            columns = _recorded(path, wanted, {"load": (load_unit,)} if load_unit else {})
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
        cls, time: np.ndarray, command: np.ndarray, load: np.ndarray | None = None,
        name: str = "recorded",
    ) -> "Scenario":  # fmt: skip
        """A scenario from recorded columns: time (s), command (rad) and load (N m).

        Raises `ParameterError` if time does not increase, a value is not finite, or lengths differ.
        """
        time = np.asarray(time, dtype=float)
        start = (time - time[:1]).tolist()
        command_parts, load_parts = (
            [Profile(time=start, value=np.asarray(one, float).tolist()) for one in given]
            for given in ([command], [] if load is None else [load])
        )
        return cls(name=name, duration=start[-1], command=command_parts, load=load_parts)

    def lasting(self, duration: float) -> "Scenario":
        """The scenario in another duration, s: times in proportion, frequencies as they are.

        Raises `ParameterError` if its times come from a file.
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
        return Scenario(**{**dict(self), "duration": duration, "command": command, "load": load})

    def save(self, path: str | Path) -> None:
        """Write a TOML file, whole or not at all; numbers are in SI.

        Raises `InputError` if the name has another ending than .toml; `FileError` if it cannot be
        written.
        """
        import tomli_w

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


def _units_resolved(
    table: dict[str, Any], folder: Path, what: str, units: Sequence[str]
) -> dict[str, Any]:
    """Amplitudes with units as SI numbers; paths of profiles relative to the scenario file."""
    for history, unit in zip(("command", "load"), units, strict=True):
        fields = {"value": unit, "amplitude": unit, "rate": f"{unit}/s", "phase": "rad"}
        parts = table.get(history)
        for n, part in enumerate(parts if isinstance(parts, list) else ()):
            if not isinstance(part, dict):
                continue  # validation will say so
            for name in fields.keys() & part.keys():
                if isinstance(part[name], str):
                    place = f"{what}: {history}.{n}.{name}"
                    part[name] = parse_quantity(part[name], fields[name], place)
            if isinstance(part.get("file"), str):
                part["file"] = folder / part["file"]
    return table


def _recorded(
    path: Path, needed: Mapping[str, Sequence[str]], optional: Mapping[str, Sequence[str]]
) -> dict[str, np.ndarray]:
    """Named columns of a file in SI, by the SI units that each may have.

    The unit stands in the file or in the name, such as ``command_deg``.
    """
    columns = {}
    with open_file(path) as file:
        for name, units in {**needed, **optional}.items():
            ways: list[Any] = [str, lambda one: beside(one)[0]]
            ways += [lambda one, unit=unit: unit_in_name(one, unit)[0] for unit in units]
            column = next((one for way in ways for one in file.names if way(one) == name), None)
            if column is not None:
                behind = (unit_in_name(column, unit)[1] for unit in units)
                stated = file.stated_unit(column) or beside(column)[1]
                unit = stated or next(filter(None, behind), "")
                factor = _factor(unit, units, f"{column!r} of {path}")
                columns[name] = file.read([column])[column] * factor
            elif name in needed:
                raise ParameterError(
                    f"{path} has no column {name!r}; it has {', '.join(file.names)}. "
                    "Rename or add the column."
                )
    return columns


def _factor(unit: str, kinds: Sequence[str], what: str) -> float:
    """The factor to the first of the SI units that fits; 1 without a unit."""
    if not unit:
        return 1.0
    for kind in kinds:
        with suppress(RecordError):
            return unit_factor(unit, kind, what)
    raise ParameterError(
        f"{what} must have a unit of the kind {' or '.join(kinds)}; received {unit!r}. Correct it."
    )
