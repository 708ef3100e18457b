"""Unknowns of a ball-screw actuator, in one table: faults, nuisances, a symptom.

Priors are wide enough to let a motion speak where it says anything.
"""

from collections.abc import Mapping

from ematwin.models.ball_screw.parameters import BallScrew
from ematwin.models.unknown import Alias, Unknown

MOST_BACKLASH = 5e-3  # m
_MOST_LOAD = 2.0  # of the friction at standstill
_MOST_ERROR = 5e-3  # m


def unknowns(actuator: BallScrew) -> tuple[Unknown, ...]:
    """Unknowns of an actuator; faults and nuisances in the order of `MAGNITUDES`."""
    play, force = float(actuator.screw.backlash), float(actuator.screw.friction_force)
    load = _MOST_LOAD * force
    return (
        Unknown("friction", "", "dry friction, as a multiple of the healthy one",
                1.0, 0.05, 6.0, spread=2.0),
        Unknown("backlash", "m", "play of the nut on the screw",
                play, 0.0, max(MOST_BACKLASH, 2.0 * play), spread=1e-3,
                physical_unit="mm", physical=lambda _, value: 1e3 * value),
        Unknown("gain", "", "gain of the position loop, as a multiple of the healthy one",
                1.0, 0.3, 3.0, spread=0.3),
        Unknown("load", "N", "load that pushes towards larger positions",
                0.0, -load, load, "nuisance", spread=0.5 * force),
        Unknown("initial_error", "m", "position error at the first sample",
                0.0, -_MOST_ERROR, _MOST_ERROR, "nuisance", spread=2e-3),
        Unknown("roughness", "", "share of the moving current that swings with the turn of the "
                "screw, from surface damage", 0.0, 0.0, 2.0, "symptom"),
    )  # fmt: skip


def aliases(values: Mapping[str, float]) -> list[Alias]:
    """Friction and gain multiply parameters."""
    return [
        Alias("screw.friction_force", {"friction": values.get("friction", 1.0)}),
        Alias(
            "controller.position_gain",
            {"gain": values.get("gain", 1.0), "controller.integral_gain": -1.0},
        ),
    ]
