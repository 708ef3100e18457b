"""Parameters of a position servo: controller, motor, gear, friction, and its load.

All values are on the output shaft; the equations are in `step` and in docs/position-servo.md.

Tolerances hold between servos of one type and firmware; for friction they are
judgement. Drift is how far healthy recordings of one servo differed beyond their noise
(docs/lab/position-servo.md): grease and temperature change its friction, temperature its motor, and
the bus the moment at which a goal arrives.
"""

import math
from collections.abc import Mapping
from typing import Self

from pydantic import model_validator

from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.sections import TwinSteps
from ematwin.models.unknown import Alias, Unknown, multiple


class ServoController(Section):
    """The firmware between the goal and the motor."""

    gain: float = quantity(
        "1/rad", "duty for an error of the position", tolerance=0.3, drift=0.03, gt=0
    )
    startup: float = quantity(
        "", "duty that is added in the direction of the error, to start the motor",
        tolerance=1.0, drift=0.2, gt=0,
    )  # fmt: skip
    delay: float = quantity(
        "s", "from a goal on the bus to its effect, as recorded positions show it",
        tolerance=0.5, drift=0.2, gt=0,
    )  # fmt: skip
    speed_limit: float = quantity(
        "rad/s", "speed limit of the target", tolerance=0.2, drift=0.05, gt=0
    )
    interval: float = quantity("s", "from one sample of the position to the next", exact=True, ge=0)


class ServoMotor(Section):
    """DC motor at the rated voltage."""

    rated_voltage: float = quantity("V", "voltage of torque and speed", exact=True, gt=0)
    stall_torque: float = quantity(
        "N*m", "torque at rest and full duty without saturation", tolerance=0.4, drift=0.05, gt=0
    )
    saturation_torque: float = quantity(
        "N*m", "torque that the motor tends to however much duty and supply ask for",
        tolerance=0.6, drift=0.05, gt=0,
    )  # fmt: skip
    no_load_speed: float = quantity(
        "rad/s", "speed at full duty without friction", tolerance=0.3, drift=0.05, gt=0
    )


class ServoGear(Section):
    """Gear with the inertia of the rotor."""

    inertia: float = quantity("kg*m^2", "rotor and gear", tolerance=1.0, drift=0.2, gt=0)
    backlash: float = quantity("rad", "play, full width", tolerance=1.0, drift=0.5, gt=0)


class ServoFriction(Section):
    """Friction of motor and gear."""

    coulomb: float = quantity("N*m", "Coulomb friction", tolerance=1.5, drift=0.25, gt=0)
    stribeck: float = quantity(
        "N*m", "static less Coulomb friction", tolerance=1.5, drift=0.6, gt=0
    )
    stribeck_speed: float = quantity(
        "rad/s", "speed at which half of that is gone", tolerance=1.5, drift=0.5, gt=0
    )
    load_share: float = quantity(
        "", "further friction for each N m of load", tolerance=1.0, drift=0.2, gt=0
    )
    static_share: float = quantity(
        "", "further static friction for each N m of load", tolerance=1.0, drift=0.5, gt=0
    )


class ServoArm(Section):
    """Load of the servo where a recording does not state it: a pendulum, inertia, a torque."""

    mass: float = quantity("kg", "point mass at the end of the arm", exact=True, ge=0)
    length: float = quantity("m", "from the shaft to the mass", exact=True, ge=0)
    arm_mass: float = quantity("kg", "even arm between them", exact=True, ge=0)
    inertia: float = quantity("kg*m^2", "of what has no weight here", exact=True, ge=0)
    torque: float = quantity("N*m", "constant torque against positive motion", exact=True)


class PositionServo(ParameterSet):
    """One position servo, all values in SI, on the output shaft."""

    kind = "position-servo"
    default = "sts3215"

    controller: ServoController
    motor: ServoMotor
    gear: ServoGear
    friction: ServoFriction
    arm: ServoArm
    steps: TwinSteps

    @model_validator(mode="after")
    def _step_resolves_the_loop(self) -> Self:
        stiffness = self.controller.gain * self.motor.stall_torque
        longest = 0.5 * (self.gear.inertia / stiffness) ** 0.5
        self.steps.check(1e-5, longest, "a half over the frequency of the position loop")
        return self

    @model_validator(mode="after")
    def _something_moves(self) -> Self:
        arm = self.arm
        if not arm.inertia + (arm.mass + arm.arm_mass) * arm.length**2 > 0.0:
            raise ValueError(
                "arm has neither inertia nor a mass at a length; give arm.inertia, or mass and "
                "length of the arm"
            )
        return self


def unknowns(actuator: PositionServo) -> tuple[Unknown, ...]:
    """Unknowns of an actuator: faults as multiples of healthy values."""
    friction = actuator.friction
    return (
        multiple(actuator, "gain", "controller.gain", "gain of the position loop", 0.2, 2.5),
        Unknown("friction", "", "all friction of motor and gear, as a multiple of the healthy one",
                1.0, 0.25, 4.0, logarithmic=True, physical_unit="N*m",
                physical=lambda a, k: (friction.coulomb + friction.stribeck) * k),
        Unknown("backlash", "", "play of the gear, as a multiple of the healthy one",
                1.0, 1.0, 15.0, logarithmic=True, physical_unit="deg",
                physical=lambda a, k: math.degrees(a.gear.backlash * k)),
        multiple(actuator, "torque", "motor.stall_torque",
                 "torque constant of the motor, less where its magnets are weak", 0.4, 2.0),
        Unknown("payload", "", "weight and inertia of the load, as a multiple of what is stated",
                1.0, 0.25, 4.0, logarithmic=True),
        Unknown("delay", "", "delay of the goal, as a multiple of the healthy one",
                1.0, 1.0, 5.0, logarithmic=True, physical_unit="ms",
                physical=lambda a, k: 1e3 * a.controller.delay * k),
        # by so much it may move between recordings
        Unknown("offset", "rad", "zero of the encoder", 0.0, -0.3, 0.3, "nuisance", spread=0.005),
    )  # fmt: skip


def aliases(actuator: PositionServo, values: Mapping[str, float]) -> list[Alias]:
    """Faults against the parameters that they multiply."""
    return [
        Alias("controller.gain", {"gain": 1.0}),
        Alias("controller.delay", {"delay": 1.0}),
        Alias("gear.backlash", {"backlash": 1.0}),
        Alias(
            "motor.stall_torque",
            {"torque": 1.0, "motor.no_load_speed": 1.0, "motor.saturation_torque": -1.0},
        ),
        Alias(
            "friction.coulomb",
            {"friction": 1.0}
            | {f"friction.{name}": -1.0 for name in ("stribeck", "load_share", "static_share")},
        ),
    ]
