"""Scenarios: what an actuator is asked to do, as a command and a load over time.

A history is the sum of its components. In a TOML file a value is a number in SI or a string with
a unit; from Python the same components are objects:

    Scenario(duration=0.5, command=[Chirp(amplitude=0.005, f_start=5, f_end=25)],
             load=[Step(value=10, time=0.25)])
"""

from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from ematwin.errors import ParameterError
from ematwin.plant.parameters import Actuator
from ematwin.quantities import parse_quantity
from ematwin.validation import load_toml, one_sentence

DEFAULT_SCENARIO = "default"


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
    """A part of a history. Amplitudes are rad for a command and N m for a load."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise one_sentence(error, type(self).__name__.lower()) from None

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
    """A sine whose frequency runs linearly from ``f_start`` to ``f_end`` within ``duration``."""

    type: Literal["chirp"] = "chirp"
    amplitude: Finite
    f_start: Hertz
    f_end: Hertz
    start: Seconds = 0.0
    duration: Annotated[float, _unit("s"), Field(gt=0)] | None = None

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        from scipy.signal import chirp

        span = float(time[-1]) - self.start if self.duration is None else self.duration
        since = np.clip(time - self.start, 0.0, span)
        wave = chirp(since, self.f_start, span, self.f_end, phi=-90.0)
        return self.amplitude * wave


class Profile(Component):
    """Straight lines through ``(time, value)`` points, from a list or a recorded file.

    ``file`` is a CSV or Parquet file with a column ``time`` and the column named by ``column``.
    """

    type: Literal["profile"] = "profile"
    time: list[float] | None = None
    value: list[float] | None = None
    file: Path | None = None
    column: str | None = None

    @model_validator(mode="after")
    def _has_one_source(self) -> Self:
        points = self.time is not None and self.value is not None
        if points == (self.file is not None):
            raise ValueError(
                "a profile needs either time and value, or file and column, received "
                f"{sorted(self.model_fields_set - {'type'})}; give one of the two"
            )
        if self.file is not None and self.column is None:
            raise ValueError("a profile from a file needs the name of its column; add column")
        if self.time is not None and self.value is not None:
            check_profile(np.asarray(self.time), np.asarray(self.value))
        return self

    def at(self, time: np.ndarray) -> np.ndarray:  # noqa: D102
        if self.time is not None:
            return np.interp(time, self.time, np.asarray(self.value, dtype=float))
        assert self.file is not None
        assert self.column is not None
        from ematwin.readers.tables import read_columns

        columns = read_columns(self.file, ["time", self.column])
        check_profile(columns["time"], columns[self.column])
        return np.interp(time - time[0], columns["time"] - columns["time"][0], columns[self.column])


def check_profile(time: np.ndarray, value: np.ndarray) -> None:
    """Raise ValueError unless time increases, all is finite, and both are equally long."""
    if time.size != value.size or time.size < 2:
        raise ValueError(
            f"a profile needs as many times as values and at least two, received {time.size} and "
            f"{value.size}"
        )
    if not (np.isfinite(time).all() and np.isfinite(value).all()):
        raise ValueError("a profile holds NaN or infinite values; remove them")
    falls = np.flatnonzero(np.diff(time) <= 0.0)
    if falls.size:
        n = int(falls[0])
        raise ValueError(
            f"the time of a profile must increase: point {n + 1} ({time[n + 1]:g} s) follows "
            f"{time[n]:g} s; sort it"
        )


History = list[Annotated[Step | Ramp | Sine | Chirp | Profile, Field(discriminator="type")]]


class Scenario(BaseModel):
    """Command (rad, on the output) and load (N m, on the output, against positive motion)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

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

    @classmethod
    def load_file(cls, name_or_path: "str | Path | Scenario" = DEFAULT_SCENARIO) -> "Scenario":
        """A shipped scenario by name, a TOML file, or a recorded CSV or Parquet file.

        A recorded file needs the columns ``time`` and ``command``; ``load`` is taken if present.
        """
        if isinstance(name_or_path, Scenario):
            return name_or_path
        path = Path(name_or_path)
        if path.suffix == ".toml":
            return cls(**_units_resolved(load_toml(path, "scenario"), path.parent))
        if path.suffix:
            from ematwin.readers.tables import read_columns

            columns = read_columns(path, ["time", "command"], optional=["load"])
            return cls.from_columns(
                columns["time"], columns["command"], columns.get("load"), name=path.stem
            )
        shipped = shipped_scenarios()
        if str(name_or_path) not in shipped:
            raise ParameterError(
                f"There is no scenario {str(name_or_path)!r}. Shipped: {', '.join(shipped)}; "
                "or give the path of a TOML, CSV or Parquet file."
            )
        file = shipped[str(name_or_path)]
        return cls(**_units_resolved(load_toml(file, "scenario"), file.parent))

    @classmethod
    def from_columns(
        cls,
        time: np.ndarray,
        command: np.ndarray,
        load: np.ndarray | None = None,
        name: str = "recorded",
    ) -> "Scenario":
        """A scenario from recorded columns: time (s), command (rad) and load (N m)."""
        time = np.asarray(time, dtype=float)
        start = (time - time[0]).tolist() if time.size else []
        histories: dict[str, Any] = {
            "command": [Profile(time=start, value=np.asarray(command, dtype=float).tolist())]
        }
        if load is not None:
            histories["load"] = [Profile(time=start, value=np.asarray(load, dtype=float).tolist())]
        return cls(name=name, duration=start[-1], **histories)

    def histories(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Command (rad) and load (N m) at times (s) from the start."""
        try:
            command = sum((part.at(time) for part in self.command), np.zeros(time.shape))
            load = sum((part.at(time) for part in self.load), np.zeros(time.shape))
        except ValueError as error:
            raise ParameterError(f"scenario {self.name}: {error}.") from None
        return command, load

    def check(self, actuator: Actuator) -> None:
        """Raise `ParameterError` if the command leaves the travel of the actuator."""
        time = np.linspace(0.0, self.duration, 2001)
        command, _ = self.histories(time)
        gear = actuator.transmission
        low, high = float(command.min()), float(command.max())
        if low < gear.travel_low or high > gear.travel_high:
            reach = max(abs(low), abs(high))
            limit = max(abs(gear.travel_low), abs(gear.travel_high))
            hint = (
                "It looks like degrees; give radians, or a unit."
                if 10.0 < reach / limit < 180.0
                else "Shorten the command."
            )
            raise ParameterError(
                f"The command of scenario {self.name} reaches {low:.4g} to {high:.4g} rad, beyond "
                f"the end stops of {actuator.name} at {gear.travel_low:.4g} and "
                f"{gear.travel_high:.4g} rad. {hint}"
            )


_AMPLITUDES = ("value", "rate", "amplitude")


def _units_resolved(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Amplitudes with units as SI numbers; paths of profiles relative to the scenario file."""
    for history, unit in (("command", "rad"), ("load", "N*m")):
        for part in table.get(history, []):
            if not isinstance(part, dict):
                continue
            for name in _AMPLITUDES:
                if isinstance(part.get(name), str):
                    si_unit = f"{unit}/s" if name == "rate" else unit
                    part[name] = parse_quantity(part[name], si_unit, f"{history}.{name}")
            if isinstance(part.get("phase"), str):
                part["phase"] = parse_quantity(part["phase"], "rad", f"{history}.phase")
            if isinstance(part.get("file"), str):
                part["file"] = folder / part["file"]
    return table


def shipped_scenarios() -> dict[str, Path]:
    """Names and files of the scenarios that come with ematwin."""
    folder = Path(str(resources.files("ematwin.plant"))) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
