"""Parameters of a brushed DC motor with a gearbox in a position servo."""

from typing import Self

from pydantic import model_validator

from ematwin.models.parameter_set import ParameterSet, Section, quantity


class Motor(Section):
    """Permanent-magnet motor with brushes; values on the motor shaft."""

    resistance: float = quantity("ohm", "armature and brushes", gt=0)
    inductance: float = quantity("H", "armature", gt=0)
    torque_constant: float = quantity("N*m/A", "torque per current, equals EMF per speed", gt=0)
    inertia: float = quantity("kg*m^2", "rotor and first gear stage", gt=0)
    viscous_damping: float = quantity("N*m*s/rad", "torque per speed", ge=0)
    friction_torque: float = quantity("N*m", "dry friction of brushes and bearings", gt=0)


class Gear(Section):
    """Gearbox and what it drives; values on the output shaft."""

    ratio: float = quantity("", "motor speed over output speed", gt=0)
    inertia: float = quantity("kg*m^2", "last gear stage and load", gt=0)
    friction_torque: float = quantity("N*m", "dry friction of gears and seal", gt=0)
    static_ratio: float = quantity("", "static over dynamic friction, motor and gear", ge=1)
    backlash: float = quantity("rad", "play of the output, full width", gt=0)


class Drive(Section):
    """Position servo: position loop, speed loop, current regulator."""

    supply_voltage: float = quantity("V", "largest terminal voltage", gt=0)
    current_limit: float = quantity("A", "largest current reference", gt=0)
    speed_limit: float = quantity("rad/s", "largest speed reference, motor shaft", gt=0)
    position_gain: float = quantity("1/s", "position error to speed reference", gt=0)
    speed_gain: float = quantity("A*s/rad", "speed error to current reference", gt=0)


class Steps(Section):
    """Fixed step of the twin."""

    twin: float = quantity("s", "step of the twin", gt=0)


class DcGearmotor(ParameterSet):
    """One brushed DC gear motor with its servo, all values in SI."""

    kind = "dc-gearmotor"
    default = "dcg25"

    motor: Motor
    gear: Gear
    drive: Drive
    steps: Steps

    @model_validator(mode="after")
    def _step_resolves_the_speed_loop(self) -> Self:
        longest = 0.2 * self.motor.inertia / (self.motor.torque_constant * self.drive.speed_gain)
        if not self.steps.twin <= longest:
            raise ValueError(
                f"steps.twin must be at most {longest:.2g} s, a fifth of the time constant of the "
                f"speed loop, received {self.steps.twin:.2g} s; shorten it"
            )
        return self
