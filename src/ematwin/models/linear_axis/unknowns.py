"""Unknowns of a linear axis: its faults, in one table.

Each is a factor on the healthy value, so that calibration and drift apply to both alike.
"""

from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.models.unknown import Alias, Contrast, Unknown


def unknowns(actuator: LinearAxis) -> tuple[Unknown, ...]:
    """Unknowns of an actuator."""
    return (
        Unknown("friction", "", "Coulomb friction of both directions, as a multiple of the healthy "
                "one", 1.0, 0.25, 4.0, logarithmic=True, physical_unit="N",
                physical=lambda axis, k: axis.friction.coulomb * k),
        Unknown("viscous", "", "viscous friction of both directions, as a multiple of the healthy "
                "one", 1.0, 0.25, 4.0, logarithmic=True, physical_unit="N*s/m",
                physical=lambda axis, k: axis.friction.viscous * k),
        Unknown("dry_asymmetry", "", "Coulomb friction backward over forward, as a multiple of the "
                "healthy ratio", 1.0, 0.33, 3.0, logarithmic=True,
                physical=lambda axis, k: axis.friction.coulomb_ratio * k),
        Unknown("viscous_asymmetry", "", "viscous friction backward over forward, as a multiple of "
                "the healthy ratio", 1.0, 0.33, 3.0, logarithmic=True,
                physical=lambda axis, k: axis.friction.viscous_ratio * k),
        Unknown("drive_gain", "", "force for a voltage, as a multiple of the healthy one: magnets, "
                "amplifier", 1.0, 0.5, 1.5, logarithmic=True, physical_unit="N/V",
                physical=lambda axis, k: axis.drive.gain * k),
        Unknown("position_gain", "", "gain of the position loop, as a multiple of the healthy one",
                1.0, 0.5, 1.5, logarithmic=True, physical_unit="1/s",
                physical=lambda axis, k: axis.controller.position_gain * k),
    )  # fmt: skip


def aliases() -> list[Alias]:
    """Faults against the parameters that they multiply, and the scale of all forces.

    With gain, mass and friction multiplied by one factor, the carriage moves as before.
    """
    return [
        Alias("friction.coulomb", {"friction": 1.0}),
        Alias("friction.viscous", {"viscous": 1.0}),
        Alias("friction.coulomb_ratio", {"dry_asymmetry": 1.0}),
        Alias("friction.viscous_ratio", {"viscous_asymmetry": 1.0}),
        Alias(
            "drive.gain", {"carriage.mass": 1.0, "friction.coulomb": 1.0, "friction.viscous": 1.0}
        ),
        Alias("drive.gain", {"drive_gain": 1.0}),
        Alias("controller.position_gain", {"position_gain": 1.0}),
    ]


# The split of an asymmetry into dry and viscous friction is vague; their sum is not.
CONTRASTS = (
    Contrast(
        "asymmetry", {"dry_asymmetry": 0.5, "viscous_asymmetry": 0.5},
        "Friction backward over forward where half of it is viscous, as a multiple of the healthy "
        "ratio",
        "A constant force, as on an axis that is not level, looks like asymmetric Coulomb "
        "friction.",
    ),
)  # fmt: skip
