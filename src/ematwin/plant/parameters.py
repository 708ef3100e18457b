"""Parameters of an actuator: validated, in SI, each from a file that gives unit and source.

A file holds a table for each section and, for each parameter, ``{ value, unit, source }``. The
shipped sets lie in ``actuators/``.
"""

import hashlib
import json
import math
from collections.abc import Iterator
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator
from pydantic.fields import FieldInfo

from ematwin.errors import ParameterError
from ematwin.quantities import to_si
from ematwin.validation import load_toml, one_sentence

DEFAULT_ACTUATOR = "servo48"
SHORTEST_STEP = 1e-9  # s: nothing in an actuator is so fast; a shorter one is a slip of the unit
_UNREACHABLE = 100.0  # times the current that the supply can drive: mA taken for A give 1000


def _quantity(unit: str, meaning: str, **limits: Any) -> Any:
    return Field(
        description=meaning,
        json_schema_extra={"unit": unit},
        allow_inf_nan=False,
        **limits,
    )


def unit_of(field: FieldInfo) -> str:
    """SI unit of a parameter; the empty string for a ratio."""
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    return str(extra["unit"])


class Section(BaseModel):
    """A table of the parameter file."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Motor(Section):
    """Three-phase trapezoidal brushless motor."""

    resistance: float = _quantity("ohm", "resistance, phase to phase", gt=0)
    inductance: float = _quantity("H", "inductance, phase to phase", gt=0)
    leakage_share: float = _quantity(
        "", "share of the inductance outside the turns; left in a full short", ge=0.001, le=1
    )
    emf_constant: float = _quantity("V*s/rad", "back-EMF constant, phase to phase", gt=0)
    pole_pairs: int = _quantity("", "pole pairs", ge=1)
    turns_per_phase: int = _quantity("", "turns of each phase", ge=1)
    inertia: float = _quantity("kg*m^2", "rotor inertia", gt=0)
    viscous_damping: float = _quantity("N*m*s/rad", "viscous damping on the motor shaft", ge=0)
    friction_torque: float = _quantity("N*m", "dynamic dry friction of the motor side", ge=0)


class Drive(Section):
    """Inverter and current regulation."""

    supply_voltage: float = _quantity("V", "DC supply", gt=0)
    diode_drop: float = _quantity("V", "forward voltage of a freewheeling diode", ge=0)
    hysteresis_band: float = _quantity("A", "full width of the current band", gt=0)
    current_limit: float = _quantity("A", "limit of the current reference", gt=0)


class Controller(Section):
    """Position and speed loops."""

    position_gain: float = _quantity("1/s", "proportional gain, position to speed", gt=0)
    speed_gain: float = _quantity("N*m*s/rad", "proportional gain, speed to torque", gt=0)
    speed_limit: float = _quantity("rad/s", "limit of the speed reference, motor shaft", gt=0)


class Transmission(Section):
    """Gear, backlash contact, output."""

    ratio: float = _quantity("", "motor turns for one turn of the output", gt=0)
    backlash: float = _quantity("rad", "healthy backlash, full width, on the motor shaft", ge=0)
    contact_stiffness: float = _quantity("N*m/rad", "contact stiffness on the motor shaft", gt=0)
    contact_damping: float = _quantity("N*m*s/rad", "contact damping on the motor shaft", ge=0)
    output_inertia: float = _quantity("kg*m^2", "output inertia reflected to the motor", gt=0)
    friction_torque: float = _quantity(
        "N*m", "dynamic dry friction of the output side, reflected to the motor", ge=0
    )
    static_ratio: float = _quantity("", "static over dynamic friction", ge=1)
    efficiency_opposing: float = _quantity("", "efficiency against an opposing load", gt=0, le=1)
    efficiency_aiding: float = _quantity("", "efficiency with an aiding load", gt=0, le=1)
    travel_low: float = _quantity("rad", "lower end stop of the output")
    travel_high: float = _quantity("rad", "upper end stop of the output")

    @model_validator(mode="after")
    def _travel_is_an_interval(self) -> Self:
        if not self.travel_low < 0.0 < self.travel_high:
            raise ValueError(
                "travel_low must lie below zero and travel_high above, received "
                f"{self.travel_low} and {self.travel_high} rad; correct the end stops"
            )
        return self


class Steps(Section):
    """Fixed steps of the two models; justified in docs/models.md."""

    reference: float = _quantity("s", "step of the reference model", gt=0)
    monitor: float = _quantity("s", "step of the monitor model", gt=0)


class Actuator(BaseModel):
    """One actuator, all values in SI.

    Load one with `Actuator.load("servo48")` or `Actuator.load("mine.toml")`; make a variant with
    `actuator.changed({"motor.resistance": 2.3})`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    description: str
    motor: Motor
    drive: Drive
    controller: Controller
    transmission: Transmission
    steps: Steps
    _sources: dict[str, str] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _steps_are_stable(self) -> Self:
        for model in ("reference", "monitor"):
            self.check_step(model, getattr(self.steps, model))
        return self

    @model_validator(mode="after")
    def _current_can_be_reached(self) -> Self:
        drivable = self.drive.supply_voltage / self.motor.resistance
        if self.drive.current_limit > _UNREACHABLE * drivable:
            raise ValueError(
                f"drive.current_limit is {self.drive.current_limit:g} A, where the supply can "
                f"drive {drivable:.3g} A; it looks like mA, correct its unit"
            )
        return self

    @classmethod
    def load(cls, name_or_path: "str | Path | Actuator" = DEFAULT_ACTUATOR) -> "Actuator":
        """A shipped set by name, or a TOML file.

        Raises
        ------
        ParameterError
            If there is no such set, or a value is missing, impossible or of the wrong unit.
        FileError
            If the file cannot be read.
        """
        if isinstance(name_or_path, Actuator):
            return name_or_path
        path = Path(name_or_path)
        if path.suffix == ".toml":
            return cls.from_dict(load_toml(path, "actuator"), str(path))
        shipped = shipped_actuators()
        if str(name_or_path) not in shipped:
            raise ParameterError(
                f"There is no actuator {str(name_or_path)!r}. Shipped: {', '.join(shipped)}; "
                "or give the path of a TOML file (ending in .toml)."
            )
        return cls.from_dict(load_toml(shipped[str(name_or_path)], "actuator"), str(name_or_path))

    @classmethod
    def from_dict(cls, table: dict[str, Any], what: str = "actuator") -> "Actuator":
        """An actuator from the content of a parameter file: values, units and sources."""
        plain: dict[str, Any] = {}
        sources: dict[str, str] = {}
        for key, entry in table.items():
            field = cls.model_fields.get(key)
            if field is None or not isinstance(entry, dict):
                plain[key] = entry
                continue
            section: Any = field.annotation
            plain[key] = {}
            for name, leaf in entry.items():
                place = f"{key}.{name}"
                if name not in section.model_fields:
                    plain[key][name] = leaf
                    continue
                if not (isinstance(leaf, dict) and {"value", "unit", "source"} == set(leaf)):
                    raise ParameterError(
                        f"{what}: {place} must be {{ value = ..., unit = ..., source = ... }}, "
                        f"received {leaf!r}; complete it."
                    )
                if isinstance(leaf["value"], bool) or not isinstance(leaf["value"], int | float):
                    raise ParameterError(
                        f"{what}: {place} must be a number, received {leaf['value']!r}; correct it."
                    )
                if not (isinstance(leaf["source"], str) and leaf["source"].strip()):
                    raise ParameterError(
                        f"{what}: {place} must name the source of its value, received "
                        f"{leaf['source']!r}; say where it comes from."
                    )
                unit = unit_of(section.model_fields[name])
                si = to_si(leaf["value"], leaf["unit"], unit, f"{what}: {place}")
                plain[key][name] = si
                sources[place] = leaf["source"]
        try:
            actuator = cls.model_validate(plain)
        except ValidationError as error:
            raise one_sentence(error, what) from None
        actuator._sources.update(sources)
        return actuator

    def changed(self, values: dict[str, float]) -> "Actuator":
        """A variant with some values replaced, e.g. ``{"motor.resistance": 2.3}``, in SI."""
        table = self.model_dump()
        for place, value in values.items():
            section, _, name = place.partition(".")
            if section not in table or name not in table[section]:
                raise ParameterError(
                    f"{place!r} is not a parameter of an actuator; use section.name such as "
                    "'motor.resistance'."
                )
            table[section][name] = value
        try:
            variant = type(self).model_validate(table)
        except ValidationError as error:
            raise one_sentence(error, self.name) from None
        variant._sources.update(self._sources)
        return variant

    def parameters(self) -> Iterator[tuple[str, float, str, str, str]]:
        """Yield place, value, SI unit, meaning and source of each parameter."""
        for key, section in self:
            if isinstance(section, Section):
                for name, field in type(section).model_fields.items():
                    place = f"{key}.{name}"
                    yield (
                        place,
                        getattr(section, name),
                        unit_of(field),
                        str(field.description),
                        self._sources.get(place, "set by the user"),
                    )

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all values: equal fingerprints simulate alike."""
        values = self.model_dump(exclude={"name", "description"})
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]

    def largest_stable_step(self, model: str) -> float:
        """Longest step of a model for which its fastest mode neither grows nor rings, s."""
        j_m, j_o = self.motor.inertia, self.transmission.output_inertia
        # semi-implicit Euler holds dt/tau < 1 for first-order modes without ringing
        limits = [j_m / (self.controller.speed_gain + self.motor.viscous_damping)]
        if model == "reference":
            compliance = 1.0 / j_m + 1.0 / j_o
            limits.append(1.0 / math.sqrt(self.transmission.contact_stiffness * compliance))
            if self.transmission.contact_damping > 0.0:
                limits.append(1.0 / (self.transmission.contact_damping * compliance))
            limits.append(self.motor.inductance / self.motor.resistance)
        return min(limits)

    def check_step(self, model: str, step: float) -> None:
        """Raise `ParameterError` if ``step`` (s) is too long for this actuator, or absurd."""
        longest = self.largest_stable_step(model)
        if not SHORTEST_STEP <= step <= longest:
            advice = (
                "shorten it or correct the inertias, gains and stiffness"
                if step > longest
                else "correct it"
            )
            raise ParameterError(
                f"the step of the {model} model must lie between {SHORTEST_STEP:g} and "
                f"{longest:.3g} s for this actuator, received {step:.3g} s; {advice}"
            )


def shipped_actuators() -> dict[str, Path]:
    """Names and files of the parameter sets that come with ematwin."""
    folder = Path(str(resources.files("ematwin.plant"))) / "actuators"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
