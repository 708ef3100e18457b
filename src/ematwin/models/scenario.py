"""Scenarios: what an actuator is asked to do, as a command and a load over time.

A history is the sum of its components. In a TOML file a value is a number in SI or a string with
a unit; from Python the same components are objects:

    Scenario(duration=0.5, command=[Chirp(amplitude=0.005, f_start=5, f_end=25)],
             load=[Step(value=10, time=0.25)])
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ematwin.errors import ParameterError
from ematwin.files import check_target, write_text
from ematwin.models.history import (
    Chirp,
    Component,
    Duration,
    History,
    Profile,
    Ramp,
    Sine,
    Step,
    recorded_columns,
)
from ematwin.models.parameter_set import folder_of
from ematwin.quantities import parse_quantity
from ematwin.validation import load_toml, one_sentence

# users have the parts from here as well
__all__ = ("Chirp", "Component", "Profile", "Ramp", "Scenario", "Sine", "Step", "shipped_scenarios")

Units = tuple[str, str]  # of command and load; "" where there is no load
ROTARY: Units = ("rad", "N*m")


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
        units: Units = ROTARY,
    ) -> "Scenario":
        """A shipped scenario by name, a TOML file, or a recorded CSV or Parquet file.

        ``shipped`` are the scenarios of a kind of actuator, the first its default, and ``units``
        the SI units of its command and load; rad and N m if not given
        (`ematwin.models.base.Model.load_scenario` gives both).

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


def _units_resolved(table: dict[str, Any], folder: Path, what: str, units: Units) -> dict[str, Any]:
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


def shipped_scenarios(module: str = "ematwin.models.bldc") -> dict[str, Path]:
    """Names and files of the scenarios in the folder ``scenarios`` beside a module."""
    folder = folder_of(module) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
