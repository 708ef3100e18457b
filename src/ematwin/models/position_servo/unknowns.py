"""Unknowns of a position servo: its faults and the zero of its encoder, in one table."""

import math

from ematwin.models.position_servo.parameters import PositionServo
from ematwin.models.unknown import Alias, Unknown, multiple

_ZERO = 0.005  # rad, by which the zero of an encoder may move between recordings


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
        Unknown("offset", "rad", "zero of the encoder", 0.0, -0.3, 0.3, "nuisance", spread=_ZERO),
    )  # fmt: skip


def aliases() -> list[Alias]:
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
