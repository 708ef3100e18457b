"""Parameters of a rotary actuator with a brushless motor and a gear."""

import math
from typing import ClassVar, Self

from pydantic import model_validator

from ematwin.errors import ParameterError
from ematwin.models.parameter_set import ParameterSet, Section, quantity

DEFAULT_ACTUATOR = "servo48"
SHORTEST_STEP = 1e-9  # s: nothing in an actuator is so fast; a shorter one is a slip of the unit
_UNREACHABLE = 100.0  # times the current that the supply can drive: mA taken for A give 1000


class Motor(Section):
    """Three-phase trapezoidal brushless motor."""

    resistance: float = quantity("ohm", "resistance, phase to phase", gt=0)
    inductance: float = quantity("H", "inductance, phase to phase", gt=0)
    leakage_share: float = quantity(
        "", "share of the inductance outside the turns; left in a full short", ge=0.001, le=1
    )
    emf_constant: float = quantity("V*s/rad", "back-EMF constant, phase to phase", gt=0)
    pole_pairs: int = quantity("", "pole pairs", ge=1)
    turns_per_phase: int = quantity("", "turns of each phase", ge=1)
    inertia: float = quantity("kg*m^2", "rotor inertia", gt=0)
    viscous_damping: float = quantity("N*m*s/rad", "viscous damping on the motor shaft", ge=0)
    friction_torque: float = quantity("N*m", "dynamic dry friction of the motor side", ge=0)


class Drive(Section):
    """Inverter and current regulation."""

    supply_voltage: float = quantity("V", "DC supply", gt=0)
    diode_drop: float = quantity("V", "forward voltage of a freewheeling diode", ge=0)
    hysteresis_band: float = quantity("A", "full width of the current band", gt=0)
    current_limit: float = quantity("A", "limit of the current reference", gt=0)


class Controller(Section):
    """Position and speed loops."""

    position_gain: float = quantity("1/s", "proportional gain, position to speed", gt=0)
    speed_gain: float = quantity("N*m*s/rad", "proportional gain, speed to torque", gt=0)
    speed_limit: float = quantity("rad/s", "limit of the speed reference, motor shaft", gt=0)


class Transmission(Section):
    """Gear, backlash contact, output."""

    ratio: float = quantity("", "motor turns for one turn of the output", gt=0)
    backlash: float = quantity("rad", "healthy backlash, full width, on the motor shaft", ge=0)
    contact_stiffness: float = quantity("N*m/rad", "contact stiffness on the motor shaft", gt=0)
    contact_damping: float = quantity("N*m*s/rad", "contact damping on the motor shaft", ge=0)
    output_inertia: float = quantity("kg*m^2", "output inertia reflected to the motor", gt=0)
    friction_torque: float = quantity(
        "N*m", "dynamic dry friction of the output side, reflected to the motor", ge=0
    )
    static_ratio: float = quantity("", "static over dynamic friction", ge=1)
    efficiency_opposing: float = quantity("", "efficiency against an opposing load", gt=0, le=1)
    efficiency_aiding: float = quantity("", "efficiency with an aiding load", gt=0, le=1)
    travel_low: float = quantity("rad", "lower end stop of the output")
    travel_high: float = quantity("rad", "upper end stop of the output")

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

    reference: float = quantity("s", "step of the reference model", gt=0)
    monitor: float = quantity("s", "step of the monitor model", gt=0)


class BldcActuator(ParameterSet):
    """One brushless actuator, all values in SI.

    Load one with `BldcActuator.load("servo48")` or `BldcActuator.load("mine.toml")`; make a variant
    with `actuator.changed({"motor.resistance": 2.3})`.
    """

    kind: ClassVar[str] = "bldc"
    former_kinds: ClassVar[tuple[str, ...]] = ("rotary",)
    default: ClassVar[str] = DEFAULT_ACTUATOR

    motor: Motor
    drive: Drive
    controller: Controller
    transmission: Transmission
    steps: Steps

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
                f"drive.current_limit is {self.drive.current_limit:g} A, but the supply can "
                f"drive only {drivable:.3g} A; it looks like mA, correct its unit"
            )
        return self

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
