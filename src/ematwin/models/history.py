"""Parts of a history over time: steps, ramps, sines, chirps, and profiles, also of recorded files.

A command or load is the sum of such parts (`ematwin.models.scenario`).
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from ematwin.errors import ParameterError, RecordError
from ematwin.quantities import parse_quantity
from ematwin.recordings.formats.base import open_file
from ematwin.recordings.words import beside, unit_factor, unit_in_name
from ematwin.validation import one_sentence


def _unit(si_unit: str) -> Any:
    def convert(value: Any) -> Any:
        try:
            return parse_quantity(value, si_unit, "it") if isinstance(value, str) else value
        except ParameterError as error:
            raise ValueError(str(error)) from None

    return BeforeValidator(convert)


Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, _unit("s"), Field(allow_inf_nan=False)]
Duration = Annotated[float, _unit("s"), Field(gt=0, allow_inf_nan=False)]
Hertz = Annotated[float, _unit("Hz"), Field(allow_inf_nan=False, ge=0)]


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
        columns = recorded_columns(self.file, {"time": ("s",), self.column: units}, {})
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


def recorded_columns(
    path: Path, kinds: Mapping[str, tuple[str, ...]], optional: Mapping[str, tuple[str, ...]]
) -> dict[str, np.ndarray]:
    """Named columns of a file in SI; their unit stands in the file or in their name.

    ``kinds`` and ``optional`` give the possible SI units of each column.
    """
    columns = {}
    with open_file(path) as file:
        for wanted, units in {**kinds, **optional}.items():
            name = _named(wanted, units, file.names)
            if name is not None:
                behind = (unit_in_name(name, unit)[1] for unit in units)
                unit = file.stated_unit(name) or beside(name)[1] or next(filter(None, behind), "")
                factor = _factor(unit, units, f"{name!r} of {path}")
                columns[wanted] = file.read([name])[name] * factor
            elif wanted in kinds:
                raise ParameterError(
                    f"{path} has no column {wanted!r}; it has {', '.join(file.names)}. "
                    "Rename or add the column."
                )
    return columns


def _named(wanted: str, units: tuple[str, ...], names: tuple[str, ...]) -> str | None:
    """The column of that name, with or without a unit, such as ``command_deg``."""
    ways: list[Callable[[str], str]] = [str, lambda name: beside(name)[0]]
    ways += [lambda name, unit=unit: unit_in_name(name, unit)[0] for unit in units]  # type: ignore[misc]
    return next((name for way in ways for name in names if way(name) == wanted), None)


def _factor(unit: str, kinds: tuple[str, ...], what: str) -> float:
    """The factor to the first of the SI units that fits; 1 without a unit."""
    if not unit:
        return 1.0
    for kind in kinds:
        with suppress(RecordError):
            return unit_factor(unit, kind, what)
    raise ParameterError(
        f"{what} must have a unit of the kind {' or '.join(kinds)}; received {unit!r}. Correct it."
    )
